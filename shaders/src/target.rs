//! Ways to the visbuffer: every one gives the largest (depth, id) of a pixel.

/// How the rasterizers write the visbuffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum VisbufferTarget {
    /// One 64-bit atomic maximum a fragment.
    U64,
    /// Two rounds of 32-bit maxima: depths, then ids at those depths.
    TwoRound,
    /// Attachments of id and depth, by the hardware rasterizer alone.
    Attachment,
}

impl VisbufferTarget {
    /// Every target.
    pub const ALL: [Self; 3] = [Self::U64, Self::TwoRound, Self::Attachment];

    /// Name in options and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::U64 => "u64",
            Self::TwoRound => "two-round",
            Self::Attachment => "attachment",
        }
    }

    /// The file that a pass imports as `visbuffer`.
    pub(crate) fn source(self) -> &'static str {
        match self {
            Self::U64 => include_str!("../wgsl/shared/visbuffer_u64.wgsl"),
            Self::TwoRound => include_str!("../wgsl/shared/visbuffer_two_round.wgsl"),
            Self::Attachment => include_str!("../wgsl/shared/visbuffer_attachment.wgsl"),
        }
    }
}
