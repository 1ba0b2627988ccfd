//! Unit vectors on an octahedron (Meyer et al., "On floating-point normal vectors", 2010; Cigolle et al., "A survey of
//! efficient representations for independent unit vectors", JCGT 2014).

/// Bits of each of the two coordinates of a stored normal.
pub const NORMAL_BITS: u32 = 10;
const LARGEST: f32 = ((1 << NORMAL_BITS) - 1) as f32;

/// Encodes a direction; the pair that decodes nearest to it among the four around ("precise" variant of Cigolle et al.).
/// A zero or non-finite vector encodes as +Z.
pub fn encode(normal: [f32; 3]) -> [u16; 2] {
    let [x, y, z] = normal.map(f64::from);
    let sum = x.abs() + y.abs() + z.abs();
    if !(sum > 0.0 && sum.is_finite()) {
        return encode([0.0, 0.0, 1.0]);
    }
    let (mut u, mut v) = (x / sum, y / sum);
    if z < 0.0 {
        (u, v) = ((1.0 - v.abs()) * sign(u), (1.0 - u.abs()) * sign(v));
    }
    let scaled = [u, v].map(|value| (value * 0.5 + 0.5) * LARGEST as f64);
    let mut best = ([0; 2], f64::MIN);
    for corner in 0..4 {
        let pick = |value: f64, up: bool| (value as u16 + u16::from(up)).min(LARGEST as u16);
        let pair = [
            pick(scaled[0], corner & 1 != 0),
            pick(scaled[1], corner & 2 != 0),
        ];
        let decoded = unfold(pair).map(f64::from);
        let along = decoded[0] * x + decoded[1] * y + decoded[2] * z;
        let square: f64 = decoded.iter().map(|value| value * value).sum();
        // The square of the cosine, with its sign, times what is the same for all.
        let nearness = along * along.abs() / square;
        if nearness > best.1 {
            best = (pair, nearness);
        }
    }
    best.0
}

/// Decodes to a unit vector. The WGSL does the same in f32.
pub fn decode(pair: [u16; 2]) -> [f32; 3] {
    let [x, y, z] = unfold(pair);
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

/// The point on the octahedron.
fn unfold(pair: [u16; 2]) -> [f32; 3] {
    let [u, v] = pair.map(|value| value as f32 / LARGEST * 2.0 - 1.0);
    let z = 1.0 - u.abs() - v.abs();
    let fold = (-z).max(0.0);
    [u - fold * sign32(u), v - fold * sign32(v), z]
}

fn sign(value: f64) -> f64 {
    if value >= 0.0 { 1.0 } else { -1.0 }
}

fn sign32(value: f32) -> f32 {
    if value >= 0.0 { 1.0 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Ten bits a coordinate: a step of 1/511 on the octahedron is at most about 0.2 degrees on the sphere.
        #[test]
        fn error_is_below_a_fifth_of_a_degree(x in -1f32..1.0, y in -1f32..1.0, z in -1f32..1.0) {
            let length = (x * x + y * y + z * z).sqrt();
            prop_assume!(length > 1e-3);
            let decoded = decode(encode([x, y, z]));
            let cross = glam::Vec3::from(decoded).cross(glam::vec3(x, y, z) / length).length();
            prop_assert!(cross.asin().to_degrees() < 0.2);
        }
    }

    #[test]
    fn axes_survive_and_nonsense_is_plus_z() {
        for (bad, good) in [
            ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
            ([f32::NAN, 0.0, 0.0], [0.0, 0.0, 1.0]),
        ] {
            assert!(glam::Vec3::from(decode(encode(bad))).distance(good.into()) < 4e-3);
        }
    }
}
