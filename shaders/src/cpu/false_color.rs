//! Colours of the diagnostic pictures, sRGB bytes in a word. Twin of `wgsl/shared/false_color.wgsl`, exact.

use super::hash::hash;

/// Pixels that nothing covers.
pub const EMPTY_COLOR: u32 = 0xff1c_1818;
/// Drawn by the hardware rasterizer.
pub const HARDWARE_COLOR: u32 = 0xff3c_8ce6;
/// Drawn by the compute rasterizer.
/// Instances below a pixel.
pub const POINT_COLOR: u32 = 0xff9b_d25a;
/// Drawn by the compute rasterizer.
pub const COMPUTE_COLOR: u32 = 0xffb4_783c;

fn opaque([red, green, blue]: [u32; 3]) -> u32 {
    red | green << 8 | blue << 16 | 0xff00_0000
}

/// A saturated colour of any hue for a number.
pub fn hash_color(value: u32) -> u32 {
    let bits = hash(value);
    let hue = bits % 1536;
    let rise = hue % 256;
    let fall = 255 - rise;
    let rgb = match hue / 256 {
        1 => [fall, 255, 0],
        2 => [0, 255, rise],
        3 => [0, fall, 255],
        4 => [rise, 0, 255],
        5 => [255, 0, fall],
        _ => [255, rise, 0],
    };
    let low = 40 + (bits >> 11 & 63);
    let span = 80 + (bits >> 17 & 63);
    opaque(rgb.map(|value| low + value * span / 255))
}

/// Ramp through blue, cyan, green, yellow and red to white; `step` of `steps`.
pub fn ramp_color(step: u32, steps: u32) -> u32 {
    const STOPS: [[u32; 3]; 7] = [
        [24, 28, 92],
        [40, 96, 216],
        [32, 184, 200],
        [72, 192, 64],
        [240, 208, 48],
        [224, 64, 40],
        [255, 244, 236],
    ];
    let place = step.min(steps) * 6;
    let stop = (place / steps).min(5) as usize;
    let share = place - stop as u32 * steps;
    opaque(std::array::from_fn(|c| {
        (STOPS[stop][c] * (steps - share) + STOPS[stop + 1][c] * share) / steps
    }))
}

/// Level 0, the source, is red; each coarser one another colour in the order of the rainbow; twelve, then again.
pub fn level_color(level: u32) -> u32 {
    const COLORS: [[u32; 3]; 12] = [
        [214, 48, 39],
        [244, 124, 48],
        [250, 188, 72],
        [226, 226, 90],
        [146, 204, 78],
        [44, 162, 84],
        [38, 178, 172],
        [70, 150, 222],
        [52, 88, 190],
        [104, 64, 180],
        [170, 80, 190],
        [222, 110, 168],
    ];
    opaque(COLORS[level as usize % 12])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn neighbouring_numbers_get_different_colours() {
        let colors: HashSet<_> = (0..1000).map(hash_color).collect();
        assert!(colors.len() > 980, "{}", colors.len());
        assert_eq!((0..12).map(level_color).collect::<HashSet<_>>().len(), 12);
    }

    #[test]
    fn ramp_ends_at_its_stops() {
        assert_eq!(ramp_color(0, 40), 0xff5c_1c18);
        assert_eq!(ramp_color(40, 40), 0xffec_f4ff);
        assert_eq!(ramp_color(99, 40), ramp_color(40, 40));
    }
}
