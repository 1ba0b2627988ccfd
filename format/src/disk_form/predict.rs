//! Predict: what a vertex is expected to be from those before it; only the difference is stored.
//!
//! Positions and texture coordinates go on beyond an edge as the triangle on this side does (the parallelogram of Touma and Gotsman,
//! "Triangle mesh compression", 1998); normals and colours are the mean of the edge's ends. After a beginning a vertex is
//! expected to be the one before it. All in steps above the cluster's smallest, modulo the field's bits.

use super::FIELDS;
use super::topology::Edge;

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
    fn small_differences_are_small_numbers() {
        let stored = [0, -1, 1, -2, 2].map(|by: i32| difference(by as u32, 0, 10));
        assert_eq!(stored, [0, 1, 2, 3, 4]);
    }
}
