//! Predict: what a vertex is expected to be from those before it; only the difference is stored.
//!
//! Positions and texture coordinates go on beyond an edge as the triangle on this side does (the parallelogram of Touma and Gotsman,
//! "Triangle mesh compression", 1998); colours are the mean of the edge's ends. At a beginning a vertex is
//! expected to be the one before it. All in steps above the cluster's smallest, modulo the field's bits. Normals are expected to be
//! those of the cluster's surface, when all of it is known. Integers of 32 bits do: a GPU has no others.

use super::field;
use crate::octahedral::NORMAL_BITS;

/// Bits of a position that a triangle's normal is worked out with: more would overflow.
pub const SURFACE_BITS: u32 = 14;

/// Whether a field is one of the two of a normal.
pub(super) fn is_normal(number: usize) -> bool {
    (field::NORMAL..field::UV).contains(&number)
}

/// What a field is expected to be beyond an edge with the values `a`, `b` and `opposite`; bits above the field's are noise.
#[inline]
pub(super) fn beyond_edge(number: usize, [a, b, opposite]: [u32; 3]) -> u32 {
    match number < field::COLOR {
        true => a.wrapping_add(b).wrapping_sub(opposite),
        false => (a + b) / 2,
    }
}

/// How far positions are shifted down before normals are worked out; `bits` are those of x, y and z.
pub(super) fn surface_shift(bits: [u32; 3]) -> u32 {
    let widest = bits.into_iter().max().unwrap_or(0);
    widest.saturating_sub(SURFACE_BITS)
}

/// The normal of a triangle, as long as twice its area, then 0. Modulo 2^32: what overflows (in sums: a cluster that fills its box many
/// times over) is expected badly, and read as it was written.
#[inline(always)]
pub(super) fn triangle_normal(a: &[i32; 4], b: &[i32; 4], c: &[i32; 4]) -> [i32; 4] {
    let p: [i32; 4] = std::array::from_fn(|axis| b[axis].wrapping_sub(a[axis]));
    let q: [i32; 4] = std::array::from_fn(|axis| c[axis].wrapping_sub(a[axis]));
    let across = |i: usize, j: usize| {
        let (one, other) = (p[i].wrapping_mul(q[j]), p[j].wrapping_mul(q[i]));
        one.wrapping_sub(other)
    };
    [across(1, 2), across(2, 0), across(0, 1), 0]
}

/// The octahedral pair nearest to a direction, coordinate by coordinate; the middle for none.
#[inline]
pub(super) fn on_octahedron(direction: [i32; 3]) -> [u32; 2] {
    let mut sizes = direction.map(i32::unsigned_abs);
    let largest = sizes[0].max(sizes[1]).max(sizes[2]);
    // 19 bits each: the products below fit a word.
    let shift = (32 - largest.leading_zeros()).saturating_sub(19);
    sizes = sizes.map(|size| size >> shift);
    let sum: u32 = sizes.iter().sum();
    if sum == 0 {
        return [1 << (NORMAL_BITS - 1); 2];
    }
    let pair = match direction[2] < 0 {
        true => [sum - sizes[1], sum - sizes[0]],
        false => [sizes[0], sizes[1]],
    };
    std::array::from_fn(|axis| {
        let numerator = match direction[axis] < 0 {
            true => sum - pair[axis],
            false => sum + pair[axis],
        };
        (numerator * ((1 << NORMAL_BITS) - 1) + sum) / (2 * sum)
    })
}

/// Difference modulo `bits` (1 to 24), small ones of either sign first: 0, -1, 1, -2, …
pub(super) fn difference(value: u32, predicted: u32, bits: u32) -> u32 {
    // The sign bit of the field at the word's, and back.
    let signed = (value.wrapping_sub(predicted) << (32 - bits)) as i32 >> (32 - bits);
    ((signed << 1) ^ (signed >> 31)) as u32
}

/// The signed number that a difference stands for, modulo 2^32.
#[inline]
pub(super) fn signed(difference: u32) -> u32 {
    (difference >> 1) ^ (difference & 1).wrapping_neg()
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
            prop_assert_eq!(predicted.wrapping_add(signed(stored)) & mask, value & mask);
        }

        #[test]
        fn a_direction_is_expected_where_it_is_encoded(direction: [i32; 3]) {
            let exact = crate::octahedral::encode(direction.map(|value| value as f32));
            let expected = on_octahedron(direction);
            for axis in 0..2 {
                let apart = expected[axis] as i32 - exact[axis] as i32;
                // Where z is zero the two folds meet.
                prop_assert!(apart.abs() <= 2, "{direction:?} {exact:?} {expected:?}");
            }
        }
    }

    #[test]
    fn no_direction_is_the_middle() {
        assert_eq!(on_octahedron([0; 3]), [512; 2]);
        assert_eq!(on_octahedron([0, 0, i32::MIN]), [1023; 2]);
    }

    #[test]
    fn small_differences_are_small_numbers() {
        let stored = [0, -1, 1, -2, 2].map(|by: i32| difference(by as u32, 0, 10));
        assert_eq!(stored, [0, 1, 2, 3, 4]);
    }
}
