//! How far two surfaces lie apart, measured in f64 on dense samples, far more densely than a builder measures.

use lodestream_server::build::{Point, TriangleTree};
use rayon::prelude::*;

/// Subdivisions of a triangle's side: 15 samples, corners and edges among them.
const SIDE: u32 = 4;
/// Samples of a triangle.
pub const SAMPLES: usize = 15;
const BATCH: usize = 128;

/// Distance from samples of one surface to the other.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Distance {
    /// Largest, metres.
    pub max_metres: f64,
    /// Root mean square over the area, metres.
    pub rms_metres: f64,
}

impl Distance {
    /// The larger of both ways, figure by figure.
    pub fn worse(self, other: Self) -> Self {
        Self {
            max_metres: self.max_metres.max(other.max_metres),
            rms_metres: self.rms_metres.max(other.rms_metres),
        }
    }
}

/// Triangles between two that are sampled, less one, so that at most about `most_samples` are taken.
pub fn stride(triangles: usize, most_samples: usize) -> usize {
    triangles.div_ceil((most_samples / SAMPLES).max(1)).max(1)
}

/// From 15 samples a triangle (of every so many triangles where that exceeds `most_samples`) to the surface of `to`.
pub fn one_way(
    places: &[[f32; 3]],
    triangles: &[[u32; 3]],
    to: &TriangleTree,
    most_samples: usize,
) -> Distance {
    let stride = stride(triangles.len(), most_samples);
    let sampled: Vec<[u32; 3]> = triangles.iter().step_by(stride).copied().collect();
    // Batches are added up in order: the same figures whatever the thread count.
    let batches: Vec<[f64; 3]> = sampled
        .par_chunks(BATCH)
        .map(|batch| {
            let mut sums = [0.0f64; 3];
            for corners in batch {
                let corners = corners.map(|place| places[place as usize].map(f64::from));
                let area = area(&corners);
                for (point, weight) in samples(&corners) {
                    let squared = to.distance_squared(point, -1.0);
                    sums[0] = sums[0].max(squared);
                    sums[1] += squared * area * weight;
                }
                sums[2] += area;
            }
            sums
        })
        .collect();
    let max = batches.iter().fold(0.0f64, |max, batch| max.max(batch[0]));
    let total = |field: usize| batches.iter().map(|batch| batch[field]).sum::<f64>();
    Distance {
        max_metres: max.sqrt(),
        // Without area there is no mean; then the largest stands for it.
        rms_metres: match total(2) > 0.0 {
            true => (total(1) / total(2)).sqrt(),
            false => max.sqrt(),
        },
    }
}

/// Samples of a triangle and their share of its area (the trapezoid rule).
pub fn samples(corners: &[Point; 3]) -> impl Iterator<Item = (Point, f64)> {
    let corners = *corners;
    (0..=SIDE).flat_map(move |i| {
        (0..=SIDE - i).map(move |j| {
            let k = SIDE - i - j;
            let inner = [i, j, k].iter().filter(|&&it| it > 0).count();
            // A point inside belongs to six small triangles, on an edge to three, a corner to one, a third of each.
            let weight = [0.0, 1.0, 3.0, 6.0][inner] / (3 * SIDE * SIDE) as f64;
            let [u, v, w] = [i, j, k].map(|it| f64::from(it) / f64::from(SIDE));
            let point = std::array::from_fn(|axis| {
                corners[0][axis] * w + corners[1][axis] * u + corners[2][axis] * v
            });
            (point, weight)
        })
    })
}

fn area([a, b, c]: &[Point; 3]) -> f64 {
    let [a, b, c] = [a, b, c].map(|corner| glam::DVec3::from(*corner));
    0.5 * (b - a).cross(c - a).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tilted_plane_has_the_mean_square_of_its_slope() {
        // From a unit right triangle to a plane below it that rises from 0 to 1 along x.
        let places = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 2.0],
            [1.0, 0.0, 2.0],
            [0.0, 1.0, 2.0],
        ];
        let tree = TriangleTree::new(&places, &[[3, 4, 5]]);
        let distance = one_way(&places, &[[0, 1, 2]], &tree, usize::MAX);
        assert_eq!((distance.max_metres, distance.rms_metres), (2.0, 2.0));
        let same = one_way(&places, &[[3, 4, 5]], &tree, usize::MAX);
        assert_eq!((same.max_metres, same.rms_metres), (0.0, 0.0));
        let weights: f64 = samples(&[[0.0; 3]; 3]).map(|(_, weight)| weight).sum();
        assert!((weights - 1.0).abs() < 1e-12);
        assert_eq!(samples(&[[0.0; 3]; 3]).count(), SAMPLES);
    }

    #[test]
    fn strides_keep_to_the_samples() {
        assert_eq!(stride(1000, usize::MAX), 1);
        assert_eq!(stride(1000, 15_000), 1);
        assert_eq!(stride(1001, 15_000), 2);
        assert_eq!(stride(0, 0), 1);
    }
}
