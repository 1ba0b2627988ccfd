//! Lines of text over the picture: drawn on the host, copied row by row into the colour buffer before it is presented.

use super::font;
use crate::gpu::Gpu;

const SCALE: usize = 2;
const MARGIN: usize = 6;
/// Pixels from one line to the next and from one character to the next.
const LINE: usize = (font::HEIGHT + 3) * SCALE;
const ADVANCE: usize = (font::WIDTH + 1) * SCALE;
const PAPER: u32 = 0xff_28_20_18;
const INK: u32 = 0xff_f0_f0_e8;

/// A box of text, RGBA words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextBox {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row by row.
    pub pixels: Vec<u32>,
}

impl TextBox {
    /// Draws `lines`, cut off at `most` pixels.
    pub fn new(lines: &[String], most: [u32; 2]) -> Self {
        let longest = lines
            .iter()
            .map(|line| line.chars().count())
            .max()
            .unwrap_or(0);
        let width = (longest * ADVANCE + 2 * MARGIN).min(most[0] as usize);
        let height = (lines.len() * LINE + 2 * MARGIN).min(most[1] as usize);
        let mut pixels = vec![PAPER; width * height];
        for (row, line) in lines.iter().enumerate() {
            for (column, character) in line.chars().enumerate() {
                let origin = (MARGIN + column * ADVANCE, MARGIN + row * LINE);
                for y in 0..font::HEIGHT * SCALE {
                    for x in 0..font::WIDTH * SCALE {
                        let (at_x, at_y) = (origin.0 + x, origin.1 + y);
                        let set = font::is_set(character, x / SCALE, y / SCALE);
                        if set && at_x < width && at_y < height {
                            pixels[at_y * width + at_x] = INK;
                        }
                    }
                }
            }
        }
        Self {
            width,
            height,
            pixels,
        }
    }

    /// Records the copy into the upper left corner of `color`, whose rows have `row_px` pixels.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        color: &wgpu::Buffer,
        row_px: u32,
    ) {
        if self.pixels.is_empty() {
            return;
        }
        let source = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("overlay"),
            size: size_of_val(self.pixels.as_slice()) as u64,
            usage: wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        gpu.queue
            .write_buffer(&source, 0, bytemuck::cast_slice(&self.pixels));
        let row_bytes = self.width as u64 * 4;
        for row in 0..self.height as u64 {
            let target = row * row_px as u64 * 4;
            encoder.copy_buffer_to_buffer(&source, row * row_bytes, color, target, row_bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_cut_off_at_the_picture() {
        let lines = ["frame 12".to_owned(), "1.5 px".to_owned()];
        let whole = TextBox::new(&lines, [1000, 1000]);
        assert_eq!(
            (whole.width, whole.height),
            (8 * ADVANCE + 12, 2 * LINE + 12)
        );
        assert!(whole.pixels.contains(&INK) && whole.pixels.contains(&PAPER));
        let cut = TextBox::new(&lines, [20, 10]);
        assert_eq!((cut.width, cut.height, cut.pixels.len()), (20, 10, 200));
    }
}
