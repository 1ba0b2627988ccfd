//! Shared: a vertex that an earlier cluster of the page has, in all its fields, is a reference: how far its number in the page is
//! from that of the reference before it. Along a border with one neighbour these are small.

use std::collections::HashMap;

use crate::cluster::Cluster;

/// Numbers of vertices in the page that can be referred to.
const MOST: usize = 1 << 16;

/// All fields of a vertex.
type Key = ([i32; 3], [u16; 2], [i32; 2], [u8; 4]);

fn key(cluster: &Cluster, vertex: usize) -> Key {
    (
        cluster.positions[vertex],
        cluster.normals.get(vertex).copied().unwrap_or_default(),
        cluster.uvs.get(vertex).copied().unwrap_or_default(),
        cluster.colors.get(vertex).copied().unwrap_or_default(),
    )
}

/// The vertices of a page's clusters so far, numbered one cluster after another.
#[derive(Debug, Default)]
pub(super) struct Known {
    numbers: HashMap<Key, Vec<u16>>,
    count: usize,
}

impl Known {
    /// Takes up a cluster's vertices; gives, for each that clusters before it have, their numbers, else nothing.
    pub fn take(&mut self, cluster: &Cluster) -> Vec<Vec<u16>> {
        let vertices = 0..cluster.positions.len();
        let known = vertices.clone().map(|vertex| {
            let numbers = self.numbers.get(&key(cluster, vertex));
            numbers.cloned().unwrap_or_default()
        });
        let known = known.collect();
        for vertex in vertices.filter(|vertex| self.count + vertex < MOST) {
            let numbers = self.numbers.entry(key(cluster, vertex)).or_default();
            numbers.push((self.count + vertex) as u16);
        }
        self.count += cluster.positions.len();
        known
    }
}

/// The stored number of a reference after one to `last`, and the number it refers to: the nearest of `numbers`.
pub(super) fn reference(last: u16, numbers: &[u16]) -> Option<(u16, u16)> {
    let number = numbers.iter().min_by_key(|number| number.abs_diff(last))?;
    let signed = number.wrapping_sub(last) as i16;
    Some((((signed << 1) ^ (signed >> 15)) as u16, *number))
}

/// The number that a stored one refers to.
pub(super) fn referred(last: u16, stored: u16) -> u16 {
    last.wrapping_add((stored >> 1) ^ (stored & 1).wrapping_neg())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn references_come_back(last: u16, numbers in prop::collection::vec(any::<u16>(), 1..4)) {
            let (stored, number) = reference(last, &numbers).expect("some");
            prop_assert!(numbers.contains(&number));
            prop_assert_eq!(referred(last, stored), number);
        }
    }

    #[test]
    fn a_vertex_is_known_only_where_every_field_is_the_same() {
        let one = Cluster {
            positions: vec![[1, 2, 3], [4, 5, 6]],
            normals: vec![[7, 8], [7, 8]],
            ..Cluster::default()
        };
        let mut other = one.clone();
        other.normals[1] = [7, 9];
        let mut known = Known::default();
        let none = Vec::<u16>::new();
        assert_eq!(known.take(&one), [none.clone(), none.clone()]);
        assert_eq!(known.take(&other), [vec![0], none]);
        assert_eq!(known.take(&one), [vec![0, 2], vec![1]]);
    }
}
