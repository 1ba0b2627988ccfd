//! How far two surfaces over the same vertices lie apart: a two-sided Hausdorff distance, all in f64 over exact coordinates.
//!
//! The distance to a surface has its peaks where the other surface bends: at vertices, and where an edge of one crosses
//! an edge of the other. So samples are the vertices that vanished and the centroids and edge midpoints of new triangles (and the
//! centroids of triangles that vanished between vertices that stay); the largest few are climbed to the peak next to them.

use super::triangle_tree::{Point, TriangleTree};

/// Peaks climbed to, each way.
const CLIMBS: usize = 6;
/// Steps of a climb; one that finds nothing higher halves the stride.
const STEPS: usize = 12;
/// A sample of this share of the largest squared distance may still lead to a higher peak.
const CLIMBABLE: f64 = 0.25;
/// Share added for the peaks that no sample stood next to. Tests measure far more densely what is left.
const MARGIN: f64 = 0.05;

/// Distance between `before` and `after`, in units of `positions`, or `floor` where that is larger. Samples much nearer
/// than the largest distance so far are not measured to the end, so a good floor saves time.
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

    let floor = floor / (1.0 + MARGIN);
    let point = |vertex: u32| positions[vertex as usize].map(f64::from);
    let mut worst = floor * floor;
    if !replaced.is_empty() {
        let tree = TriangleTree::new(positions, after);
        let mut peaks = Peaks::new(&tree, worst);
        for vertex in vanished {
            peaks.take(point(vertex), None);
        }
        for (index, corners) in replaced.iter().enumerate() {
            // Where a corner vanished, it is the farthest.
            if corners.iter().all(|&vertex| used[vertex as usize]) {
                peaks.take(mean(&corners.map(point)), Some(index));
            }
        }
        worst = peaks.climb(|index| replaced[index].map(point));
    }
    if !new.is_empty() {
        let tree = TriangleTree::new(positions, before);
        let mut peaks = Peaks::new(&tree, worst);
        for (index, &corners) in new.iter().enumerate() {
            peaks.take(mean(&corners.map(point)), Some(index));
            for side in 0..3 {
                let [a, b] = [corners[side], corners[(side + 1) % 3]];
                // Once for the two triangles of an edge, also across a seam. Edges of one new triangle are old edges.
                if positions[a as usize] < positions[b as usize] {
                    peaks.take(mean(&[point(a), point(b)]), Some(index));
                }
            }
        }
        worst = peaks.climb(|index| new[index].map(point));
    }
    worst.sqrt() * (1.0 + MARGIN)
}

/// The largest distances to a surface so far.
struct Peaks<'a> {
    surface: &'a TriangleTree,
    /// Triangle of the surface that the last sample was near to.
    near: u32,
    worst: f64,
    /// Squared distance, sample, and the triangle it lies on; largest first.
    highest: Vec<(f64, Point, usize)>,
}

impl<'a> Peaks<'a> {
    fn new(surface: &'a TriangleTree, worst: f64) -> Self {
        Self {
            surface,
            near: 0,
            worst,
            highest: Vec::with_capacity(CLIMBS + 1),
        }
    }

    fn distance_squared(&mut self, sample: Point, enough: f64) -> f64 {
        self.surface
            .distance_squared_near(sample, enough, &mut self.near)
    }

    /// Measures a sample; one on a triangle may be climbed from.
    fn take(&mut self, sample: Point, triangle: Option<usize>) {
        let squared = self.distance_squared(sample, CLIMBABLE * self.worst);
        self.worst = self.worst.max(squared);
        let Some(triangle) = triangle else { return };
        let lowest = self.highest.last().filter(|_| self.highest.len() == CLIMBS);
        if squared > CLIMBABLE * self.worst && lowest.is_none_or(|&(lowest, ..)| squared > lowest) {
            let at = self
                .highest
                .partition_point(|&(higher, ..)| higher >= squared);
            self.highest.insert(at, (squared, sample, triangle));
            self.highest.truncate(CLIMBS);
        }
    }

    /// Pattern search over each triangle from its sample (Hooke and Jeeves, 1961); gives the largest squared distance.
    fn climb(mut self, corners: impl Fn(usize) -> [Point; 3]) -> f64 {
        for (mut height, mut at, triangle) in std::mem::take(&mut self.highest) {
            if height < CLIMBABLE * self.worst {
                continue;
            }
            let corners = corners(triangle);
            let mut stride = 0.25;
            for _ in 0..STEPS {
                let towards = corners.map(|corner| {
                    std::array::from_fn(|axis| at[axis] + stride * (corner[axis] - at[axis]))
                });
                let best = towards
                    .into_iter()
                    .map(|sample: Point| (self.distance_squared(sample, height), sample))
                    .max_by(|a, b| a.0.total_cmp(&b.0));
                match best.filter(|&(higher, _)| higher > height) {
                    Some((higher, sample)) => (height, at) = (higher, sample),
                    None => stride *= 0.5,
                }
            }
            self.worst = self.worst.max(height);
        }
        self.worst
    }
}

/// Triangles of `all` that are not among `others`, whichever corner comes first.
fn difference(all: &[[u32; 3]], others: &[[u32; 3]]) -> Vec<[u32; 3]> {
    // A group has some thousands of vertices: three indices fit one word.
    let packed = |[a, b, c]: [u32; 3]| (a as u64) << 42 | (b as u64) << 21 | c as u64;
    let canonical = |&[a, b, c]: &[u32; 3]| {
        packed([a, b, c])
            .min(packed([b, c, a]))
            .min(packed([c, a, b]))
    };
    let mut known: Vec<u64> = others.iter().map(canonical).collect();
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
        assert_eq!(
            distance(&positions, &tent, &flat, 0.0),
            0.25 * (1.0 + MARGIN)
        );
        assert_eq!(distance(&positions, &tent, &tent, 0.0), 0.0);
        assert_eq!(distance(&positions, &tent, &flat, 0.5), 0.5);
        // A side that is missing altogether is seen too: its middle lies off the other three.
        assert!(distance(&positions, &tent, &tent[..3], 0.0) > 0.1);
    }

    #[test]
    fn a_peak_between_the_samples_is_climbed() {
        // One long triangle against two that dip below it off every grid point.
        let positions = [
            [-0.5, 0.0, 0.0],
            [0.5, 0.0, 0.0],
            [0.0, 0.5, 0.0],
            [-0.083, 0.211, -0.1],
        ];
        let flat = [[0, 1, 2]];
        let dip = [[0, 1, 3], [1, 2, 3], [2, 0, 3]];
        let measured = distance(&positions, &dip, &flat, 0.0);
        assert!(
            (0.1..0.1 * (1.0 + 2.0 * MARGIN)).contains(&measured),
            "{measured}"
        );
        // No sample lies on a corner, and none is as far off as the dip is deep.
        assert!(distance(&positions, &flat, &dip, 0.0) > 0.095);
    }
}
