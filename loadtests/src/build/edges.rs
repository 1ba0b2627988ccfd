//! Open edges of a cut: cracks, where the source had none.
//!
//! An edge between two places counts +1 for each triangle along it and -1 for each against it; it is open where the sum is not zero.

use lodestream_server::build::TriangleTree;
use rayon::prelude::*;

use super::dag::ClusterDag;

/// Two places, the smaller first.
type Edge = [u32; 2];

/// Open edges of some triangles, ascending.
pub fn open_edges(triangles: &[[u32; 3]]) -> Vec<Edge> {
    // Smaller place, larger place, direction: one sort brings all uses of an edge together.
    let mut uses: Vec<u64> = Vec::with_capacity(3 * triangles.len());
    for &[a, b, c] in triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            if from != to {
                let (low, high) = (from.min(to) as u64, from.max(to) as u64);
                uses.push(low << 33 | high << 1 | u64::from(from < to));
            }
        }
    }
    uses.par_sort_unstable();
    uses.chunk_by(|a, b| a >> 1 == b >> 1)
        .filter(|same| {
            let along = same.iter().filter(|&&it| it & 1 == 1).count();
            2 * along != same.len()
        })
        .map(|same| [(same[0] >> 33) as u32, (same[0] >> 1) as u32])
        .collect()
}

/// The source's open edges, and how to tell a crack from a border that was simplified.
pub struct SourceBorder<'a> {
    dag: &'a ClusterDag,
    /// Open edges of level 0.
    pub open: Vec<Edge>,
    tree: TriangleTree,
}

impl<'a> SourceBorder<'a> {
    /// Finds the open edges of the source clusters of `dag`.
    pub fn new(dag: &'a ClusterDag) -> Self {
        let open = open_edges(&dag.gather(dag.level_cut(0)));
        let segments: Vec<[u32; 3]> = open.iter().map(|&[a, b]| [a, b, b]).collect();
        Self {
            dag,
            tree: TriangleTree::new(&dag.places, &segments),
            open,
        }
    }

    /// Open edges of a cut that the source does not excuse: all of them where the source is closed; else those that lie
    /// farther from every open edge of the source than the cut's stored error and `slack_metres` (a grid step) allow.
    pub fn opened(&self, cut: &[u32], slack_metres: f64) -> u64 {
        let open = open_edges(&self.dag.gather(cut.iter().copied()));
        if self.open.is_empty() {
            return open.len() as u64;
        }
        let stored = cut.iter().map(|&cluster| self.dag.error_metres(cluster));
        let allowed = stored.fold(0.0, f64::max) * (1.0 + 1e-6) + slack_metres;
        let unexcused = open.par_iter().filter(|&&[a, b]| {
            if self.open.binary_search(&[a, b]).is_ok() {
                return false;
            }
            let [from, to] = [a, b].map(|it| self.dag.places[it as usize].map(f64::from));
            let middle = std::array::from_fn(|axis| 0.5 * (from[axis] + to[axis]));
            [from, middle, to].into_iter().any(|point| {
                let enough = allowed * allowed;
                self.tree.distance_squared(point, enough) > enough
            })
        });
        unexcused.count() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn open_edges_are_those_that_no_opposite_meets() {
        let tetrahedron = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        assert!(open_edges(&tetrahedron).is_empty());
        assert_eq!(open_edges(&tetrahedron[..3]), [[1, 2], [1, 3], [2, 3]]);
        // Twice the same way is as open as once; a triangle and its back are closed.
        assert_eq!(open_edges(&[[0, 1, 2], [0, 1, 2]]).len(), 3);
        assert!(open_edges(&[[0, 1, 2], [2, 1, 0]]).is_empty());
        assert!(open_edges(&[[4, 4, 5]]).is_empty());
    }
}
