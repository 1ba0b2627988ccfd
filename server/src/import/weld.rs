//! Weld: corners at the same place become one vertex, for files that list corners and no vertices.

use std::collections::HashMap;
use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hasher};

use super::plain;

/// Vertices by position, bit for bit, in the order of first use.
pub(super) struct Weld {
    number_of: HashMap<[u32; 3], u32, Seeded>,
    pub(super) positions: Vec<[f32; 3]>,
}

impl Weld {
    /// `vertices`: about how many are awaited.
    pub(super) fn new(vertices: usize) -> Self {
        Self {
            number_of: HashMap::with_capacity_and_hasher(vertices, Seeded::new()),
            positions: Vec::with_capacity(vertices),
        }
    }

    /// Bytes that are held.
    pub(super) fn held_bytes(&self) -> u64 {
        let positions = self.positions.capacity() * size_of::<[f32; 3]>();
        positions as u64 + plain::table_bytes(self.number_of.capacity())
    }

    /// The vertex at `position`; -0 becomes 0. Fewer than 2^32 vertices.
    pub(super) fn vertex(&mut self, position: [f32; 3]) -> u32 {
        let position = position.map(|it| it + 0.0);
        let next = self.positions.len() as u32;
        let number = *self
            .number_of
            .entry(position.map(f32::to_bits))
            .or_insert(next);
        if number == next {
            self.positions.push(position);
        }
        number
    }
}

/// Folded multiplications from a seed of this run: a few times as fast as the standard one, and no file can be made to
/// collide. No result hangs on the seed.
#[derive(Clone)]
pub(super) struct Seeded(u64);

pub(super) struct Folding(u64);

impl Seeded {
    pub(super) fn new() -> Self {
        Self(RandomState::new().hash_one(0))
    }
}

impl BuildHasher for Seeded {
    type Hasher = Folding;

    fn build_hasher(&self) -> Folding {
        Folding(self.0)
    }
}

impl Hasher for Folding {
    fn write(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.write_u64(u64::from_le_bytes(word));
        }
    }

    fn write_u64(&mut self, word: u64) {
        // The odd constant is 2^64 over the golden ratio.
        let product =
            u128::from(self.0 ^ word) * u128::from(0x9e37_79b9_7f4a_7c15_u64 ^ self.0 << 1);
        self.0 = (product as u64) ^ (product >> 64) as u64;
    }

    fn write_usize(&mut self, length: usize) {
        self.write_u64(length as u64);
    }

    fn finish(&self) -> u64 {
        self.0
    }
}
