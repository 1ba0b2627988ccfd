//! The mean look of a whole asset from its six sides: what stands for an instance below a pixel.

use crate::error::{FormatError, ensure};

/// Sides of a proxy: +x, -x, +y, -y, +z, -z.
pub const PROXY_SIDES: usize = 6;
/// Material slots that a side names at most: those that show most.
pub const MOST_SHARES: usize = 8;

/// Mean look of an asset, local space.
#[derive(Debug, Clone, Default, PartialEq, bincode::Encode, bincode::Decode)]
pub struct Proxy {
    /// Covered area of the projections along x, y and z, square metres. Both directions of an axis
    /// cover the same.
    pub areas_m2: [f32; 3],
    /// How the areas add up in other directions: 0 as those of a sphere (root of the squares), 1 as
    /// those of a box (sum).
    pub boxiness: f32,
    /// Look from each side, in the order of [`PROXY_SIDES`].
    pub sides: [ProxySide; PROXY_SIDES],
}

/// Mean look from one side.
#[derive(Debug, Clone, Default, PartialEq, bincode::Encode, bincode::Decode)]
pub struct ProxySide {
    /// Mean normal of the visible surface, as [`crate::octahedral`] encodes it.
    pub normal: [u16; 2],
    /// Mean vertex colour, linear; white without vertex colours.
    pub color: [u8; 3],
    /// Visible share of the material slots, largest first.
    pub shares: Vec<SlotShare>,
}

/// Part of a side that a material slot covers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bincode::Encode, bincode::Decode)]
pub struct SlotShare {
    /// The slot.
    pub slot: u16,
    /// In parts of the sum of the side's shares; at least 1.
    pub share: u8,
}

impl Proxy {
    pub(crate) fn check(&self, material_slots: u32) -> Result<(), FormatError> {
        let numbers = || self.areas_m2.iter().chain([&self.boxiness]);
        ensure(
            numbers().all(|value| value.is_finite() && *value >= 0.0) && self.boxiness <= 1.0,
            "asset proxy",
            "areas of at least 0, boxiness within 0..=1",
            format_args!("{:?} and {}", self.areas_m2, self.boxiness),
        )?;
        for (index, side) in self.sides.iter().enumerate() {
            let count = side.shares.len();
            ensure(
                count <= MOST_SHARES,
                format_args!("asset proxy side {index} shares"),
                format_args!("at most {MOST_SHARES}"),
                count,
            )?;
            for share in &side.shares {
                ensure(
                    (share.slot as u32) < material_slots && share.share > 0,
                    format_args!("asset proxy side {index} share"),
                    format_args!("of a slot below {material_slots}, at least 1"),
                    format_args!("{share:?}"),
                )?;
            }
        }
        Ok(())
    }

    /// Bytes that it takes beside itself in memory.
    pub(crate) fn heap_bytes(&self) -> usize {
        let shares = self.sides.iter().map(|side| size_of_val(&side.shares[..]));
        shares.sum()
    }
}
