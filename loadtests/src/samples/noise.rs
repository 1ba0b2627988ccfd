//! Gradient noise over space (Perlin: Improving Noise, SIGGRAPH 2002), with a hash in place of the table.

use glam::DVec3;

use super::number::lerp;

/// Smooth noise in about `[-1, 1]`, zero on the integer lattice.
pub(super) fn noise(at: DVec3, seed: u32) -> f64 {
    let cell = at.floor();
    let inside = at - cell;
    let fade = inside
        * inside
        * inside
        * (inside * (inside * 6.0 - DVec3::splat(15.0)) + DVec3::splat(10.0));
    let corner = |x: i64, y: i64, z: i64| {
        let hash = hash(
            cell.x as i64 + x,
            cell.y as i64 + y,
            cell.z as i64 + z,
            seed,
        );
        let away = inside - DVec3::new(x as f64, y as f64, z as f64);
        gradient(hash, away)
    };
    let along = |y, z| lerp(corner(0, y, z), corner(1, y, z), fade.x);
    lerp(
        lerp(along(0, 0), along(1, 0), fade.y),
        lerp(along(0, 1), along(1, 1), fade.y),
        fade.z,
    )
}

/// Octaves of noise, each twice as fine and half as high; in about `[-1, 1]`.
pub(crate) fn fractal(at: DVec3, seed: u32, octaves: u32) -> f64 {
    sum_octaves(at, seed, octaves, |value| value)
}

/// Octaves of noise folded at zero, which gives sharp crests; in about `[-1, 1]`.
pub(super) fn ridged(at: DVec3, seed: u32, octaves: u32) -> f64 {
    sum_octaves(at, seed, octaves, |value| 1.0 - 2.0 * value.abs())
}

fn sum_octaves(at: DVec3, seed: u32, octaves: u32, fold: impl Fn(f64) -> f64) -> f64 {
    let (mut total, mut height, mut place) = (0.0, 0.5, at);
    for octave in 0..octaves {
        total += height * fold(noise(place, seed.wrapping_add(octave * 1013)));
        height *= 0.5;
        // The shift keeps the zeros of the octaves' lattices apart.
        place = place * 2.0 + DVec3::new(17.25, 31.5, 11.75);
    }
    total
}

fn hash(x: i64, y: i64, z: i64, seed: u32) -> u32 {
    let mut h = (x as u32).wrapping_mul(0x8da6_b343)
        ^ (y as u32).wrapping_mul(0xd816_3841)
        ^ (z as u32).wrapping_mul(0xcb1a_b31f)
        ^ seed.wrapping_mul(0x9e37_79b9);
    h ^= h >> 16;
    h = h.wrapping_mul(0x7feb_352d);
    h ^= h >> 15;
    h = h.wrapping_mul(0x846c_a68b);
    h ^ (h >> 16)
}

/// One of the twelve edge directions of a cube, by the hash.
fn gradient(hash: u32, away: DVec3) -> f64 {
    let sign = |bit: u32, value: f64| if hash & bit == 0 { value } else { -value };
    match (hash >> 4) % 3 {
        0 => sign(1, away.x) + sign(2, away.y),
        1 => sign(1, away.y) + sign(2, away.z),
        _ => sign(1, away.z) + sign(2, away.x),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_bounded_continuous_and_zero_on_the_lattice() {
        let mut widest = 0.0f64;
        for step in 0..4000 {
            let t = f64::from(step) * 0.013;
            let at = DVec3::new(t, 3.7 - t * 0.31, t * 0.17);
            let here = noise(at, 5);
            widest = widest.max(here.abs());
            assert!(here.abs() <= 1.5, "{here} at {at}");
            assert!((noise(at + DVec3::splat(1e-6), 5) - here).abs() < 1e-4);
        }
        assert!(widest > 0.5, "the noise is nearly flat: {widest}");
        assert_eq!(noise(DVec3::new(4.0, -7.0, 2.0), 9), 0.0);
    }
}
