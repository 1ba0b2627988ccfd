//! Numbers that are the same on every machine.
//!
//! A sample scene is pinned by the hash of its bytes, so nothing here calls the platform's
//! mathematics library: only `+ - * /`, `sqrt`, `floor` and `round`, which IEEE 754 fixes to the bit.

use std::f64::consts::TAU;

/// SplitMix64 (Steele, Lea, Flood: Fast Splittable Pseudorandom Number Generators, 2014).
#[derive(Clone, Debug)]
pub(crate) struct Random(u64);

impl Random {
    /// A stream of its own for `seed` and `stream`, so that a change in one mesh leaves the others as they are.
    pub(crate) fn new(seed: u64, stream: u64) -> Self {
        Self(mix(seed ^ mix(stream.wrapping_add(0x9e37_79b9_7f4a_7c15))))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.0)
    }

    /// In `[0, 1)`.
    pub(crate) fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In `[low, high)`.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// In `0..count`; 0 for a `count` of 0.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }
}

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Cosine and sine of an angle in turns, within 1e-9.
pub(crate) fn turn(turns: f64) -> (f64, f64) {
    let quarter = (turns * 4.0).round();
    // At most an eighth of a turn, where these Taylor terms reach 1e-9.
    let x = (turns - quarter * 0.25) * TAU;
    let x2 = x * x;
    let sine = x
        * (1.0
            - x2 / 6.0
                * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0 * (1.0 - x2 / 110.0)))));
    let cosine = 1.0
        - x2 / 2.0 * (1.0 - x2 / 12.0 * (1.0 - x2 / 30.0 * (1.0 - x2 / 56.0 * (1.0 - x2 / 90.0))));
    match quarter.rem_euclid(4.0) as u8 {
        0 => (cosine, sine),
        1 => (-sine, cosine),
        2 => (-cosine, -sine),
        _ => (sine, -cosine),
    }
}

/// To the nearest 1/1024: a power of two, so that the value is exact in f32 up to 16 km.
pub(crate) fn grid(value: f64) -> f64 {
    (value * 1024.0).round() / 1024.0
}

/// 0 below `low`, 1 above `high`, smooth between.
pub(crate) fn smoothstep(low: f64, high: f64, value: f64) -> f64 {
    let t = ((value - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// `a` at 0, `b` at 1.
pub(crate) fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// A linear colour as RGBA bytes.
pub(crate) fn rgb(colour: [f64; 3]) -> [u8; 4] {
    let byte = |value: f64| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
    [byte(colour[0]), byte(colour[1]), byte(colour[2]), 255]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turn_is_the_cosine_and_sine() {
        for step in -400..400 {
            let turns = f64::from(step) * 0.0137;
            let (cosine, sine) = turn(turns);
            assert!((cosine - (turns * TAU).cos()).abs() < 1e-9, "cos {turns}");
            assert!((sine - (turns * TAU).sin()).abs() < 1e-9, "sin {turns}");
        }
    }

    #[test]
    fn streams_of_one_seed_differ_and_repeat() {
        let draw = |seed, stream| {
            let mut random = Random::new(seed, stream);
            [
                random.unit(),
                random.between(-2.0, 3.0),
                random.below(1000) as f64,
            ]
        };
        assert_eq!(draw(1, 2), draw(1, 2));
        assert_ne!(draw(1, 2), draw(1, 3));
        assert_ne!(draw(1, 2), draw(2, 2));
    }
}
