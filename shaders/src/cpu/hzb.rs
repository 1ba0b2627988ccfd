//! Twin of `wgsl/build_hzb.wgsl`: the pyramid of farthest depths.

/// Levels 1, 2… of a picture's depths. A texel of level L is the farthest depth, as bits, of its
/// 2^L x 2^L pixels; sides are rounded up, and the last level is a single texel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hzb {
    size_px: [u32; 2],
    /// The levels, one after the other, in rows.
    pub texels: Vec<u32>,
}

/// Sides of a level, rounded up.
pub fn hzb_size(size_px: [u32; 2], level: u32) -> [u32; 2] {
    size_px.map(|size| size.div_ceil(1 << level))
}

/// The level of a single texel, at least 1.
pub fn hzb_top(size_px: [u32; 2]) -> u32 {
    let longer = size_px[0].max(size_px[1]);
    longer.next_power_of_two().ilog2().max(1)
}

/// Texels of all levels.
pub fn hzb_texels(size_px: [u32; 2]) -> usize {
    (1..=hzb_top(size_px))
        .map(|level| hzb_size(size_px, level).map(|side| side as usize))
        .map(|[width, height]| width * height)
        .sum()
}

/// First texel of a level.
pub fn hzb_first(size_px: [u32; 2], level: u32) -> usize {
    (1..level)
        .map(|below| hzb_size(size_px, below).map(|side| side as usize))
        .map(|[width, height]| width * height)
        .sum()
}

impl Hzb {
    /// The pyramid of a visbuffer's depths.
    pub fn new(visbuffer: &[u64], size_px: [u32; 2]) -> Self {
        let mut below: Vec<u32> = visbuffer.iter().map(|word| (word >> 32) as u32).collect();
        let mut below_size = size_px;
        let mut texels = Vec::with_capacity(hzb_texels(size_px));
        for level in 1..=hzb_top(size_px) {
            let [width, height] = hzb_size(size_px, level);
            let bits = |x: u32, y: u32| {
                let columns = 2 * x..(2 * x + 2).min(below_size[0]);
                let rows = 2 * y..(2 * y + 2).min(below_size[1]);
                let pixels = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
                pixels
                    .map(|(x, y)| below[(y * below_size[0] + x) as usize])
                    .min()
                    .unwrap_or(u32::MAX)
            };
            let texels_of_level: Vec<u32> = (0..height)
                .flat_map(|y| (0..width).map(move |x| (x, y)))
                .map(|(x, y)| bits(x, y))
                .collect();
            texels.extend(&texels_of_level);
            (below, below_size) = (texels_of_level, [width, height]);
        }
        Self { size_px, texels }
    }

    /// Bits of a texel of a level, from 1 on.
    pub fn texel(&self, level: u32, x: u32, y: u32) -> u32 {
        let width = hzb_size(self.size_px, level)[0];
        self.texels[hzb_first(self.size_px, level) + (y * width + x) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every texel of every level against all its pixels.
    #[test]
    fn a_texel_is_the_farthest_of_its_pixels_at_any_size() {
        for size_px in [[1, 1], [63, 64], [64, 65], [65, 1], [2, 130], [257, 100]] {
            let [width, height] = size_px;
            let depth = |x: u32, y: u32| x.wrapping_mul(2_654_435_761).wrapping_add(y * 40_503);
            let word = |index: u32| u64::from(depth(index % width, index / width)) << 32 | 7;
            let visbuffer: Vec<u64> = (0..width * height).map(word).collect();
            let hzb = Hzb::new(&visbuffer, size_px);
            assert_eq!(hzb.texels.len(), hzb_texels(size_px));
            let top = hzb_top(size_px);
            assert_eq!(hzb_size(size_px, top), [1, 1]);
            for level in 1..=top {
                let [columns, rows] = hzb_size(size_px, level);
                for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
                    let farthest = (0..height)
                        .flat_map(|py| (0..width).map(move |px| (px, py)))
                        .filter(|&(px, py)| px >> level == x && py >> level == y)
                        .map(|(px, py)| depth(px, py))
                        .min();
                    assert_eq!(
                        Some(hzb.texel(level, x, y)),
                        farthest,
                        "{size_px:?} {level}"
                    );
                }
            }
        }
    }
}
