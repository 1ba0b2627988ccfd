//! Linear parts that several instances have, such as those of a street's houses.

use std::collections::HashMap;
use std::hash::{BuildHasher, BuildHasherDefault, DefaultHasher};

use super::{Linear, linear_of};
use crate::scene::Instance;

/// Fewest instances of one linear part for which a table pays.
const LEAST_INSTANCES: usize = 3;
/// Most linear parts of the table.
const MOST_PARTS: usize = 1 << 16;

/// The linear parts that repeat, numbered in the order in which they come.
#[derive(Debug, Default)]
pub struct SharedParts {
    parts: Vec<Linear>,
    numbers: HashMap<[u64; 9], u32>,
}

impl SharedParts {
    /// Those of `instances`.
    pub fn new(instances: &[Instance]) -> Self {
        // Eight bytes an instance: a map of all parts would take several times the list.
        let hasher = BuildHasherDefault::<DefaultHasher>::default();
        let hash = |instance: &Instance| hasher.hash_one(bits(&linear_of(instance)));
        let mut hashes: Vec<u64> = instances.iter().map(hash).collect();
        hashes.sort_unstable();
        let same = hashes.chunk_by(|a, b| a == b);
        let repeated: Vec<u64> = same
            .filter(|run| run.len() >= LEAST_INSTANCES)
            .map(|run| run[0])
            .collect();
        drop(hashes);
        let mut shared = Self::default();
        if repeated.is_empty() {
            return shared;
        }
        for instance in instances {
            if shared.parts.len() >= MOST_PARTS {
                break;
            }
            if repeated.binary_search(&hash(instance)).is_ok() {
                let part = linear_of(instance);
                let next = shared.parts.len() as u32;
                shared.numbers.entry(bits(&part)).or_insert_with(|| {
                    shared.parts.push(part);
                    next
                });
            }
        }
        shared
    }

    /// The parts, in the order of their numbers.
    pub fn parts(&self) -> &[Linear] {
        &self.parts
    }

    /// The number of a part, if it is one of them.
    pub fn number(&self, part: &Linear) -> Option<u32> {
        match self.numbers.is_empty() {
            true => None,
            false => self.numbers.get(&bits(part)).copied(),
        }
    }
}

fn bits(part: &Linear) -> [u64; 9] {
    let mut bits = [0; 9];
    for (bits, value) in bits.iter_mut().zip(part.iter().flatten()) {
        *bits = value.to_bits();
    }
    bits
}
