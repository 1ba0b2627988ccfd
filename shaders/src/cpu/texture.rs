//! Decoded images to the texel buffer that `shade` and `raster_masked` sample: sRGB words, a chain of mips each.

use rayon::prelude::*;

use super::srgb::{byte_from_unit, linear_from_byte, srgb_from_linear};
use crate::types::TextureRecord;

/// The texel buffer and where each texture lies in it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Textures {
    /// One an image, in order.
    pub records: Vec<TextureRecord>,
    /// RGBA, a byte a channel, red lowest; RGB in sRGB.
    pub words: Vec<u32>,
    /// What was left out to keep to the limit, one line a texture.
    pub notes: Vec<String>,
}

/// Images that make no texel buffer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TextureError {
    /// Size and bytes disagree, or a side is 0.
    #[error(
        "texture {texture}: expected {width} x {height} texels, each side at least 1, 4 bytes a texel, found {bytes} bytes"
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
    let chains: Vec<Vec<u32>> = images
        .par_iter()
        .zip(&layout.dropped_mips)
        .map(|((width, height, rgba), &dropped)| mip_chain([*width, *height], rgba, dropped))
        .collect();
    Ok(Textures {
        records: layout.records,
        words: chains.concat(),
        notes: layout.notes,
    })
}

impl Layout {
    /// Lays textures of these sizes out one after another. Where `limit_words` does not hold all, the texture with most
    /// texels (the first of equals) loses its top mip until the rest fits.
    pub fn new(sizes: &[[u32; 2]], limit_words: usize) -> Result<Self, TextureError> {
        if let Some(texture) = sizes.iter().position(|size| size.contains(&0)) {
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
            layout.words += chain_words(kept);
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

fn texels(size: [u32; 2]) -> usize {
    size[0] as usize * size[1] as usize
}

fn halved(size: [u32; 2]) -> [u32; 2] {
    size.map(|side| (side / 2).max(1))
}

fn chain_words(size: [u32; 2]) -> usize {
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
    let mut words: usize = sizes.iter().map(|&size| chain_words(size)).sum();
    while words > limit_words {
        let largest = kept.iter_mut().rev().max_by_key(|(size, _)| texels(*size));
        match largest {
            Some((size, dropped)) if texels(*size) > 1 => {
                words -= texels(*size);
                *size = halved(*size);
                *dropped += 1;
            }
            _ => {
                return Err(TextureError::Limit {
                    textures: sizes.len(),
                    limit_words,
                });
            }
        }
    }
    Ok(kept)
}

/// The words of one image's mips from mip `dropped` on, each a box filter of the unrounded one before: alpha as it is,
/// colours in linear light and weighted by alpha, so that what a masked texture hides does not bleed into what it shows.
/// `rgba` holds four bytes a texel.
pub fn mip_chain(size: [u32; 2], rgba: &[u8], dropped: u32) -> Vec<u32> {
    let mut words = Vec::new();
    if dropped == 0 {
        words.extend(
            rgba.chunks_exact(4)
                .map(|texel| u32::from_le_bytes([texel[0], texel[1], texel[2], texel[3]])),
        );
    }
    let linear = |texel: usize| {
        let at = &rgba[texel * 4..texel * 4 + 4];
        let [r, g, b] = [at[0], at[1], at[2]].map(linear_from_byte);
        [r, g, b, at[3] as f32 / 255.0]
    };
    let mut mip_size = size;
    let mut mip = Vec::new();
    for level in 1..mip_count(size) {
        mip = match level {
            1 => reduced(mip_size, linear),
            _ => reduced(mip_size, |texel| mip[texel]),
        };
        mip_size = halved(mip_size);
        if level >= dropped {
            words.extend(mip.iter().map(|&[r, g, b, a]: &[f32; 4]| {
                let [r, g, b] = [r, g, b].map(srgb_from_linear);
                u32::from_le_bytes([r, g, b, a].map(byte_from_unit))
            }));
        }
    }
    words
}

/// Half the size, each texel the mean of the area that it covers: two texels a side, three with shares where a side is odd.
fn reduced(size: [u32; 2], texel: impl Fn(usize) -> [f32; 4] + Sync) -> Vec<[f32; 4]> {
    let half = halved(size);
    let columns: Vec<_> = (0..half[0]).map(|x| covered(size[0], half[0], x)).collect();
    let mut mip = vec![[0.0; 4]; texels(half)];
    mip.par_chunks_mut(half[0] as usize)
        .enumerate()
        .for_each(|(y, row)| {
            let rows = covered(size[1], half[1], y as u32);
            for (target, columns) in row.iter_mut().zip(&columns) {
                let (mut weighted, mut plain, mut alpha) = ([0.0; 3], [0.0; 3], 0.0);
                for (row, row_share) in rows {
                    for (column, column_share) in *columns {
                        let share = row_share * column_share;
                        if share > 0.0 {
                            let value = texel(row as usize * size[0] as usize + column as usize);
                            for channel in 0..3 {
                                weighted[channel] += value[channel] * value[3] * share;
                                plain[channel] += value[channel] * share;
                            }
                            alpha += value[3] * share;
                        }
                    }
                }
                let [r, g, b] = match alpha > 0.0 {
                    true => weighted.map(|sum: f32| sum / alpha),
                    false => plain,
                };
                *target = [r, g, b, alpha];
            }
        });
    mip
}

/// The texels of a side of `size` under texel `at` of one of `half`, with their shares, which sum to 1.
fn covered(size: u32, half: u32, at: u32) -> [(u32, f32); 3] {
    // In units of 1 / half texels: both ends and all borders are whole.
    let (size, half, at) = (size as u64, half as u64, at as u64);
    let (first, last) = (at * size, (at + 1) * size);
    std::array::from_fn(|offset| {
        let texel = first / half + offset as u64;
        let overlap = last
            .min((texel + 1) * half)
            .saturating_sub(first.max(texel * half));
        (texel as u32, overlap as f32 / size as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn noise(width: u32, height: u32) -> (u32, u32, Vec<u8>) {
        let rgba = (0..width * height * 4)
            .map(|index| (super::super::false_color::hash(index) >> 9) as u8)
            .collect();
        (width, height, rgba)
    }

    proptest! {
        /// Light is neither won nor lost: the mean of what each texel covers stays, whatever the size.
        #[test]
        fn reducing_keeps_the_mean(width in 1u32..40, height in 1u32..40) {
            let (_, _, rgba) = noise(width, height);
            let linear: Vec<_> = rgba.chunks_exact(4)
                .map(|texel| [0, 1, 2, 3].map(|channel| texel[channel] as f32 / 255.0))
                .collect();
            let mean = |texels: &[[f32; 4]], channel: usize| {
                let covered = |texel: &[f32; 4]| texel[channel] * if channel < 3 { texel[3] } else { 1.0 };
                texels.iter().map(|texel| covered(texel) as f64).sum::<f64>() / texels.len() as f64
            };
            let smaller = reduced([width, height], |texel| linear[texel]);
            for channel in 0..4 {
                prop_assert!((mean(&smaller, channel) - mean(&linear, channel)).abs() < 1e-5);
            }
        }

        #[test]
        fn shares_sum_to_one(size in 1u32..5000, at in 0u32..2500) {
            let half = (size / 2).max(1);
            let at = at % half;
            let shares = covered(size, half, at);
            prop_assert!((shares.iter().map(|(_, share)| share).sum::<f32>() - 1.0).abs() < 1e-6);
            prop_assert!(shares.iter().all(|&(texel, share)| texel < size || share == 0.0));
        }
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
            next += chain_words([image.0, image.1]) as u32;
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
