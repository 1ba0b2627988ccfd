//! Coincidence: vertices of different instances at one place of the world.
//!
//! Vertices lie in cells whose size follows the extent of their instance, a table for all sizes.

use std::collections::BTreeSet;

use glam::DVec3;

/// Share of the extent of an instance within which its vertices count as equal to another's: a
/// fraction of the grid that its mesh lies on, and more than f32 rounds.
const NEAR: f64 = 1.0 / (1 << 18) as f64;
/// Width of a cell, in distances that count as equal.
const CELL: f64 = 16.0;
/// Matches of a vertex that are told; very many copies at one place match each other.
const MOST_MATCHES: usize = 24;
/// Vertices of a cell that are looked at.
const MOST_STEPS: usize = 512;

/// A vertex of an instance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    pub in_world: DVec3,
    /// Of the instance.
    pub size: i16,
    pub instance: u32,
    pub vertex: u32,
}

/// Bytes of an entry with its part of the tables.
pub(super) const ENTRY_BYTES: u64 = 72;

/// Entries by place: chains of the entries whose cells have one hash. What is found is measured, so
/// cells of one hash only cost time.
#[derive(Debug)]
pub(super) struct Places {
    entries: Vec<Entry>,
    /// Next entry of the same hash.
    next: Vec<u32>,
    /// First entry of each hash.
    first: Vec<u32>,
    sizes: BTreeSet<i16>,
}

const NONE: u32 = u32::MAX;

/// Base-two logarithm of an instance's extent, its size here; `None` for one without extent.
pub(super) fn size_of(extent_metres: f64) -> Option<i16> {
    (extent_metres > 0.0).then(|| extent_metres.log2().ceil() as i16)
}

/// Distance within which vertices of a size count as equal, metres.
fn near_metres(size: i16) -> f64 {
    NEAR * 2f64.powi(size as i32)
}

/// Width of a cell of a size, metres: much wider than what is looked for, so that a look seldom
/// takes more than one cell.
fn cell_metres(size: i16) -> f64 {
    CELL * near_metres(size)
}

fn cell(width: f64, point: DVec3) -> [i64; 3] {
    (point / width).floor().to_array().map(|index| index as i64)
}

/// Spreads cells over 64 bits, as `build/vertex.rs` does.
fn hash(size: i16, [x, y, z]: [i64; 3]) -> u64 {
    let mix = |sum: u64, value: u64| {
        let product = (sum ^ value).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        product ^ product >> 32
    };
    let sum = mix(mix(mix(size as u64, x as u64), y as u64), z as u64);
    sum.wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 16
}

impl Places {
    /// Makes room for `count` entries.
    pub(super) fn with_capacity(count: usize) -> Self {
        Self {
            entries: Vec::with_capacity(count),
            next: Vec::with_capacity(count),
            first: vec![NONE; (2 * count + 1).next_power_of_two()],
            sizes: BTreeSet::new(),
        }
    }

    /// Sizes that have a vertex, ascending.
    pub(super) fn sizes(&self) -> impl Iterator<Item = i16> + '_ {
        self.sizes.iter().copied()
    }

    fn slot(&self, size: i16, cell: [i64; 3]) -> usize {
        hash(size, cell) as usize & (self.first.len() - 1)
    }

    /// Adds vertices of an instance.
    pub(super) fn add(&mut self, entries: impl Iterator<Item = Entry>) {
        for entry in entries {
            let width = cell_metres(entry.size);
            let slot = self.slot(entry.size, cell(width, entry.in_world));
            self.next.push(self.first[slot]);
            self.first[slot] = self.entries.len() as u32;
            self.entries.push(entry);
            self.sizes.insert(entry.size);
        }
    }

    /// Calls `found` with entries of other instances of `sizes` at the place of `entry`. Each of two
    /// entries finds the other: the smaller one says how near they have to be.
    pub(super) fn look(&self, sizes: &[i16], entry: &Entry, mut found: impl FnMut(&Entry)) {
        let mut matches = 0;
        for &other in sizes {
            let near = near_metres(entry.size.min(other));
            let width = cell_metres(other);
            let low = cell(width, entry.in_world - near);
            let high = cell(width, entry.in_world + near);
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    for z in low[2]..=high[2] {
                        let mut at = self.first[self.slot(other, [x, y, z])];
                        let mut steps = 0;
                        while at != NONE && steps < MOST_STEPS && matches < MOST_MATCHES {
                            let known = &self.entries[at as usize];
                            let distance = known.in_world.distance_squared(entry.in_world);
                            let is_other = known.size == other && known.instance != entry.instance;
                            if is_other && distance <= near * near {
                                found(known);
                                matches += 1;
                            }
                            at = self.next[at as usize];
                            steps += 1;
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Against every pair.
        #[test]
        fn every_near_pair_is_found(
            points in prop::collection::vec((prop::array::uniform3(-2i32..3), prop::array::uniform3(-1i32..2), 0u8..3), 1..40),
        ) {
            let place = |at: [i32; 3], off: [i32; 3], size: i16| {
                let at = DVec3::from(at.map(|value| value as f64));
                at + DVec3::from(off.map(|value| 0.49 / 3f64.sqrt() * value as f64)) * near_metres(size)
            };
            let mut places = Places::with_capacity(points.len());
            let mut all = vec![];
            for (index, &(at, off, size)) in points.iter().enumerate() {
                let size = size as i16 * 2;
                let in_world = place(at, off, size);
                let entry = Entry { in_world, size, instance: index as u32, vertex: 0 };
                places.add(std::iter::once(entry));
                all.push((size, entry));
            }
            for (size, entry) in &all {
                let mut found = vec![];
                let sizes: Vec<i16> = places.sizes().collect();
                places.look(&sizes, entry, |other| found.push(other.instance));
                found.sort_unstable();
                found.dedup();
                let expected: Vec<u32> = all.iter().filter(|(other, known)| {
                    known.instance != entry.instance
                        && known.in_world.distance(entry.in_world) <= near_metres(*size.min(other))
                }).map(|(_, known)| known.instance).collect();
                if expected.len() < MOST_MATCHES {
                    prop_assert_eq!(found, expected);
                }
            }
        }
    }
}
