//! Decoded images to the texel buffer that `shade` and `raster_masked` sample: sRGB words, a chain of mips each.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use super::mask_cutoffs::AlphaCounts;
use super::mip_rows::MipRows;
use crate::types::TextureRecord;

/// Longest side of a texture, texels: sums over all textures stay within 64 bits.
const MOST_SIDE: u32 = 65_535;
/// Rows that are reduced at once.
const BAND_ROWS: usize = 64;

/// An image's mips.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Mips {
    /// Their words, the largest first.
    pub words: Vec<u32>,
    /// Alphas of the image that they were made of.
    pub alpha_counts: AlphaCounts,
}

/// The texel buffer and where each texture lies in it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Textures {
    /// One an image, in order.
    pub records: Vec<TextureRecord>,
    /// RGBA, a byte a channel, red lowest; RGB in sRGB. Tables of cutoffs behind them.
    pub words: Vec<u32>,
    /// Alphas of each image.
    pub alpha_counts: Vec<AlphaCounts>,
    /// What was left out to keep to the limit, one line a texture.
    pub notes: Vec<String>,
}

/// Images that make no texel buffer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TextureError {
    /// Size and bytes disagree, or a side is 0 or too long.
    #[error(
        "texture {texture}: expected {width} x {height} texels, each side 1 to 65535, 4 bytes a texel, found {bytes} bytes"
    )]
    Size {
        /// Index of the image.
        texture: usize,
        /// Claimed width.
        width: u32,
        /// Claimed height.
        height: u32,
        /// Bytes there.
        bytes: usize,
    },
    /// Not even one texel a texture fits.
    #[error(
        "texel buffer: expected at least {textures} words for as many textures, found a limit of {limit_words}"
    )]
    Limit {
        /// Textures.
        textures: usize,
        /// Words allowed.
        limit_words: usize,
    },
}

/// Where textures lie in the texel buffer, and how many of their top mips were left out.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Layout {
    /// One a texture, in order.
    pub records: Vec<TextureRecord>,
    /// Top mips left out of each texture.
    pub dropped_mips: Vec<u32>,
    /// Words of all.
    pub words: usize,
    /// What was left out to keep to the limit, one line a texture.
    pub notes: Vec<String>,
}

/// Builds records and texels of `images` (width, height, RGBA bytes in rows from the top): [`Layout::new`] and
/// [`mip_chain`] for all at once.
pub fn build_textures(
    images: &[(u32, u32, Vec<u8>)],
    limit_words: usize,
) -> Result<Textures, TextureError> {
    let sizes: Vec<_> = images
        .iter()
        .map(|&(width, height, _)| [width, height])
        .collect();
    for (texture, (size, image)) in sizes.iter().zip(images).enumerate() {
        if texels(*size).checked_mul(4) != Some(image.2.len()) {
            return Err(size_error(texture, *size, image.2.len()));
        }
    }
    let layout = Layout::new(&sizes, limit_words)?;
    let chains: Vec<Mips> = images
        .par_iter()
        .zip(&layout.dropped_mips)
        .map(|((width, height, rgba), &dropped)| mip_chain([*width, *height], rgba, dropped))
        .collect();
    let mut textures = Textures {
        records: layout.records,
        notes: layout.notes,
        ..Textures::default()
    };
    for mips in chains {
        textures.words.extend(mips.words);
        textures.alpha_counts.push(mips.alpha_counts);
    }
    Ok(textures)
}

impl Layout {
    /// Lays textures of these sizes out one after another. Where `limit_words` does not hold all, the texture with most
    /// texels (the first of equals) loses its top mip until the rest fits.
    pub fn new(sizes: &[[u32; 2]], limit_words: usize) -> Result<Self, TextureError> {
        let is_wrong = |size: &[u32; 2]| size.iter().any(|side| !(1..=MOST_SIDE).contains(side));
        if let Some(texture) = sizes.iter().position(is_wrong) {
            return Err(size_error(texture, sizes[texture], 0));
        }
        // Records count words in 32 bits.
        let kept = shrink_to_fit(sizes, limit_words.min(u32::MAX as usize))?;
        let mut layout = Self::default();
        for (texture, (&size, &(kept, dropped))) in sizes.iter().zip(&kept).enumerate() {
            layout.records.push(TextureRecord {
                first_word: layout.words as u32,
                width: kept[0],
                height: kept[1],
                mip_count: mip_count(kept),
            });
            layout.dropped_mips.push(dropped);
            layout.words += mip_words(kept);
            if dropped > 0 {
                layout.notes.push(format!(
                    "texture {texture}: {} x {} reduced to {} x {} to keep to {limit_words} texels",
                    size[0], size[1], kept[0], kept[1]
                ));
            }
        }
        Ok(layout)
    }
}

/// Mips of a texture down to 1 x 1.
pub fn mip_count(size: [u32; 2]) -> u32 {
    32 - size[0].max(size[1]).leading_zeros()
}

fn size_error(texture: usize, [width, height]: [u32; 2], bytes: usize) -> TextureError {
    TextureError::Size {
        texture,
        width,
        height,
        bytes,
    }
}

pub(super) fn texels(size: [u32; 2]) -> usize {
    size[0] as usize * size[1] as usize
}

/// Size of the next mip.
pub fn halved(size: [u32; 2]) -> [u32; 2] {
    size.map(|side| (side / 2).max(1))
}

/// Words of a texture of `size` with all its mips.
pub fn mip_words(size: [u32; 2]) -> usize {
    std::iter::successors(Some(size), |&mip| Some(halved(mip)))
        .take(mip_count(size) as usize)
        .map(texels)
        .sum()
}

/// The size that each texture keeps, and how many top mips that costs.
fn shrink_to_fit(
    sizes: &[[u32; 2]],
    limit_words: usize,
) -> Result<Vec<([u32; 2], u32)>, TextureError> {
    let mut kept: Vec<_> = sizes.iter().map(|&size| (size, 0)).collect();
    let mut words: usize = sizes.iter().map(|&size| mip_words(size)).sum();
    let turns = sizes.iter().enumerate();
    let mut largest: BinaryHeap<_> = turns
        .map(|(texture, &size)| (texels(size), Reverse(texture)))
        .collect();
    while words > limit_words {
        let top = largest.pop().filter(|&(texels, _)| texels > 1);
        let (top_words, Reverse(texture)) = top.ok_or(TextureError::Limit {
            textures: sizes.len(),
            limit_words,
        })?;
        let (size, dropped) = &mut kept[texture];
        words -= top_words;
        *size = halved(*size);
        *dropped += 1;
        largest.push((texels(*size), Reverse(texture)));
    }
    Ok(kept)
}

/// [`MipRows`] of an image that is in memory. `rgba` holds four bytes a texel.
pub fn mip_chain(size: [u32; 2], rgba: &[u8], dropped: u32) -> Mips {
    let mut rows = MipRows::new(size, dropped);
    for band in rgba.chunks(BAND_ROWS * 4 * size[0] as usize) {
        rows.push(band);
    }
    rows.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(width: u32, height: u32) -> (u32, u32, Vec<u8>) {
        let rgba = (0..width * height * 4)
            .map(|index| (super::super::hash::hash(index) >> 9) as u8)
            .collect();
        (width, height, rgba)
    }

    #[test]
    fn chain_reaches_one_texel_of_the_mean_light() {
        let chain = |left: [u8; 4], right: [u8; 4]| {
            let textures = build_textures(&[(2, 1, [left, right].concat())], 100).unwrap();
            assert_eq!(textures.records[0].mip_count, 2);
            assert!(textures.notes.is_empty());
            textures.words[2].to_le_bytes()
        };
        // Black and white: half the light is sRGB 188, not 128. Alpha is no light: 128.
        assert_eq!(chain([0, 0, 0, 255], [255; 4]), [188, 188, 188, 255]);
        assert_eq!(chain([90, 80, 70, 255], [90, 80, 70, 0]), [90, 80, 70, 128]);
        // Clear texels lend no colour, unless all are clear.
        assert_eq!(chain([0, 0, 0, 0], [255; 4]), [255, 255, 255, 128]);
        assert_eq!(chain([0, 0, 0, 0], [255, 255, 255, 0]), [188, 188, 188, 0]);
    }

    #[test]
    fn records_follow_each_other_without_gap() {
        let images = [noise(5, 3), noise(1, 1), noise(16, 4)];
        let textures = build_textures(&images, 1000).unwrap();
        let mut next = 0;
        for (record, image) in textures.records.iter().zip(&images) {
            assert_eq!(
                (record.first_word, record.width, record.height),
                (next, image.0, image.1)
            );
            next += mip_words([image.0, image.1]) as u32;
        }
        assert_eq!(textures.words.len() as u32, next);
        assert_eq!(textures.records[0].mip_count, 3);
    }

    #[test]
    fn limit_drops_top_mips_of_the_largest_and_says_so() {
        let images = [noise(4, 4), noise(16, 16), noise(8, 8)];
        let whole = build_textures(&images, 10_000).unwrap();
        let limited = build_textures(&images, 200).unwrap();
        assert!(
            limited.words.len() <= 200 && limited.notes.len() == 1,
            "{:?}",
            limited.notes
        );
        assert_eq!(limited.records[1].width, 8);
        let (all, fewer) = (
            whole.records[1].first_word as usize,
            limited.records[1].first_word as usize,
        );
        assert_eq!(
            whole.words[all + 256..all + 341],
            limited.words[fewer..fewer + 85]
        );
        assert!(matches!(
            build_textures(&images, 2),
            Err(TextureError::Limit { .. })
        ));
    }

    #[test]
    fn sizes_that_disagree_are_named() {
        assert!(matches!(
            build_textures(&[noise(1, 1), (2, 2, vec![0; 15])], 100),
            Err(TextureError::Size {
                texture: 1,
                bytes: 15,
                ..
            })
        ));
        assert!(build_textures(&[(0, 0, Vec::new())], 100).is_err());
        assert_eq!(build_textures(&[], 0).unwrap(), Textures::default());
    }
}
