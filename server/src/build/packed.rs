//! Packed: what waits between the stages. Each word of a vertex, a triangle, an edge or a witness is a plane of numbers,
//! stored as what they exceed the smallest of them by, in as few bytes as that needs.
//!
//! What is packed is a run of words: the number of records in each of its tables, then the tables.

use super::cluster::{self, ClusterInfo};
use super::clusterize::Clusters;

/// Clusters in the order they were made, packed.
#[derive(Debug, Default)]
pub(super) struct Packed {
    pub words: Vec<u32>,
    /// `first_word` and `words` of each are where it lies in `words` above.
    pub infos: Vec<ClusterInfo>,
}

impl Packed {
    /// Packs every cluster by itself.
    pub fn new(clusters: &Clusters) -> Self {
        let mut packed = Self::default();
        let mut bytes = Vec::new();
        for info in &clusters.infos {
            let own = info.first_word as usize..(info.first_word + info.words) as usize;
            let first_word = packed.words.len() as u32;
            let words = &clusters.words[own];
            pack(words, cluster::RECORD_WORDS, &mut bytes, &mut packed.words);
            packed.infos.push(ClusterInfo {
                first_word,
                words: packed.words.len() as u32 - first_word,
                ..*info
            });
        }
        packed
    }
}

/// Appends `words`, with tables of records of so many words, to `packed`; `bytes` is for work.
pub(super) fn pack<const TABLES: usize>(
    words: &[u32],
    record_words: [usize; TABLES],
    bytes: &mut Vec<u8>,
    packed: &mut Vec<u32>,
) {
    let (counts, mut words) = words.split_at(TABLES);
    bytes.clear();
    for count in counts {
        bytes.extend(count.to_le_bytes());
    }
    for (&count, record_words) in counts.iter().zip(record_words) {
        let (table, rest) = words.split_at(count as usize * record_words);
        words = rest;
        if table.is_empty() {
            continue;
        }
        for plane in 0..record_words {
            let values = table.iter().skip(plane).step_by(record_words);
            // Grid indices have signs; of what has none any order does.
            let signed = values.clone().map(|&value| value as i32);
            let (low, high) = signed.fold((i32::MAX, i32::MIN), |(low, high), value| {
                (low.min(value), high.max(value))
            });
            let low = low as u32;
            let width = (32 - (high as u32).wrapping_sub(low).leading_zeros()).div_ceil(8);
            bytes.extend(low.to_le_bytes());
            bytes.push(width as u8);
            for &value in values {
                bytes.extend_from_slice(&value.wrapping_sub(low).to_le_bytes()[..width as usize]);
            }
        }
    }
    let (whole, rest) = bytes.as_chunks::<4>();
    packed.extend(whole.iter().map(|&four| u32::from_ne_bytes(four)));
    if !rest.is_empty() {
        let mut last = [0; 4];
        last[..rest.len()].copy_from_slice(rest);
        packed.push(u32::from_ne_bytes(last));
    }
}

/// The words that were packed.
pub(super) fn unpack<const TABLES: usize>(
    packed: &[u32],
    record_words: [usize; TABLES],
) -> Vec<u32> {
    let bytes: &[u8] = bytemuck::cast_slice(packed);
    let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte]));
    let counts: [u32; TABLES] = std::array::from_fn(|table| word(4 * table));
    let mut at = 4 * TABLES;
    let tables = counts.iter().zip(record_words);
    let total: usize = tables.map(|(&count, words)| count as usize * words).sum();
    let mut words = vec![0; TABLES + total];
    let (head, mut rest) = words.split_at_mut(TABLES);
    head.copy_from_slice(&counts);
    for (&count, record_words) in counts.iter().zip(record_words) {
        let (table, after) = rest.split_at_mut(count as usize * record_words);
        rest = after;
        if table.is_empty() {
            continue;
        }
        for plane in 0..record_words {
            let low = word(at);
            let width = bytes[at + 4] as usize;
            at += 5;
            let slots = table.iter_mut().skip(plane).step_by(record_words);
            fill_wide(slots, &bytes[at..], low, width, count as usize);
            at += count as usize * width;
        }
    }
    words
}

/// Of the words that were packed, the first three of the first table's records, the positions of a
/// cluster, and the second table, its triangles.
pub(super) fn unpack_shape<const TABLES: usize>(
    packed: &[u32],
    record_words: [usize; TABLES],
    positions: &mut Vec<[i32; 3]>,
    triangles: &mut Vec<[u8; 4]>,
) {
    let bytes: &[u8] = bytemuck::cast_slice(packed);
    let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte]));
    let [vertices, count] = [0, 1].map(|table| word(4 * table) as usize);
    positions.clear();
    positions.resize(vertices, [0; 3]);
    triangles.clear();
    triangles.resize(count, [0; 4]);
    let mut at = 4 * TABLES;
    let planes = if vertices > 0 { record_words[0] } else { 0 };
    for plane in 0..planes {
        let width = bytes[at + 4] as usize;
        if plane < 3 {
            let slots = positions.as_flattened_mut().iter_mut().skip(plane);
            let slots = slots.step_by(3).map(bytemuck::cast_mut);
            fill_wide(slots, &bytes[at + 5..], word(at), width, vertices);
        }
        at += 5 + vertices * width;
    }
    if count > 0 {
        let slots = triangles.iter_mut().map(bytemuck::cast_mut);
        fill_wide(
            slots,
            &bytes[at + 5..],
            word(at),
            bytes[at + 4] as usize,
            count,
        );
    }
}

/// Fills `count` slots from numbers of `width` bytes.
fn fill_wide<'a>(
    slots: impl Iterator<Item = &'a mut u32>,
    values: &[u8],
    low: u32,
    width: usize,
    count: usize,
) {
    let values = &values[..count * width];
    match width {
        0 => slots.for_each(|slot| *slot = low),
        1 => fill::<1>(slots, values, low),
        2 => fill::<2>(slots, values, low),
        3 => fill::<3>(slots, values, low),
        _ => fill::<4>(slots, values, low),
    }
}

fn fill<'a, const N: usize>(slots: impl Iterator<Item = &'a mut u32>, values: &[u8], low: u32) {
    for (slot, value) in slots.zip(values.as_chunks::<N>().0) {
        let mut four = [0; 4];
        four[..N].copy_from_slice(value);
        *slot = low.wrapping_add(u32::from_le_bytes(four));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn whatever_was_packed_comes_back(
            counts in prop::array::uniform5(0usize..40),
            seed: u32,
            shifts in prop::collection::vec(0u32..33, 16),
        ) {
            let mut words: Vec<u32> = counts.iter().map(|&count| count as u32).collect();
            let mut state = seed | 1;
            for (count, record_words) in counts.iter().zip(cluster::RECORD_WORDS) {
                for index in 0..count * record_words {
                    state = state.wrapping_mul(0x9e37_79b9).rotate_left(11) ^ index as u32;
                    // Planes of all widths, and of any sign.
                    let value = state.checked_shr(shifts[index % record_words]).unwrap_or(0);
                    words.push(value.wrapping_sub(seed));
                }
            }
            let clusters = Clusters {
                infos: vec![ClusterInfo { words: words.len() as u32, ..ClusterInfo::default() }],
                words: words.clone(),
            };
            let packed = Packed::new(&clusters);
            let own = packed.infos[0];
            prop_assert_eq!(own.words as usize, packed.words.len());
            prop_assert_eq!(&unpack(&packed.words, cluster::RECORD_WORDS), &words);
            // The shape alone: what was there before is gone.
            let (mut positions, mut triangles) = (vec![[7; 3]; 9], vec![[7; 4]; 9]);
            let tables = cluster::RECORD_WORDS;
            unpack_shape(&packed.words, tables, &mut positions, &mut triangles);
            let view = cluster::ClusterView::new(&words);
            let expected: Vec<[i32; 3]> = view.vertices.iter().map(|own| own.position).collect();
            prop_assert_eq!(positions, expected);
            prop_assert_eq!(&triangles[..], view.triangles);
        }
    }
}
