//! Rows of an image on their way into its mips, band by band.

use lodestream_shaders::cpu::{MipRows, Mips};

/// Bytes of a band of rows, about.
const BAND_BYTES: usize = 1 << 20;

/// See the module.
pub(super) struct Rows {
    mips: MipRows,
    row_bytes: usize,
    band: Vec<u8>,
}

impl Rows {
    pub(super) fn new(size: [u32; 2], dropped: u32) -> Self {
        Self {
            mips: MipRows::new(size, dropped),
            row_bytes: 4 * size[0] as usize,
            band: Vec::new(),
        }
    }

    /// Takes the next row; `append` adds its RGBA bytes, of which those past the width are left
    /// out.
    pub(super) fn push(&mut self, append: impl FnOnce(&mut Vec<u8>)) {
        let end = self.band.len() + self.row_bytes;
        append(&mut self.band);
        self.band.truncate(end);
        if self.band.len() >= BAND_BYTES {
            self.flush();
        }
    }

    fn flush(&mut self) {
        self.mips.push(&self.band);
        self.band.clear();
    }

    /// All mips, once every row came.
    pub(super) fn finish(mut self) -> Result<Mips, String> {
        self.flush();
        match self.mips.missing_rows() {
            0 => Ok(self.mips.finish()),
            missing => Err(format!("expected all rows, found {missing} fewer")),
        }
    }
}

/// Size of every `1 << step`-th texel of both sides, as halving makes it.
pub(super) fn shrunk(size: [u32; 2], step: u32) -> [u32; 2] {
    size.map(|side| (side >> step).max(1))
}
