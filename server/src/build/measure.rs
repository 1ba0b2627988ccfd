//! How far two surfaces over the same vertices lie apart: a two-sided Hausdorff distance, sampled.
//!
//! Samples are the vertices that vanished and the centroids of replaced triangles against the new surface, and the
//! centroids and edge midpoints of new triangles against the old one. All in f64 over exact coordinates.

use super::triangle_tree::{Point, TriangleTree};

/// Distance between `before` and `after`, in units of `positions`, or `floor` where that is larger. Samples nearer than
/// the largest distance so far are not measured to the end, so a good floor saves time.
pub(super) fn distance(
    positions: &[[f32; 3]],
    before: &[[u32; 3]],
    after: &[[u32; 3]],
    floor: f64,
) -> f64 {
    let replaced = difference(before, after);
    let new = difference(after, before);
    let mut used = vec![false; positions.len()];
    after
        .as_flattened()
        .iter()
        .for_each(|&vertex| used[vertex as usize] = true);
    let mut vanished: Vec<u32> = replaced
        .as_flattened()
        .iter()
        .copied()
        .filter(|&vertex| !used[vertex as usize])
        .collect();
    vanished.sort_unstable();
    vanished.dedup();

    let point = |vertex: u32| positions[vertex as usize].map(f64::from);
    let centroid = |corners: &[u32; 3]| mean(&corners.map(point));
    let mut worst = floor * floor;
    let mut take = |tree: &TriangleTree, sample: Point| {
        worst = worst.max(tree.distance_squared(sample, worst));
    };
    if !replaced.is_empty() {
        let tree = TriangleTree::new(positions, after);
        vanished
            .iter()
            .for_each(|&vertex| take(&tree, point(vertex)));
        replaced
            .iter()
            .for_each(|corners| take(&tree, centroid(corners)));
    }
    if !new.is_empty() {
        let tree = TriangleTree::new(positions, before);
        for corners in &new {
            take(&tree, centroid(corners));
            for side in 0..3 {
                let (a, b) = (corners[side], corners[(side + 1) % 3]);
                take(&tree, mean(&[point(a), point(b)]));
            }
        }
    }
    worst.sqrt()
}

/// Triangles of `all` that are not among `others`, whichever corner comes first.
fn difference(all: &[[u32; 3]], others: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let canonical = |&[a, b, c]: &[u32; 3]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min();
    let mut known: Vec<_> = others.iter().map(canonical).collect();
    known.sort_unstable();
    all.iter()
        .filter(|&corners| known.binary_search(&canonical(corners)).is_err())
        .copied()
        .collect()
}

fn mean<const N: usize>(points: &[Point; N]) -> Point {
    std::array::from_fn(|axis| points.iter().map(|point| point[axis]).sum::<f64>() / N as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flattened_tent_is_as_far_as_it_was_high() {
        // A square pyramid of height 1/4 against the two triangles of its base.
        let positions = [
            [-0.5, -0.5, 0.0],
            [0.5, -0.5, 0.0],
            [0.5, 0.5, 0.0],
            [-0.5, 0.5, 0.0],
            [0.0, 0.0, 0.25],
        ];
        let tent = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
        let flat = [[0, 1, 2], [2, 3, 0]];
        assert_eq!(distance(&positions, &tent, &flat, 0.0), 0.25);
        assert_eq!(distance(&positions, &tent, &tent, 0.0), 0.0);
        assert_eq!(distance(&positions, &tent, &flat, 0.5), 0.5);
        // A side that is missing altogether is seen too: its middle lies off the other three.
        assert!(distance(&positions, &tent, &tent[..3], 0.0) > 0.1);
    }
}
