//! The alpha that masked materials cut at, mip by mip: the share of a texture that passes stays
//! what it is in the image, so that foliage neither vanishes nor swells with distance.
//!
//! Castaño ("Computing alpha mipmaps", 2010) scales the alpha of each mip so that the same share of
//! it passes the cutoff. Here the cutoff is scaled instead: materials of different cutoffs may
//! share a texture, opaque ones see their alpha as it is, and nothing is rounded to eight bits or
//! clamped. The shares are those of the samples that drawing takes: the mean of four, bilinear in
//! two mips. Where no cutoff lets nearly that share pass, since a regular pattern has become one
//! alpha, each texel counts as a little more or less.
//!
//! A table holds a cutoff for each quarter of a mip, from mip 0 on, as the bits of f32 behind the
//! texels; a negative one is for alpha with that noise.

use glam::Vec2;
use rayon::prelude::*;

use super::sample_texture::mask_alpha;
use super::texture::{Mips, Textures};
use crate::types::{MaterialRecord, NO_MASK_CUTOFFS, NO_TEXTURE, TextureRecord, material_flag};

/// Share of full alpha by which a fragment may lie below the cutoff and still be kept: alpha is the
/// result of f32 products and interpolation, and cutoffs are written with three digits. A sixteenth
/// of a step of eight bits: texels of one step less stay hidden.
pub const ALPHA_SLACK: f32 = 1.0 / 4096.0;
/// Half a step of eight bits, in which vertices keep their alpha: what an author's may have been
/// more.
pub const VERTEX_ALPHA_SLACK: f32 = 0.5 / 255.0;
/// Pixels from a pixel's middle, along both axes, to the four places where a mask looks its alpha
/// up.
pub const MASK_SPREAD_PX: f32 = 0.35;
/// Share of its alpha by which a texel of a mip may count as more or less, twice.
pub const MASK_NOISE: f32 = 0.25;
/// Entries of a table a mip.
pub const ENTRIES_A_MIP: u32 = 4;
/// Share of the cover by which a mip may miss it before noise is taken.
const MOST_MISSED: f64 = 0.03;
/// Samples that an entry is measured with.
const SAMPLES: u32 = 1 << 13;

/// Texels of the image of each alpha.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AlphaCounts([u64; 256]);

impl Default for AlphaCounts {
    fn default() -> Self {
        Self([0; 256])
    }
}

impl AlphaCounts {
    /// Counts texels of four bytes.
    pub fn add(&mut self, rgba: &[u8]) {
        for texel in rgba.chunks_exact(4) {
            self.0[texel[3] as usize] += 1;
        }
    }

    fn texels(&self) -> u64 {
        self.0.iter().sum()
    }

    /// Share of the texels whose alpha passes `cutoff`.
    fn share(&self, cutoff: f32) -> f64 {
        let passes = |(alpha, _): &(usize, &u64)| *alpha as f32 / 255.0 + ALPHA_SLACK >= cutoff;
        let passing = self.0.iter().enumerate().filter(passes);
        passing.map(|(_, &count)| count).sum::<u64>() as f64 / self.texels().max(1) as f64
    }
}

/// The mean of a texture for `material`, as [`MaterialRecord::mean_texel`] has it. `mips` ends with
/// the mip of one texel.
pub fn mean_texel(mips: &Mips, material: &MaterialRecord) -> u32 {
    let mean = mips.words.last().copied().unwrap_or(u32::MAX);
    let share = match has_mask_cutoffs(material) {
        true => mips
            .alpha_counts
            .share(material.alpha_cutoff / material.base_color[3]),
        false => 1.0,
    };
    let [red, green, blue, _] = mean.to_le_bytes();
    u32::from_le_bytes([red, green, blue, (share * 255.0).round() as u8])
}

/// Whether the material cuts by the alpha of its texture.
pub fn has_mask_cutoffs(material: &MaterialRecord) -> bool {
    material.flags & material_flag::MASK != 0
        && material.texture != NO_TEXTURE
        && material.base_color[3] > 0.0
}

/// Entries of the table of a texture.
pub fn table_entries(record: &TextureRecord) -> u32 {
    ENTRIES_A_MIP * (record.mip_count - 1) + 1
}

/// Gives each material that needs one a place for its table, from word `first` of the texels on.
/// Returns the first word behind the last table.
pub fn place_tables(
    materials: &mut [MaterialRecord],
    records: &[TextureRecord],
    first: usize,
) -> usize {
    let mut next = first;
    for material in materials {
        material.mask_cutoffs = NO_MASK_CUTOFFS;
        let record = records.get(material.texture as usize);
        let Some(record) = record.filter(|_| has_mask_cutoffs(material)) else {
            continue;
        };
        let end = next + table_entries(record) as usize;
        // Words are numbered in 32 bits, the last number of which means none.
        if end < NO_MASK_CUTOFFS as usize {
            material.mask_cutoffs = next as u32;
            next = end;
        }
    }
    next
}

/// The table of a material: `mips` holds the words of its texture alone, `counts` are the image's.
pub fn mask_cutoffs(
    mips: &[u32],
    record: &TextureRecord,
    counts: &AlphaCounts,
    material: &MaterialRecord,
) -> Vec<f32> {
    let factor = material.base_color[3];
    let share = counts.share(material.alpha_cutoff / factor);
    let record = TextureRecord {
        first_word: 0,
        ..*record
    };
    let cutoff_at = |entry: u32| {
        let lod = entry as f32 / ENTRIES_A_MIP as f32;
        let texels_a_pixel = lod.exp2();
        let dx = Vec2::new(texels_a_pixel / record.width as f32, 0.0);
        let dy = Vec2::new(0.0, texels_a_pixel / record.height as f32);
        let flags = material.flags;
        let cut = |noise: f32| {
            let sample = |number| {
                let at = [place(number), dx, dy];
                mask_alpha(mips, &record, flags, at, lod, noise)
            };
            let mut alphas: Vec<f32> = (0..SAMPLES).map(sample).collect();
            let cutoff = cutoff_of_share(&mut alphas, share, material.alpha_cutoff / factor);
            let passing = alphas.partition_point(|&alpha| alpha >= cutoff);
            (factor * cutoff, passing as f64 / alphas.len() as f64)
        };
        let (cutoff, passing) = cut(0.0);
        // Noise only where it is needed: it shows.
        match (passing - share).abs() <= MOST_MISSED * share {
            true => cutoff,
            false => -cut(1.0).0,
        }
    };
    let mut cutoffs = vec![material.alpha_cutoff; table_entries(&record) as usize];
    // The first entry stays as written where mip 0 is the image itself: what is magnified shows it.
    let is_whole = counts.texels() == record.width as u64 * record.height as u64;
    let coarser = cutoffs.par_iter_mut().enumerate().skip(is_whole as usize);
    coarser.for_each(|(entry, cutoff)| *cutoff = cutoff_at(entry as u32));
    cutoffs
}

/// A sequence that fills the unit square evenly (Roberts, "The unreasonable effectiveness of
/// quasirandom sequences", 2018).
fn place(number: u32) -> Vec2 {
    const STEPS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];
    let at = STEPS.map(|step| (0.5 + number as f64 * step).fract() as f32);
    Vec2::from(at)
}

/// The cutoff that lets the nearest to `share` of the alphas pass, and of those the nearest to
/// `written`: vertices have an alpha of their own, which is cut by it too. Equal alphas pass
/// together or not at all.
fn cutoff_of_share(alphas: &mut [f32], share: f64, written: f32) -> f32 {
    /// Part of a gap on both its sides in which rounding may decide.
    const SIDE: f32 = 0.25;
    /// The same of an alpha without a gap.
    const ROUNDING: f32 = 0.01;
    alphas.sort_unstable_by(|a, b| b.total_cmp(a));
    let wanted = share * alphas.len() as f64;
    let Some(&last) = alphas.get((wanted.round() as usize).max(1) - 1) else {
        return written;
    };
    let before = alphas.partition_point(|&alpha| alpha > last);
    let through = alphas.partition_point(|&alpha| alpha >= last);
    let passing = match wanted - before as f64 >= through as f64 - wanted {
        true => through,
        false => before,
    };
    match (passing.checked_sub(1), alphas.get(passing)) {
        (None, _) => written.max(alphas[0] * (1.0 + ROUNDING)),
        (Some(at), None) => written.min(alphas[at] * (1.0 - ROUNDING)),
        (Some(at), Some(&next)) => {
            let side = SIDE * (alphas[at] - next);
            written.max(next + side).min(alphas[at] - side)
        }
    }
}

impl Textures {
    /// Appends the tables of `materials`, and tells them where they lie.
    pub fn add_mask_cutoffs(&mut self, materials: &mut [MaterialRecord]) {
        let end = place_tables(materials, &self.records, self.words.len());
        let texels = self.words.len();
        self.words.resize(end, 0);
        for material in materials {
            if material.mask_cutoffs == NO_MASK_CUTOFFS {
                continue;
            }
            let texture = material.texture as usize;
            let record = &self.records[texture];
            let mips = &self.words[record.first_word as usize..texels];
            let cutoffs = mask_cutoffs(mips, record, &self.alpha_counts[texture], material);
            let table = &mut self.words[material.mask_cutoffs as usize..][..cutoffs.len()];
            for (word, cutoff) in table.iter_mut().zip(cutoffs) {
                *word = cutoff.to_bits();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_share_passes() {
        let cutoff = |alphas: &[f32], share| cutoff_of_share(&mut alphas.to_vec(), share, 0.5);
        let near = |found: f32, expected: f32| (found - expected).abs() < 1e-6;
        let alphas = [0.1, 0.9, 0.5, 0.3];
        assert!(cutoff(&alphas, 0.0) > 0.9);
        assert!(near(cutoff(&alphas, 0.25), 0.6));
        assert!(near(cutoff(&alphas, 0.5), 0.45));
        assert!(cutoff(&alphas, 1.0) < 0.1);
        // Equals: all or none, whichever is nearer; the written cutoff where it does that.
        assert_eq!(cutoff(&[0.2; 8], 0.13), 0.5);
        assert!(cutoff(&[0.2; 8], 0.6) < 0.2);
        assert_eq!(cutoff(&[1.0; 8], 1.0), 0.5);
        assert!(cutoff(&[1.0; 8], 0.0) > 1.0);
        assert!(cutoff(&[0.2, 0.2, 0.2, 0.8], 0.9) < 0.2);
        assert_eq!(cutoff(&[0.2, 0.2, 0.2, 0.8], 0.4), 0.5);
        assert_eq!(cutoff(&[], 0.4), 0.5);
    }

    #[test]
    fn shares_of_an_image_count_the_cutoff_itself() {
        let mut counts = AlphaCounts::default();
        counts.add(&[0, 0, 0, 127, 0, 0, 0, 128, 0, 0, 0, 255, 0, 0, 0, 0]);
        assert_eq!(counts.share(0.5), 0.5);
        assert_eq!(counts.share(128.0 / 255.0), 0.5);
        assert_eq!(counts.share(127.0 / 255.0), 0.75);
        assert_eq!(counts.share(0.0), 1.0);
        assert_eq!(counts.share(1.0), 0.25);
        assert_eq!(counts.share(1.1), 0.0);
    }
}
