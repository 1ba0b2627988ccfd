//! How far one picture is from another: PSNR over colours, and where the coverage of two depth images differs.

use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

/// Why two pictures cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// A file that is not there or not readable.
    #[error("{path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file of another kind.
    #[error("{path}: expected {expected}, found {found}")]
    Content {
        /// The file.
        path: PathBuf,
        /// What it has to be.
        expected: &'static str,
        /// What it is.
        found: String,
    },
    /// Pictures of different sizes.
    #[error("expected pictures of one size, found {0:?} and {1:?} pixels")]
    Sizes([usize; 2], [usize; 2]),
}

/// Colours, three bytes a pixel, rows from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Width and height, pixels.
    pub size_px: [usize; 2],
    /// RGB.
    pub rgb: Vec<u8>,
}

/// View-space depth in metres, 0 where nothing was hit, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthImage {
    /// Width and height, pixels.
    pub size_px: [usize; 2],
    /// Metres.
    pub depth_metres: Vec<f32>,
}

/// The figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Peak signal-to-noise ratio over all colour bytes, dB; left out for equal pictures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr_db: Option<f64>,
    /// The same over the pixels that the reference covers alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr_covered_db: Option<f64>,
    /// Largest difference of a colour byte.
    pub largest_difference: u8,
    /// Pixels that the reference covers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub covered_px: Option<usize>,
    /// Pixels that exactly one of the two covers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coverage_differs_px: Option<usize>,
    /// Covered pixels of the reference beside an uncovered one, and the other way round: its silhouette.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub silhouette_px: Option<usize>,
    /// Differing pixels a pixel of the picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coverage_differs_share: Option<f64>,
}

impl Picture {
    /// Reads a PNG of eight bits a channel, RGB or RGBA.
    pub fn read(path: &Path) -> Result<Self, CompareError> {
        let wrong = |found: String| CompareError::Content {
            path: path.into(),
            expected: "a PNG of 8-bit RGB or RGBA",
            found,
        };
        let file = fs::File::open(path).map_err(|source| CompareError::Read {
            path: path.into(),
            source,
        })?;
        let decoder = png::Decoder::new(std::io::BufReader::new(file));
        let mut reader = decoder
            .read_info()
            .map_err(|error| wrong(error.to_string()))?;
        let bytes = reader
            .output_buffer_size()
            .ok_or_else(|| wrong("a picture too large to read".into()))?;
        let mut pixels = vec![0; bytes];
        let info = reader
            .next_frame(&mut pixels)
            .map_err(|error| wrong(error.to_string()))?;
        let channels = match (info.color_type, info.bit_depth) {
            (png::ColorType::Rgb, png::BitDepth::Eight) => 3,
            (png::ColorType::Rgba, png::BitDepth::Eight) => 4,
            (color, depth) => return Err(wrong(format!("{color:?} of {depth:?} bits"))),
        };
        let rgb = pixels[..info.buffer_size()]
            .chunks_exact(channels)
            .flat_map(|pixel| pixel[..3].to_vec())
            .collect();
        Ok(Self {
            size_px: [info.width as usize, info.height as usize],
            rgb,
        })
    }
}

impl DepthImage {
    /// Reads a one-channel PFM, whose rows run from the bottom.
    pub fn read(path: &Path) -> Result<Self, CompareError> {
        let wrong = |found: &str| CompareError::Content {
            path: path.into(),
            expected: "a one-channel PFM: `Pf`, width and height, scale, then floats",
            found: found.into(),
        };
        let bytes = fs::read(path).map_err(|source| CompareError::Read {
            path: path.into(),
            source,
        })?;
        let mut rest = bytes.as_slice();
        let mut word = || -> Option<String> {
            let end = rest.iter().position(u8::is_ascii_whitespace)?;
            let word = String::from_utf8_lossy(&rest[..end]).into_owned();
            rest = &rest[end + 1..];
            Some(word)
        };
        let mut field = || word().ok_or_else(|| wrong("a shorter header"));
        let (kind, width, height, scale) = (field()?, field()?, field()?, field()?);
        if kind != "Pf" {
            return Err(wrong(&kind));
        }
        let size = |text: &str| {
            text.parse::<usize>()
                .ok()
                .filter(|size| (1..=1 << 16).contains(size))
        };
        let (Some(width), Some(height)) = (size(&width), size(&height)) else {
            return Err(wrong(&format!("{width} x {height} pixels")));
        };
        let little = scale.parse::<f32>().map_err(|_| wrong(&scale))? < 0.0;
        if rest.len() != width * height * 4 {
            return Err(wrong(&format!("{} bytes of pixels", rest.len())));
        }
        let value = |bytes: &[u8]| {
            let bytes = [bytes[0], bytes[1], bytes[2], bytes[3]];
            if little {
                f32::from_le_bytes(bytes)
            } else {
                f32::from_be_bytes(bytes)
            }
        };
        let depth_metres = rest
            .chunks_exact(width * 4)
            .rev()
            .flat_map(|row| row.chunks_exact(4).map(value))
            .collect();
        Ok(Self {
            size_px: [width, height],
            depth_metres,
        })
    }
}

/// Compares `picture` with `reference`, and their depth images where both are there.
pub fn compare(
    picture: &Picture,
    reference: &Picture,
    depths: Option<(&DepthImage, &DepthImage)>,
) -> Result<Comparison, CompareError> {
    let same = |a: [usize; 2], b: [usize; 2]| {
        if a == b {
            Ok(())
        } else {
            Err(CompareError::Sizes(a, b))
        }
    };
    same(picture.size_px, reference.size_px)?;
    let all = vec![true; picture.rgb.len() / 3];
    let largest_difference = picture
        .rgb
        .iter()
        .zip(&reference.rgb)
        .map(|(a, b)| a.abs_diff(*b))
        .max()
        .unwrap_or(0);
    let mut comparison = Comparison {
        psnr_db: psnr_db(picture, reference, &all),
        psnr_covered_db: None,
        largest_difference,
        covered_px: None,
        coverage_differs_px: None,
        silhouette_px: None,
        coverage_differs_share: None,
    };
    if let Some((depth, reference_depth)) = depths {
        same(depth.size_px, picture.size_px)?;
        same(reference_depth.size_px, picture.size_px)?;
        let mask = |image: &DepthImage| {
            image
                .depth_metres
                .iter()
                .map(|&depth| depth > 0.0)
                .collect::<Vec<_>>()
        };
        let (shown, covered) = (mask(depth), mask(reference_depth));
        let differs = shown.iter().zip(&covered).filter(|(a, b)| a != b).count();
        comparison.psnr_covered_db = psnr_db(picture, reference, &covered);
        comparison.covered_px = Some(covered.iter().filter(|&&covered| covered).count());
        comparison.coverage_differs_px = Some(differs);
        comparison.silhouette_px = Some(silhouette_px(&covered, picture.size_px[0]));
        comparison.coverage_differs_share = Some(differs as f64 / covered.len() as f64);
    }
    Ok(comparison)
}

fn psnr_db(picture: &Picture, reference: &Picture, mask: &[bool]) -> Option<f64> {
    let pixels = picture
        .rgb
        .chunks_exact(3)
        .zip(reference.rgb.chunks_exact(3))
        .zip(mask)
        .filter(|(_, counted)| **counted);
    let (mut sum, mut count) = (0u64, 0u64);
    for ((a, b), _) in pixels {
        sum += a
            .iter()
            .zip(b)
            .map(|(a, b)| (a.abs_diff(*b) as u64).pow(2))
            .sum::<u64>();
        count += 3;
    }
    (sum > 0).then(|| 10.0 * (255.0f64.powi(2) * count as f64 / sum as f64).log10())
}

fn silhouette_px(covered: &[bool], width: usize) -> usize {
    (0..covered.len())
        .filter(|&pixel| {
            let right = (pixel % width + 1 < width).then(|| covered[pixel + 1]);
            let below = covered.get(pixel + width).copied();
            right.is_some_and(|value| value != covered[pixel])
                || below.is_some_and(|value| value != covered[pixel])
        })
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_differences() -> Result<(), CompareError> {
        let reference = Picture {
            size_px: [2, 2],
            rgb: vec![100; 12],
        };
        let mut picture = reference.clone();
        assert_eq!(compare(&picture, &reference, None)?.psnr_db, None);
        picture.rgb[0] = 110;
        let depth = |values: [f32; 4]| DepthImage {
            size_px: [2, 2],
            depth_metres: values.into(),
        };
        let depths = (&depth([1.0, 1.0, 0.0, 0.0]), &depth([1.0, 0.0, 0.0, 0.0]));
        let found = compare(&picture, &reference, Some(depths))?;
        // One byte of twelve is off by 10: MSE 100 / 12; of the one covered pixel: 100 / 3.
        let expected = |mse: f64| 10.0 * (65025.0 / mse).log10();
        assert!((found.psnr_db.unwrap_or(0.0) - expected(100.0 / 12.0)).abs() < 1e-9);
        assert!((found.psnr_covered_db.unwrap_or(0.0) - expected(100.0 / 3.0)).abs() < 1e-9);
        assert_eq!(
            (
                found.largest_difference,
                found.covered_px,
                found.coverage_differs_px
            ),
            (10, Some(1), Some(1))
        );
        assert_eq!(
            (found.silhouette_px, found.coverage_differs_share),
            (Some(1), Some(0.25))
        );
        Ok(())
    }
}
