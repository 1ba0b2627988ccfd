//! The boundary of a set of triangles as a signed chain of edges: what proves that a replacement opens no crack.
//!
//! An edge between two places counts +1 for each triangle that runs along it and -1 for each that runs against it. The
//! chain of a union is the sum of the chains, and moving vertices maps the chain as it maps the triangles. So if a group's
//! simplified triangles have the chain of its members, every cut has the chain of the source: no edge is open that was
//! closed, and no open edge moves.

use std::collections::HashSet;

use super::quantize::{QuantizedMesh, Triangle};

/// Two places as one number, the smaller in the high half.
pub(super) type Edge = u64;

/// Edges with the sum of their signs, ascending, without zeros.
pub(super) type Chain = Vec<(Edge, i32)>;

/// The chain of triangles given by the places of their corners.
pub(super) fn chain(triangles: impl Iterator<Item = [u32; 3]>) -> Chain {
    let mut sides: Vec<u64> = Vec::with_capacity(3 * triangles.size_hint().0);
    for corners in triangles {
        for side in 0..3 {
            let (a, b) = (corners[side], corners[(side + 1) % 3]);
            if a != b {
                // The lowest bit holds the direction; places lie below 2^31.
                let (low, high) = (a.min(b) as u64, a.max(b) as u64);
                sides.push(low << 32 | high << 1 | u64::from(a > b));
            }
        }
    }
    sides.sort_unstable();
    let mut chain = Chain::new();
    for run in sides.chunk_by(|a, b| a >> 1 == b >> 1) {
        let against = run.iter().filter(|&&side| side & 1 == 1).count();
        let sum = run.len() as i32 - 2 * against as i32;
        if sum != 0 {
            chain.push((run[0] >> 32 << 32 | (run[0] & 0xffff_ffff) >> 1, sum));
        }
    }
    chain
}

/// Places at the ends of an edge.
pub(super) fn ends(edge: Edge) -> [u32; 2] {
    [(edge >> 32) as u32, edge as u32]
}

/// The open edges of a whole surface and the places on them.
#[derive(Debug)]
pub(super) struct OpenEdges {
    edges: HashSet<Edge>,
    /// Whether each place lies on an open edge.
    pub on_open_edge: Vec<bool>,
}

impl OpenEdges {
    /// Finds the open edges of `triangles`, which cover the whole surface.
    pub fn of<'a>(mesh: &QuantizedMesh, triangles: impl Iterator<Item = &'a Triangle>) -> Self {
        let chain = chain(triangles.map(|triangle| mesh.places_of(triangle)));
        let mut on_open_edge = vec![false; mesh.places.len()];
        for &(edge, _) in &chain {
            for place in ends(edge) {
                on_open_edge[place as usize] = true;
            }
        }
        Self {
            edges: chain.into_iter().map(|(edge, _)| edge).collect(),
            on_open_edge,
        }
    }

    /// Whether `after` may replace `before` when open edges may move: edges that another group shares keep their sums.
    pub fn only_open_edges_moved(&self, before: &Chain, after: &Chain) -> bool {
        let touches = before.iter().any(|(edge, _)| self.edges.contains(edge));
        let kept = |&(edge, sum): &(Edge, i32)| {
            self.edges.contains(&edge)
                || after
                    .binary_search_by_key(&edge, |&(edge, _)| edge)
                    .is_ok_and(|at| after[at].1 == sum)
        };
        touches && before.iter().all(kept)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_has_its_four_sides_and_an_edge_collapse_inside_keeps_them() {
        // Four triangles round a middle (4), and the two that are left when the middle moves onto corner 0.
        let fan = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
        let flat = [[1, 2, 0], [2, 3, 0]];
        let sides = chain(fan.into_iter());
        assert_eq!(
            sides
                .iter()
                .map(|&(edge, _)| ends(edge))
                .collect::<Vec<_>>(),
            [[0, 1], [0, 3], [1, 2], [2, 3]]
        );
        assert_eq!(
            sides.iter().map(|&(_, sum)| sum).collect::<Vec<_>>(),
            [1, -1, 1, 1]
        );
        assert_eq!(sides, chain(flat.into_iter()));
        // A missing triangle, one twice, and one turned over all show.
        assert_ne!(sides, chain(fan[..3].iter().copied()));
        assert_ne!(sides, chain(fan.into_iter().chain([fan[0]])));
        assert_ne!(sides, chain([[1, 2, 0], [2, 0, 3]].into_iter()));
        // Two sheets back to back bound nothing.
        assert!(chain([[7, 8, 9], [7, 9, 8]].into_iter()).is_empty());
    }
}
