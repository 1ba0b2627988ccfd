//! Pictures to files: colours as PNG, depths as PFM.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// A file that could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{file}: {reason}")]
pub struct FileError {
    /// The file.
    pub file: String,
    /// The system's words.
    pub reason: String,
}

impl FileError {
    /// `file` with the system's words.
    pub fn new(file: &Path, reason: impl std::fmt::Display) -> Self {
        Self {
            file: file.display().to_string(),
            reason: reason.to_string(),
        }
    }
}

/// Writes RGBA words (red in the low byte, sRGB) as an opaque PNG.
pub fn write_png(file: &Path, size_px: [u32; 2], color: &[u32]) -> Result<(), FileError> {
    let failed = |reason: png::EncodingError| FileError::new(file, reason);
    let writer = BufWriter::new(File::create(file).map_err(|error| FileError::new(file, error))?);
    let mut encoder = png::Encoder::new(writer, size_px[0], size_px[1]);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header().map_err(failed)?;
    let bytes: Vec<u8> = color
        .iter()
        .flat_map(|texel| texel.to_le_bytes().into_iter().take(3))
        .collect();
    writer.write_image_data(&bytes).map_err(failed)?;
    writer.finish().map_err(failed)
}

/// View-space depth of each pixel, metres, 0 where nothing was hit, from visbuffer words over `near_metres`.
pub fn depth_metres(visbuffer: &[u64], near_metres: f32) -> Vec<f32> {
    let metres = |&word: &u64| match (word >> 32) as u32 {
        0 => 0.0,
        bits => near_metres / f32::from_bits(bits),
    };
    visbuffer.iter().map(metres).collect()
}

/// Writes a grey PFM, which begins with the picture's lowest row.
pub fn write_pfm(file: &Path, size_px: [u32; 2], values: &[f32]) -> Result<(), FileError> {
    let failed = |error: std::io::Error| FileError::new(file, error);
    let mut writer = BufWriter::new(File::create(file).map_err(failed)?);
    // A negative scale says little-endian.
    write!(writer, "Pf\n{} {}\n-1.0\n", size_px[0], size_px[1]).map_err(failed)?;
    for row in values.chunks_exact(size_px[0].max(1) as usize).rev() {
        for value in row {
            writer.write_all(&value.to_le_bytes()).map_err(failed)?;
        }
    }
    writer.flush().map_err(failed)
}

/// Peak signal to noise of two pictures' RGB bytes, decibels; infinite where they are equal.
pub fn psnr_db(a: &[u32], b: &[u32]) -> f64 {
    let square = |(a, b): (&u32, &u32)| -> u64 {
        let (a, b) = (a.to_le_bytes(), b.to_le_bytes());
        (0..3)
            .map(|c| (a[c] as i64 - b[c] as i64).pow(2) as u64)
            .sum()
    };
    let sum: u64 = a.iter().zip(b).map(square).sum();
    let mean = sum as f64 / (3 * a.len().max(1)) as f64;
    10.0 * (255.0f64 * 255.0 / mean).log10()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A test's way to fail.
    use super::*;

    #[test]
    fn files_hold_what_was_drawn() {
        let folder = tempfile::tempdir().unwrap();
        let png_file = folder.path().join("a.png");
        write_png(&png_file, [2, 1], &[0xff_30_20_10, 0x00_60_50_40]).unwrap();
        let image = image::open(&png_file).unwrap().into_rgb8();
        assert_eq!(image.as_raw(), &[0x10, 0x20, 0x30, 0x40, 0x50, 0x60]);

        let depth = depth_metres(&[0, (0.5f32.to_bits() as u64) << 32 | 7], 0.1);
        assert_eq!(depth, [0.0, 0.2]);
        let pfm_file = folder.path().join("a.pfm");
        write_pfm(&pfm_file, [1, 2], &depth).unwrap();
        let bytes = std::fs::read(&pfm_file).unwrap();
        let (header, values) = bytes.split_at(bytes.len() - 8);
        assert_eq!(header, b"Pf\n1 2\n-1.0\n");
        assert_eq!(values[..4], 0.2f32.to_le_bytes());
        assert_eq!(values[4..], 0f32.to_le_bytes());
    }

    #[test]
    fn psnr_of_known_pictures() {
        assert_eq!(psnr_db(&[1, 2], &[1, 2]), f64::INFINITY);
        assert!((psnr_db(&[0], &[0x00_ff_ff_ff]) - 0.0).abs() < 1e-12);
    }
}
