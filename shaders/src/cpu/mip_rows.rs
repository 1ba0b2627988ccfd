//! One image's mips, from its rows as they are decoded: no more of the image is in memory than a
//! band of rows, and no mip but those that are kept.

use rayon::prelude::*;

use super::mask_cutoffs::AlphaCounts;
use super::srgb::{byte_from_unit, linear_from_byte, srgb_from_linear};
use super::texture::{Mips, halved, mip_count, texels};

/// RGBA in linear light, not rounded.
type Texel = [f32; 4];

/// The words of an image's mips from mip `dropped` on, each a box filter of the unrounded one
/// before: alpha as it is, colours in linear light and weighted by alpha, so that colours that a
/// masked texture hides do not bleed into those that it shows.
#[derive(Debug)]
pub struct MipRows {
    size: [u32; 2],
    dropped: u32,
    words: Vec<u32>,
    alpha_counts: AlphaCounts,
    /// Where the next row of mip 0 goes.
    next_word: usize,
    rows: u32,
    levels: Vec<Level>,
}

/// From one mip to the next.
#[derive(Debug)]
struct Level {
    size: [u32; 2],
    half: [u32; 2],
    columns: Vec<[(u32, f32); 3]>,
    /// Rows of the larger mip that are still needed.
    window: Vec<Texel>,
    /// Number of the window's first row.
    first_row: u32,
    /// Next row of the smaller mip.
    next_row: u32,
    /// Where the next row of the smaller mip goes, where it is kept.
    next_word: Option<usize>,
}

impl MipRows {
    /// For an image of `size`, neither side 0, without its first `dropped` mips, of which one is
    /// kept at least.
    pub fn new(size: [u32; 2], dropped: u32) -> Self {
        let mut next_word = if dropped == 0 { texels(size) } else { 0 };
        let mut levels = Vec::new();
        let mut mip = size;
        for level in 1..mip_count(size) {
            let half = halved(mip);
            let is_kept = level >= dropped;
            levels.push(Level {
                size: mip,
                half,
                columns: (0..half[0]).map(|x| covered(mip[0], half[0], x)).collect(),
                window: Vec::new(),
                first_row: 0,
                next_row: 0,
                next_word: is_kept.then_some(next_word),
            });
            next_word += if is_kept { texels(half) } else { 0 };
            mip = half;
        }
        Self {
            size,
            dropped,
            words: vec![0; next_word],
            alpha_counts: AlphaCounts::default(),
            next_word: 0,
            rows: 0,
            levels,
        }
    }

    /// Takes the next rows, four bytes a texel: whole rows, and no more than the image has.
    pub fn push(&mut self, rgba: &[u8]) {
        self.rows += (rgba.len() / 4 / self.size[0] as usize) as u32;
        debug_assert!(self.rows <= self.size[1]);
        self.alpha_counts.add(rgba);
        if self.dropped == 0 {
            let words = &mut self.words[self.next_word..];
            for (word, texel) in words.iter_mut().zip(rgba.chunks_exact(4)) {
                *word = u32::from_le_bytes([texel[0], texel[1], texel[2], texel[3]]);
            }
            self.next_word += rgba.len() / 4;
        }
        if self.levels.is_empty() {
            return;
        }
        let linear = |at: &[u8]| {
            let [r, g, b] = [at[0], at[1], at[2]].map(linear_from_byte);
            [r, g, b, at[3] as f32 / 255.0]
        };
        let mut rows: Vec<Texel> = rgba.par_chunks_exact(4).map(linear).collect();
        for level in &mut self.levels {
            rows = level.push(&rows);
            if let Some(next_word) = &mut level.next_word {
                let words = &mut self.words[*next_word..][..rows.len()];
                words.par_iter_mut().zip(&rows).for_each(|(word, texel)| {
                    let [r, g, b] = [texel[0], texel[1], texel[2]].map(srgb_from_linear);
                    *word = u32::from_le_bytes([r, g, b, texel[3]].map(byte_from_unit));
                });
                *next_word += rows.len();
            }
        }
    }

    /// Rows that are still to come.
    pub fn missing_rows(&self) -> u32 {
        self.size[1] - self.rows
    }

    /// The mips, once all rows came.
    pub fn finish(self) -> Mips {
        Mips {
            words: self.words,
            alpha_counts: self.alpha_counts,
        }
    }
}

impl Level {
    /// Takes rows of the larger mip; gives those of the smaller one that they complete.
    fn push(&mut self, rows: &[Texel]) -> Vec<Texel> {
        let width = self.size[0] as usize;
        self.window.extend_from_slice(rows);
        let end_row = self.first_row + (self.window.len() / width) as u32;
        let needs = |row: u32| covered(self.size[1], self.half[1], row);
        let is_whole = |&row: &u32| {
            let there = |&(row, share): &(u32, f32)| share == 0.0 || row < end_row;
            needs(row).iter().all(there)
        };
        let whole = (self.next_row..self.half[1]).take_while(is_whole).count() as u32;
        let done = self.next_row..self.next_row + whole;
        let mut mip = vec![[0.0; 4]; whole as usize * self.half[0] as usize];
        mip.par_chunks_mut(self.half[0] as usize)
            .zip(done.clone())
            .for_each(|(target, row)| self.reduce(needs(row), target));
        self.next_row = done.end;
        if self.next_row < self.half[1] {
            let first_row = needs(self.next_row)[0].0.min(end_row);
            let passed = (first_row - self.first_row) as usize * width;
            self.window.drain(..passed);
            self.first_row = first_row;
        } else {
            self.window = Vec::new();
            self.first_row = end_row;
        }
        mip
    }

    /// One row of the smaller mip, each texel the mean of the area that it covers: two texels a
    /// side, three with shares where a side is odd.
    fn reduce(&self, rows: [(u32, f32); 3], target: &mut [Texel]) {
        for (target, columns) in target.iter_mut().zip(&self.columns) {
            let (mut weighted, mut plain, mut alpha) = ([0.0; 3], [0.0; 3], 0.0);
            for (row, row_share) in rows {
                for (column, column_share) in *columns {
                    let share = row_share * column_share;
                    if share > 0.0 {
                        let row = (row - self.first_row) as usize * self.size[0] as usize;
                        let value = self.window[row + column as usize];
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
    }
}

/// The texels of a side of `size` under texel `at` of one of `half`, with their shares, which sum
/// to 1.
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
    use super::super::texture::mip_chain;
    use super::*;
    use proptest::prelude::*;

    fn noise(width: u32, height: u32) -> Vec<u8> {
        (0..width * height * 4)
            .map(|index| (super::super::hash::hash(index) >> 9) as u8)
            .collect()
    }

    proptest! {
        /// Light is neither won nor lost: the mean of the texels that each covers stays, whatever
        /// the size.
        #[test]
        fn reducing_keeps_the_mean(width in 1u32..40, height in 1u32..40) {
            let linear: Vec<Texel> = noise(width, height).chunks_exact(4)
                .map(|texel| [0, 1, 2, 3].map(|channel| texel[channel] as f32 / 255.0))
                .collect();
            let mean = |texels: &[Texel], channel: usize| {
                let covered = |texel: &Texel| texel[channel] * if channel < 3 { texel[3] } else { 1.0 };
                texels.iter().map(|texel| covered(texel) as f64).sum::<f64>() / texels.len() as f64
            };
            prop_assume!(width.max(height) > 1);
            let smaller = MipRows::new([width, height], 0).levels[0].push(&linear);
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

        /// However the rows come, the words are the same, and those without the top mips are the
        /// others' end.
        #[test]
        fn bands_and_dropped_mips_change_nothing(width in 1u32..40, height in 1u32..40, band in 1usize..9, dropped in 0u32..6) {
            let rgba = noise(width, height);
            let whole = mip_chain([width, height], &rgba, 0);
            let (whole, counts) = (whole.words, whole.alpha_counts);
            let dropped = dropped.min(mip_count([width, height]) - 1);
            let mut rows = MipRows::new([width, height], dropped);
            for band in rgba.chunks(4 * width as usize * band) {
                rows.push(band);
                let held: usize = rows.levels.iter().map(|level| level.window.len()).sum();
                // Two rows of each mip at most, beside those that the next row of the smaller one
                // waits for.
                prop_assert!(held <= 6 * width as usize + 64, "{held} texels held");
            }
            prop_assert_eq!(rows.missing_rows(), 0);
            let mips = rows.finish();
            let words = &mips.words;
            prop_assert_eq!(&words[..], &whole[whole.len() - words.len()..]);
            prop_assert_eq!(mips.alpha_counts, counts);
        }
    }
}
