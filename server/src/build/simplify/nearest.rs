//! Nearest: distances from points to triangles near them, in f32, four triangles at a time: what a witness is measured with.

use glam::{BVec4A, Mat4, Vec3, Vec4};

use super::quadric::{dot, sub};

/// A walk may end in a hollow: what it found is held against everything where it is more than this times what is enough.
const SURE: f32 = 1.2;

/// Corners of four triangles, by corner and axis.
pub(in super::super) type Four = [[Vec4; 3]; 3];

/// Triangles between numbered places, with what is needed to walk from one to the next.
#[derive(Debug, Default)]
pub(super) struct Patch {
    triangles: Vec<[u16; 3]>,
    /// Corners of each; the fourth number is 0.
    corners: Vec<[Vec4; 3]>,
    /// Where the triangles of each place begin in `around`, and end.
    first: Vec<u16>,
    around: Vec<u16>,
    /// Number of the query that last looked at each triangle.
    seen: Vec<u32>,
    query: u32,
}

impl Patch {
    /// Takes up triangles over `positions`.
    pub fn set(&mut self, positions: &[[f32; 3]], triangles: impl Iterator<Item = [u16; 3]>) {
        self.triangles.clear();
        self.triangles.extend(triangles);
        let count = self.triangles.len();
        self.seen.clear();
        self.seen.resize(count, 0);
        self.query = 0;
        self.corners.clear();
        let corner = |&place: &u16| Vec3::from(positions[place as usize]).extend(0.0);
        let corners = |places: &[u16; 3]| places.each_ref().map(corner);
        self.corners.extend(self.triangles.iter().map(corners));
        // Ends of the lists first; filling them from behind turns these into their beginnings.
        self.first.clear();
        self.first.resize(positions.len() + 1, 0);
        for place in self.triangles.as_flattened() {
            self.first[*place as usize] += 1;
        }
        let mut end = 0;
        for first in &mut self.first {
            end += *first;
            *first = end;
        }
        self.around.clear();
        self.around.resize(3 * count, 0);
        for (triangle, places) in self.triangles.iter().enumerate() {
            for place in places {
                let first = &mut self.first[*place as usize];
                *first -= 1;
                self.around[*first as usize] = triangle as u16;
            }
        }
    }

    /// Places of the triangles.
    pub fn triangles(&self) -> impl Iterator<Item = [u16; 3]> {
        self.triangles.iter().copied()
    }

    /// Places of a triangle.
    pub fn places(&self, triangle: usize) -> [u16; 3] {
        self.triangles[triangle]
    }

    /// Squared distance of each of four points to a triangle of its own.
    pub fn to_own(&self, points: [[f32; 3]; 4], triangles: [usize; 4]) -> [f32; 4] {
        let [a, b, c, d] = points.map(|at| Vec3::from(at).extend(0.0));
        let at = Mat4::from_cols(a, b, c, d).transpose();
        let four = gather(triangles.map(|triangle| &self.corners[triangle]));
        from_points([at.x_axis, at.y_axis, at.z_axis], &four).to_array()
    }

    /// Whether some triangle is at a place.
    pub fn holds(&self, place: u16) -> bool {
        self.first[place as usize] < self.first[place as usize + 1]
    }

    /// Squared distance to the nearest triangle and its number; `None` where no triangle is at any of the `places`. The walk
    /// goes from there from triangle to triangle as long as that brings it nearer. Any value not above `enough` stands for
    /// every other one; one that is not above `doubtful` may be too large.
    pub fn nearest(
        &mut self,
        at: [f32; 3],
        places: &[u16],
        enough: f32,
        doubtful: f32,
    ) -> Option<(f32, usize)> {
        self.query += 1;
        let mut best = (f32::INFINITY, usize::MAX);
        self.visit(at, places, enough, &mut best);
        loop {
            let before = best.0;
            if before <= enough {
                return Some(best);
            }
            let next = *self.triangles.get(best.1)?;
            self.visit(at, &next, enough, &mut best);
            if best.0 >= before {
                break;
            }
        }
        if best.0 > SURE * doubtful {
            self.search(at, doubtful, &mut best);
        }
        Some(best)
    }

    /// Looks at the triangles at some places that this query has not looked at.
    fn visit(&mut self, at: [f32; 3], places: &[u16], enough: f32, best: &mut (f32, usize)) {
        let mut four = [usize::MAX; 4];
        let mut count = 0;
        for &place in places {
            let [first, end] = [0, 1].map(|next| self.first[place as usize + next] as usize);
            for &triangle in &self.around[first..end] {
                let triangle = triangle as usize;
                if std::mem::replace(&mut self.seen[triangle], self.query) == self.query {
                    continue;
                }
                four[count] = triangle;
                count += 1;
                if count == 4 {
                    self.take_nearest(at, four, best);
                    if best.0 <= enough {
                        return;
                    }
                    count = 0;
                }
            }
        }
        if count > 0 {
            // The other lanes hold triangles that have been looked at, or are filled up with one that is.
            let own = four[0];
            four.iter_mut()
                .filter(|other| **other == usize::MAX)
                .for_each(|other| *other = own);
            self.take_nearest(at, four, best);
        }
    }

    /// Looks at all triangles.
    fn search(&self, at: [f32; 3], enough: f32, best: &mut (f32, usize)) {
        let last = self.triangles.len() - 1;
        for first in (0..self.triangles.len()).step_by(4) {
            self.take_nearest(at, [0, 1, 2, 3].map(|lane| (first + lane).min(last)), best);
            if best.0 <= enough {
                return;
            }
        }
    }

    /// Makes the nearest of four triangles the best if it is nearer.
    fn take_nearest(&self, at: [f32; 3], four: [usize; 4], best: &mut (f32, usize)) {
        let squared = to_triangles(at, &gather(four.map(|triangle| &self.corners[triangle])));
        if let Some((squared, lane)) = nearer(squared, best.0) {
            *best = (squared, four[lane]);
        }
    }
}

/// The least of four squared distances and its lane, if it is less than `best`.
#[inline(always)]
pub(super) fn nearer(squared: Vec4, best: f32) -> Option<(f32, usize)> {
    let least = squared.min_element();
    let lanes = squared.cmpeq(Vec4::splat(least)).bitmask();
    (least < best).then_some((least, lanes.trailing_zeros() as usize))
}

/// Four triangles' corners side by side.
#[inline(always)]
pub(in super::super) fn gather([a, b, c, d]: [&[Vec4; 3]; 4]) -> Four {
    [0, 1, 2].map(|corner| {
        let axes = Mat4::from_cols(a[corner], b[corner], c[corner], d[corner]).transpose();
        [axes.x_axis, axes.y_axis, axes.z_axis]
    })
}

/// Squared distances from a point to four triangles (Ericson, "Real-Time Collision Detection", 3.4 and 5.1.5).
#[inline]
pub(in super::super) fn to_triangles(at: [f32; 3], four: &Four) -> Vec4 {
    from_points(at.map(Vec4::splat), four)
}

/// The same from four points, each to one of the triangles.
#[inline(always)]
fn from_points(at: [Vec4; 3], &[a, b, c]: &Four) -> Vec4 {
    let (ab, ac, ap) = (sub4(b, a), sub4(c, a), sub4(at, a));
    let (bc, bp) = (sub4(c, b), sub4(at, b));
    let normal = cross4(ab, ac);
    let square = dot4(normal, normal);
    let height = dot4(ap, normal);
    let v = dot4(cross4(ap, ac), normal);
    let w = dot4(cross4(ab, ap), normal);
    let zero = Vec4::ZERO;
    let inside: BVec4A = v.cmpge(zero) & w.cmpge(zero) & (v + w).cmple(square) & square.cmpgt(zero);
    let edges = to_segments(ap, ab)
        .min(to_segments(bp, bc))
        .min(to_segments(ap, ac));
    Vec4::select(inside, height * height / square, edges)
}

/// Squared lengths of the ways from the nearest points of segments, which begin at the origin.
fn to_segments(point: [Vec4; 3], end: [Vec4; 3]) -> Vec4 {
    let square = dot4(end, end);
    // One without length is a point: 0 over a small number.
    let along = dot4(point, end) / square.max(Vec4::splat(f32::MIN_POSITIVE));
    let along = along.max(Vec4::ZERO).min(Vec4::ONE);
    let away = sub4(point, end.map(|axis| axis * along));
    dot4(away, away)
}

fn sub4(a: [Vec4; 3], b: [Vec4; 3]) -> [Vec4; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot4(a: [Vec4; 3], b: [Vec4; 3]) -> Vec4 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross4(a: [Vec4; 3], b: [Vec4; 3]) -> [Vec4; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

pub(super) fn middle(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|axis| 0.5 * (a[axis] + b[axis]))
}

pub(super) fn to_segment(point: [f32; 3], a: [f32; 3], b: [f32; 3]) -> f32 {
    let (ab, ap) = (sub(b, a), sub(point, a));
    let square = dot(ab, ab);
    let along = match square > 0.0 {
        true => (dot(ap, ab) / square).clamp(0.0, 1.0),
        false => 0.0,
    };
    let away = sub(ap, ab.map(|value| value * along));
    dot(away, away)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point and a triangle from a few bytes of a counter, needles and single points among them.
    fn case(number: u32) -> ([f32; 3], [[f32; 3]; 3]) {
        let value = |k: u32| ((number * 12 + k).wrapping_mul(2654435761) >> 28) as f32 / 8.0 - 1.0;
        let at = |k| [value(k), value(k + 1), value(k + 2)];
        (
            at(0),
            [
                at(3),
                at(6),
                if number.is_multiple_of(16) {
                    at(6)
                } else {
                    at(9)
                },
            ],
        )
    }

    fn four_numbers(corners: [[f32; 3]; 3]) -> [Vec4; 3] {
        corners.map(|[x, y, z]| Vec4::new(x, y, z, 0.0))
    }

    /// Nearest of many points of a triangle, in f64.
    fn brute(at: [f32; 3], corners: [[f32; 3]; 3]) -> f64 {
        const STEPS: u32 = 64;
        let [p, a, b, c] = [at, corners[0], corners[1], corners[2]].map(|own| own.map(f64::from));
        let mut least = f64::INFINITY;
        for i in 0..=STEPS {
            for j in 0..=STEPS - i {
                let (u, v) = (i as f64 / STEPS as f64, j as f64 / STEPS as f64);
                let away = |k: usize| a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]) - p[k];
                least = least.min((0..3).map(|k| away(k).powi(2)).sum());
            }
        }
        least
    }

    #[test]
    fn four_distances_are_those_of_sampled_triangles() {
        for number in 0..500 {
            let (at, _) = case(number);
            let four = [0, 1, 2, 3].map(|lane| four_numbers(case(number + lane).1));
            for (lane, found) in to_triangles(at, &gather(four.each_ref()))
                .to_array()
                .into_iter()
                .enumerate()
            {
                let expected = brute(at, case(number + lane as u32).1).sqrt();
                let found = (found as f64).sqrt();
                // Samples lie up to a step of the longest side apart.
                assert!(
                    found <= expected + 1e-3 && found >= expected - 4.0 / 64.0,
                    "case {number} lane {lane}: {found} for {expected}"
                );
            }
        }
    }

    #[test]
    fn a_walk_finds_what_a_search_finds() {
        // A strip of triangles over a parabola.
        let positions: Vec<[f32; 3]> = (0..40)
            .map(|i| {
                let x = (i / 2) as f32 / 10.0 - 1.0;
                [x, (i % 2) as f32, x * x]
            })
            .collect();
        let triangles: Vec<[u16; 3]> = (0..38).map(|i| [i, i + 1, i + 2]).collect();
        let mut patch = Patch::default();
        patch.set(&positions, triangles.iter().copied());
        for number in 0..200 {
            let (at, _) = case(number);
            let brute = triangles.iter().map(|corners| {
                let own = four_numbers(corners.map(|place| positions[place as usize]));
                to_triangles(at, &gather([&own; 4])).x
            });
            let expected = brute.fold(f32::INFINITY, f32::min);
            let found = patch
                .nearest(at, &[0], 0.0, 0.0)
                .expect("triangles at place 0");
            assert_eq!(found.0, expected, "case {number}");
        }
        patch.set(&positions, triangles[..4].iter().copied());
        assert_eq!(patch.nearest([0.0; 3], &[30], 0.0, 0.0), None);
    }

    #[test]
    fn four_points_are_measured_each_to_its_own_triangle() {
        let corners = |number| case(number).1;
        let positions: Vec<[f32; 3]> = (0..4).flat_map(corners).collect();
        let mut patch = Patch::default();
        patch.set(&positions, (0..4).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]));
        let points = [0, 1, 2, 3].map(|number| case(50 + number).0);
        let triangles = [2, 0, 3, 0];
        let found = patch.to_own(points, triangles);
        for lane in 0..4 {
            let own = four_numbers(corners(triangles[lane] as u32));
            assert_eq!(
                found[lane],
                to_triangles(points[lane], &gather([&own; 4])).x
            );
        }
    }

    #[test]
    fn the_first_of_the_least_lanes_is_taken_where_it_is_less() {
        let lanes = Vec4::new(3.0, 1.0, 2.0, 1.0);
        assert_eq!(nearer(lanes, 1.5), Some((1.0, 1)));
        assert_eq!(nearer(lanes, 1.0), None);
    }
}
