//! Shape: the triangles of a cluster for nearest distances, in f32, four at a time.

use glam::Vec4;

use super::simplify::{Four, gather, to_triangles};

/// Fours of triangles of a run.
const RUN: usize = 2;

/// Four boxes, axis by axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct FourBoxes {
    low: [Vec4; 3],
    high: [Vec4; 3],
}

/// The triangles of one cluster; in the order that they have, near ones follow each other.
#[derive(Debug, Default)]
pub(super) struct Shape {
    fours: Vec<Four>,
    /// Boxes of the runs of fours.
    runs: Vec<FourBoxes>,
    /// Where the last search ended.
    near: usize,
}

impl FourBoxes {
    /// Infinitely far from everything.
    pub const NOTHING: Self = Self {
        low: [Vec4::INFINITY; 3],
        high: [Vec4::INFINITY; 3],
    };

    /// Sets one of the boxes.
    pub fn set(&mut self, lane: usize, low: [f32; 3], high: [f32; 3]) {
        for axis in 0..3 {
            self.low[axis][lane] = low[axis];
            self.high[axis][lane] = high[axis];
        }
    }

    /// Squared distances from a point.
    #[inline(always)]
    pub fn squared(&self, at: [f32; 3]) -> [f32; 4] {
        let mut squared = Vec4::ZERO;
        for axis in 0..3 {
            let own = Vec4::splat(at[axis]);
            let outside = (self.low[axis] - own).max(own - self.high[axis]);
            let outside = outside.max(Vec4::ZERO);
            squared += outside * outside;
        }
        squared.to_array()
    }
}

impl Shape {
    /// Takes up triangles over `positions`.
    pub fn set(&mut self, positions: &[[f32; 3]], triangles: &[[u8; 4]]) {
        self.fours.clear();
        self.runs.clear();
        self.near = 0;
        let corner = |vertex: u8| {
            let [x, y, z] = positions[vertex as usize];
            Vec4::new(x, y, z, 0.0)
        };
        for (number, run) in triangles.chunks(4 * RUN).enumerate() {
            let (mut low, mut high) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
            for four in run.chunks(4) {
                let corners: [[Vec4; 3]; 4] = std::array::from_fn(|lane| {
                    let [a, b, c, _] = four[lane.min(four.len() - 1)];
                    [a, b, c].map(corner)
                });
                for &corner in corners.as_flattened() {
                    (low, high) = (low.min(corner), high.max(corner));
                }
                self.fours.push(gather(corners.each_ref()));
            }
            if number % 4 == 0 {
                self.runs.push(FourBoxes::NOTHING);
            }
            if let Some(boxes) = self.runs.last_mut() {
                let [low, high] = [low, high].map(|at| at.truncate().to_array());
                boxes.set(number % 4, low, high);
            }
        }
    }

    /// Squared distance to the nearest triangle, or `most` where none is nearer than that. Any that
    /// is not above `enough` stands for every other such one.
    pub fn nearest(&mut self, at: [f32; 3], enough: f32, most: f32) -> f32 {
        let mut best = most;
        self.look_at(self.near, at, &mut best);
        for four_runs in 0..self.runs.len() {
            let distances = self.runs[four_runs].squared(at);
            for (run, distance) in (4 * four_runs..).zip(distances) {
                for four in RUN * run..(RUN * (run + 1)).min(self.fours.len()) {
                    if best <= enough {
                        return best;
                    }
                    if distance >= best {
                        break;
                    }
                    self.look_at(four, at, &mut best);
                }
            }
        }
        best
    }

    #[inline(always)]
    fn look_at(&mut self, four: usize, at: [f32; 3], best: &mut f32) {
        let Some(corners) = self.fours.get(four) else {
            return;
        };
        let nearest = to_triangles(at, corners).min_element();
        if nearest < *best {
            (*best, self.near) = (nearest, four);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_is_the_minimum_over_all_triangles() {
        let value = |k: u32| (k.wrapping_mul(2654435761) >> 24) as f32 / 128.0 - 1.0;
        let point = |k: u32| [value(3 * k), value(3 * k + 1), value(3 * k + 2)];
        for count in [1u8, 4, 5, 17, 80] {
            let positions: Vec<[f32; 3]> = (0..=count as u32 + 2).map(point).collect();
            let triangles: Vec<[u8; 4]> = (0..count).map(|i| [i, i + 1, i + 2, 0]).collect();
            let mut shape = Shape::default();
            shape.set(&positions, &triangles);
            for number in 0..50 {
                let at = point(1000 + number);
                let brute = triangles.iter().map(|triangle| {
                    let corners = [0, 1, 2].map(|corner| {
                        let [x, y, z] = positions[triangle[corner] as usize];
                        Vec4::new(x, y, z, 0.0)
                    });
                    to_triangles(at, &gather([&corners; 4])).x
                });
                let brute = brute.fold(f32::INFINITY, f32::min);
                assert_eq!(
                    shape.nearest(at, 0.0, f32::INFINITY),
                    brute,
                    "{count} {number}"
                );
                assert_eq!(shape.nearest(at, 0.0, 0.5 * brute), 0.5 * brute);
                assert!(shape.nearest(at, 2.0 * brute, f32::INFINITY) <= 2.0 * brute);
            }
        }
    }
}
