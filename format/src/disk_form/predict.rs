//! Predict: what a vertex is expected to be from those before it; only the difference is stored.
//!
//! Positions and texture coordinates go on beyond an edge as the triangle on this side does (the parallelogram of Touma and Gotsman,
//! "Triangle mesh compression", 1998); colours are the mean of the edge's ends. After a beginning a vertex is
//! expected to be the one before it. All in steps above the cluster's smallest, modulo the field's bits. Normals are expected to be
//! those of the cluster's surface, when all of it is known.

use super::FIELDS;
use super::topology::Edge;
use crate::octahedral::NORMAL_BITS;

/// The first field of normals.
pub(super) const NORMAL: usize = 3;

/// Whether a field is one of the two of a normal.
pub(super) fn is_normal(field: usize) -> bool {
    (NORMAL..NORMAL + 2).contains(&field)
}

/// Values of the fields of a cluster's vertices, as far as they are known.
#[derive(Debug)]
pub(super) struct Values {
    pub fields: [[u32; 256]; FIELDS],
    pub count: usize,
}

impl Values {
    pub fn new() -> Self {
        Self {
            fields: [[0; 256]; FIELDS],
            count: 0,
        }
    }

    /// What a field of the next vertex is expected to be, beyond an edge or after the vertex before it; bits above the field's
    /// are noise.
    #[inline]
    pub fn predict(&self, field: usize, beyond: Option<Edge>) -> u32 {
        let known = &self.fields[field];
        match beyond.map(|edge| edge.map(|vertex| known[vertex as usize])) {
            Some([a, b, opposite]) => match field {
                0..=2 | 5 | 6 => a.wrapping_add(b).wrapping_sub(opposite),
                _ => (a + b) / 2,
            },
            None => match self.count {
                0 => 0,
                count => known[(count - 1) % 256],
            },
        }
    }
}

impl Values {
    /// What the normal of every vertex is expected to be: the direction of the sum of its triangles' normals, each as long as
    /// twice the triangle's area. Sums are exact; the rest is binary64 without fused operations, the same everywhere.
    pub fn expected_normals(&self, triangles: &[[u8; 3]]) -> Vec<[u32; 2]> {
        let mut sums = [[0i64; 3]; 256];
        for &triangle in triangles {
            let at = |corner: usize, axis: usize| {
                self.fields[axis][triangle[corner] as usize] as i64
                    - self.fields[axis][triangle[0] as usize] as i64
            };
            let [p, q] = [1, 2].map(|corner| [0, 1, 2].map(|axis| at(corner, axis)));
            // Offsets have 24 bits and a cluster 128 triangles: 58 bits.
            let across = [
                p[1] * q[2] - p[2] * q[1],
                p[2] * q[0] - p[0] * q[2],
                p[0] * q[1] - p[1] * q[0],
            ];
            for vertex in triangle {
                (0..3).for_each(|axis| sums[vertex as usize][axis] += across[axis]);
            }
        }
        sums[..self.count.min(256)]
            .iter()
            .map(|&sum| on_octahedron(sum))
            .collect()
    }
}

/// The octahedral pair nearest to a direction, coordinate by coordinate; the middle for none.
fn on_octahedron(direction: [i64; 3]) -> [u32; 2] {
    let [x, y, z] = direction.map(|value| value as f64);
    let size = x.abs() + y.abs() + z.abs();
    let (mut u, mut v) = match size > 0.0 {
        true => (x / size, y / size),
        false => (0.0, 0.0),
    };
    if z < 0.0 {
        (u, v) = ((1.0 - v.abs()).copysign(u), (1.0 - u.abs()).copysign(v));
    }
    let largest = ((1 << NORMAL_BITS) - 1) as f64;
    [u, v].map(|value| ((value * 0.5 + 0.5) * largest + 0.5) as u32)
}

/// Difference modulo `bits` (1 to 24), small ones of either sign first: 0, -1, 1, -2, …
pub(super) fn difference(value: u32, predicted: u32, bits: u32) -> u32 {
    // The sign bit of the field at the word's, and back.
    let signed = (value.wrapping_sub(predicted) << (32 - bits)) as i32 >> (32 - bits);
    ((signed << 1) ^ (signed >> 31)) as u32
}

/// The value that has a difference.
#[inline]
pub(super) fn value(difference: u32, predicted: u32, bits: u32) -> u32 {
    let signed = (difference >> 1) ^ (difference & 1).wrapping_neg();
    predicted.wrapping_add(signed) & ((1 << bits) - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn differences_fit_and_come_back(bits in 1u32..=24, value: u32, predicted: u32) {
            let mask = (1 << bits) - 1;
            let stored = difference(value & mask, predicted, bits);
            prop_assert!(stored <= mask);
            prop_assert_eq!(super::value(stored, predicted, bits), value & mask);
        }
    }

    #[test]
    fn a_direction_is_expected_where_it_is_encoded() {
        for direction in [
            [3, 4, 5],
            [-7, 2, -1],
            [0, 0, -9],
            [1 << 57, -(1 << 56), 3],
            [0, -5, 0],
        ] {
            let exact = crate::octahedral::encode(direction.map(|value| value as f32));
            let expected = on_octahedron(direction);
            let apart = |axis: usize| (expected[axis] as i32 - exact[axis] as i32).abs();
            assert!(
                apart(0) <= 1 && apart(1) <= 1,
                "{direction:?} {exact:?} {expected:?}"
            );
        }
    }

    #[test]
    fn small_differences_are_small_numbers() {
        let stored = [0, -1, 1, -2, 2].map(|by: i32| difference(by as u32, 0, 10));
        assert_eq!(stored, [0, 1, 2, 3, 4]);
    }
}
