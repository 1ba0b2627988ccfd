//! Borders: which places of a chunk's clusters other groups share, and which lie on an open edge of the surface.
//!
//! An edge between two places counts +1 for each triangle along it and -1 for each against it; the sum over a cluster is 0
//! inside it. Moving vertices maps the sums as it maps the triangles, so a group whose replacement leaves every place alone
//! that it shares with another group has the sums it had, and no cut opens an edge that was closed. Only edges whose sum
//! over a cluster is not 0 matter, so only those are looked at.

use super::cluster::ClusterView;
use super::neighbours::FixedPlaces;
use super::vertex::Places;

/// What may be done to a vertex.
pub(super) const FREE: u8 = 0;
/// It lies on an open edge: it may move along the edge.
pub(super) const OPEN: u8 = 1;
/// Another group shares it: it stays.
pub(super) const LOCKED: u8 = 2;

/// Bounds of a chunk, grid indices.
#[derive(Debug, Clone, Copy)]
pub(super) struct ChunkBounds {
    pub low: [i32; 3],
    pub high: [i32; 3],
}

impl ChunkBounds {
    /// Whether the two have a point in common.
    pub fn meets(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.low[axis] <= other.high[axis] && other.low[axis] <= self.high[axis])
    }

    fn contains(&self, position: [i32; 3]) -> bool {
        (0..3).all(|axis| (self.low[axis]..=self.high[axis]).contains(&position[axis]))
    }
}

/// The border places of a chunk's clusters.
#[derive(Debug)]
pub(super) struct Borders {
    places: Places,
    /// Border edges of all clusters as places, one cluster after another.
    edges: Vec<[u32; 2]>,
    /// First edge of each cluster.
    first_edge: Vec<u32>,
}

const NONE: u32 = u32::MAX;
const SHARED: u32 = u32::MAX - 1;

impl Borders {
    /// Collects the border places of `clusters`.
    pub fn new(clusters: &[ClusterView]) -> Self {
        let edges: usize = clusters.iter().map(|cluster| cluster.border.len()).sum();
        let mut borders = Self {
            places: Places::default(),
            edges: Vec::with_capacity(edges),
            first_edge: Vec::with_capacity(clusters.len() + 1),
        };
        borders.places.clear(edges);
        let mut known = [(0u32, 0u32); 256];
        for (number, cluster) in clusters.iter().enumerate() {
            borders.first_edge.push(borders.edges.len() as u32);
            let stamp = number as u32 + 1;
            for &[from, to, ..] in cluster.border {
                let ends = [from, to].map(|vertex| {
                    let known = &mut known[vertex as usize];
                    if known.0 != stamp {
                        let place = borders
                            .places
                            .number(cluster.vertices[vertex as usize].position);
                        *known = (stamp, place);
                    }
                    known.1
                });
                borders.edges.push(ends);
            }
        }
        borders.first_edge.push(borders.edges.len() as u32);
        borders
    }

    /// Grid index of every border place.
    pub fn places(&self) -> &[[i32; 3]] {
        &self.places.positions
    }

    /// Border edges of a cluster, as places.
    pub fn edges_of(&self, cluster: usize) -> &[[u32; 2]] {
        &self.edges[self.first_edge[cluster] as usize..self.first_edge[cluster + 1] as usize]
    }

    /// What may be done to each border place when `groups`, which hold every cluster of the chunk once, are simplified
    /// apart. An open edge inside the bounds of another chunk may belong to a closed surface there:
    /// it is locked. So are the
    /// `fixed` places, which other meshes share.
    pub fn rules(
        &self,
        groups: &[Vec<u32>],
        others: &[ChunkBounds],
        fixed: &FixedPlaces,
    ) -> Vec<u8> {
        let mut owner = vec![NONE; self.places().len()];
        for (group, members) in groups.iter().enumerate() {
            for &cluster in members {
                for &place in self.edges_of(cluster as usize).as_flattened() {
                    let owner = &mut owner[place as usize];
                    *owner = match *owner {
                        NONE => group as u32,
                        known if known == group as u32 => known,
                        _ => SHARED,
                    };
                }
            }
        }
        let mut rules: Vec<u8> = owner
            .iter()
            .map(|&owner| if owner == SHARED { LOCKED } else { FREE })
            .collect();
        for edge in self.open_edges() {
            let ends = edge.map(|place| self.places()[place as usize]);
            let elsewhere = others
                .iter()
                .any(|bounds| ends.iter().all(|&end| bounds.contains(end)));
            for place in edge {
                let rule = &mut rules[place as usize];
                let shared = elsewhere || fixed.holds(self.places()[place as usize]);
                *rule = (*rule).max(if shared { LOCKED } else { OPEN });
            }
        }
        rules
    }

    /// What `rules` says of each vertex of a cluster.
    pub fn rules_of(&self, cluster: usize, view: &ClusterView, rules: &[u8]) -> Vec<u8> {
        let mut own = vec![FREE; view.vertices.len()];
        for (edge, places) in view.border.iter().zip(self.edges_of(cluster)) {
            for end in 0..2 {
                own[edge[end] as usize] = rules[places[end] as usize];
            }
        }
        own
    }

    /// Edges whose sum over the chunk is not 0.
    fn open_edges(&self) -> Vec<[u32; 2]> {
        // Open addressing again: a sort of all edges would cost more than the rest of this file.
        const EMPTY: u64 = u64::MAX;
        let mask = (2 * self.edges.len() + 2).next_power_of_two() - 1;
        let mut table = vec![(EMPTY, 0i32); mask + 1];
        for &[from, to] in &self.edges {
            let key = (from.min(to) as u64) << 32 | from.max(to) as u64;
            let mut slot = (key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize & mask;
            while table[slot].0 != key {
                if table[slot].0 == EMPTY {
                    table[slot].0 = key;
                    break;
                }
                slot = (slot + 1) & mask;
            }
            table[slot].1 += if from < to { 1 } else { -1 };
        }
        table
            .iter()
            .filter(|&&(key, sum)| key != EMPTY && sum != 0)
            .map(|&(key, _)| [(key >> 32) as u32, key as u32])
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::vertex::Vertex;
    use super::*;

    /// Two squares side by side, one cluster each, sharing the edge between (1, 0) and (1, 1).
    #[test]
    fn what_two_groups_share_is_locked_and_the_rest_is_open() {
        let square = |x: i32| {
            [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[dx, y]| Vertex {
                position: [x + dx, y, 0],
                ..Vertex::default()
            })
        };
        let border = [[0, 1, 0, 0], [1, 2, 0, 0], [2, 3, 0, 0], [3, 0, 0, 0]];
        let (left, right) = (square(0), square(1));
        let view = |vertices| ClusterView {
            vertices,
            triangles: &[],
            border: &border,
            materials: &[],
            witnesses: &[],
        };
        let borders = Borders::new(&[view(&left), view(&right)]);
        let rule_at = |rules: &[u8], position: [i32; 3]| {
            let place = borders.places().iter().position(|&own| own == position);
            place.map(|place| rules[place])
        };
        let alone = FixedPlaces::default();
        let apart = borders.rules(&[vec![0], vec![1]], &[], &alone);
        assert_eq!(rule_at(&apart, [1, 0, 0]), Some(LOCKED));
        assert_eq!(rule_at(&apart, [0, 1, 0]), Some(OPEN));
        let together = borders.rules(&[vec![0, 1]], &[], &alone);
        assert_eq!(
            rule_at(&together, [1, 1, 0]),
            Some(OPEN),
            "an end of the open border"
        );
        // Another chunk around the left half: its open edges may be closed there.
        let other = ChunkBounds {
            low: [-5, -5, -5],
            high: [0, 5, 5],
        };
        let beside = borders.rules(&[vec![0, 1]], &[other], &alone);
        assert_eq!(rule_at(&beside, [0, 0, 0]), Some(LOCKED));
        assert_eq!(rule_at(&beside, [2, 0, 0]), Some(OPEN));
    }
}
