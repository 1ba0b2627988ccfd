//! Nearest distance from points to triangles: a four-wide tree of boxes over triangles in Morton order.

/// A point, in the unit of the triangles' positions.
pub type Point = [f64; 3];

const WIDTH: usize = 4;

#[derive(Debug, Clone, Copy)]
struct Bounds {
    min: [f32; 3],
    max: [f32; 3],
}

/// Four boxes, coordinate by coordinate; unused ones are infinitely far.
#[derive(Debug, Clone, Copy)]
struct FourBounds {
    min: [[f32; WIDTH]; 3],
    max: [[f32; WIDTH]; 3],
}

/// Triangles for nearest-distance queries: what the builder measures its error with, and tests and reports likewise.
#[derive(Debug)]
pub struct TriangleTree {
    /// Number of each triangle in the list that was given.
    numbers: Vec<u32>,
    corners: Vec<[Point; 3]>,
    /// Boxes of triangles, of fours of triangles, and so on; the last level has one four.
    levels: Vec<Vec<FourBounds>>,
}

impl TriangleTree {
    /// Builds the tree. Panics where a triangle names a vertex that is not there.
    pub fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let at = |vertex: u32| positions[vertex as usize];
        let corners = || triangles.iter().map(|corners| around(&corners.map(at)));
        let bounds = merge(&corners().collect::<Vec<_>>());
        let mut order: Vec<(u32, u32)> = corners()
            .zip(0..)
            .map(|(own, index)| (morton(&own, &bounds), index))
            .collect();
        order.sort_unstable();
        let sorted = || {
            order
                .iter()
                .map(|&(_, index)| triangles[index as usize].map(at))
        };
        let mut row: Vec<Bounds> = sorted().map(|corners| around(&corners)).collect();
        let mut levels = Vec::new();
        while !row.is_empty() {
            levels.push(row.chunks(WIDTH).map(gather).collect());
            if row.len() <= WIDTH {
                break;
            }
            row = row.chunks(WIDTH).map(merge).collect();
        }
        Self {
            numbers: order.iter().map(|&(_, index)| index).collect(),
            corners: sorted()
                .map(|corners| corners.map(|corner| corner.map(f64::from)))
                .collect(),
            levels,
        }
    }

    /// Squared distance from `point` to the nearest triangle; any value not above `enough` stands for every other one.
    /// Infinite without triangles.
    pub fn distance_squared(&self, point: Point, enough: f64) -> f64 {
        self.distance_squared_near(point, enough, &mut 0)
    }

    /// Squared distance from `point` to the nearest triangle, and its number; `None` without triangles.
    pub(super) fn nearest(&self, point: Point) -> Option<(f64, u32)> {
        let mut hint = 0;
        let squared = self.distance_squared_near(point, 0.0, &mut hint);
        Some((squared, *self.numbers.get(hint as usize)?))
    }

    /// The same. `hint` is a triangle to start from, the nearer the faster, and becomes the one that was found: samples
    /// in a row lie near each other.
    pub(super) fn distance_squared_near(&self, point: Point, enough: f64, hint: &mut u32) -> f64 {
        let Some(first) = self.corners.get(*hint as usize) else {
            return f64::INFINITY;
        };
        let mut nearest = to_triangle(point, first);
        let mut stack = [(0u32, 0u32, 0.0f64); 64];
        stack[0] = (self.levels.len() as u32, 0, 0.0);
        let mut depth = 1;
        while depth > 0 && nearest > enough {
            depth -= 1;
            let (level, index, distance) = stack[depth];
            if distance >= nearest {
                continue;
            }
            if level == 0 {
                let own = to_triangle(point, &self.corners[index as usize]);
                if own < nearest {
                    (nearest, *hint) = (own, index);
                }
                continue;
            }
            let four = &self.levels[level as usize - 1][index as usize];
            let distances = to_bounds(point, four);
            let from = depth;
            for (lane, &distance) in distances.iter().enumerate() {
                let child = index as usize * WIDTH + lane;
                if distance < nearest {
                    // At most three more a level and 17 levels: 2^32 triangles. Nearest last, since it is taken first.
                    let mut at = depth;
                    while at > from && stack[at - 1].2 < distance {
                        stack[at] = stack[at - 1];
                        at -= 1;
                    }
                    stack[at] = (level - 1, child as u32, distance);
                    depth += 1;
                }
            }
        }
        nearest
    }
}

/// Code of the middle of `own` inside `all`.
fn morton(own: &Bounds, all: &Bounds) -> u32 {
    let spread = |value: u32| {
        // Ten bits to every third (Morton order; e.g. Warren, "Hacker's Delight", 7).
        let mut value = value & 0x3ff;
        value = (value | value << 16) & 0x030000ff;
        value = (value | value << 8) & 0x0300f00f;
        value = (value | value << 4) & 0x030c30c3;
        (value | value << 2) & 0x09249249
    };
    (0..3).fold(0, |code, axis| {
        let middle = 0.5 * (own.min[axis] + own.max[axis]) - all.min[axis];
        let extent = all.max[axis] - all.min[axis];
        // 0 where there is no extent: the cast takes NaN to 0.
        code | spread((middle / extent * 1023.0) as u32) << axis
    })
}

fn around(corners: &[[f32; 3]; 3]) -> Bounds {
    let [a, b, c] = corners;
    Bounds {
        min: std::array::from_fn(|axis| a[axis].min(b[axis]).min(c[axis])),
        max: std::array::from_fn(|axis| a[axis].max(b[axis]).max(c[axis])),
    }
}

fn merge(all: &[Bounds]) -> Bounds {
    let none = Bounds {
        min: [f32::MAX; 3],
        max: [f32::MIN; 3],
    };
    all.iter().fold(none, |sum, next| Bounds {
        min: std::array::from_fn(|axis| sum.min[axis].min(next.min[axis])),
        max: std::array::from_fn(|axis| sum.max[axis].max(next.max[axis])),
    })
}

fn gather(boxes: &[Bounds]) -> FourBounds {
    let lane = |lane: usize, pick: fn(&Bounds) -> [f32; 3], axis: usize| {
        boxes
            .get(lane)
            .map_or(f32::INFINITY, |bounds| pick(bounds)[axis])
    };
    FourBounds {
        min: std::array::from_fn(|axis| {
            std::array::from_fn(|i| lane(i, |bounds| bounds.min, axis))
        }),
        max: std::array::from_fn(|axis| {
            std::array::from_fn(|i| lane(i, |bounds| bounds.max, axis))
        }),
    }
}

fn to_bounds(point: Point, four: &FourBounds) -> [f64; WIDTH] {
    let mut sums = [0.0; WIDTH];
    for axis in 0..3 {
        for lane in 0..WIDTH {
            let below = four.min[axis][lane] as f64 - point[axis];
            let above = point[axis] - four.max[axis][lane] as f64;
            let outside = below.max(above).max(0.0);
            sums[lane] += outside * outside;
        }
    }
    sums
}

/// Squared distance from a point to a triangle; also right for triangles without area.
pub(super) fn to_triangle(point: Point, [a, b, c]: &[Point; 3]) -> f64 {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(&point, a));
    let normal = cross(&ab, &ac);
    let length = dot(&normal, &normal);
    if length > 0.0 {
        // Barycentric coordinates of the projection (Ericson, "Real-Time Collision Detection", 3.4), unscaled.
        let v = dot(&cross(&ap, &ac), &normal);
        let w = dot(&cross(&ab, &ap), &normal);
        if v >= 0.0 && w >= 0.0 && v + w <= length {
            return dot(&ap, &normal).powi(2) / length;
        }
    }
    to_segment(&point, a, b)
        .min(to_segment(&point, b, c))
        .min(to_segment(&point, c, a))
}

fn to_segment(point: &Point, a: &Point, b: &Point) -> f64 {
    let (ab, ap) = (sub(b, a), sub(point, a));
    let length = dot(&ab, &ab);
    let along = if length > 0.0 {
        (dot(&ap, &ab) / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (0..3)
        .map(|axis| (ap[axis] - along * ab[axis]).powi(2))
        .sum()
}

fn sub(a: &Point, b: &Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: &Point, b: &Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: &Point, b: &Point) -> Point {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn coordinates() -> impl Strategy<Value = [f32; 3]> {
        // Few values, so that degenerate triangles and ties are common.
        prop::array::uniform3((-4i32..=4).prop_map(|value| value as f32 / 8.0))
    }

    proptest! {
        #[test]
        fn nearest_is_the_minimum_over_all(
            positions in prop::collection::vec(coordinates(), 60),
            count in 1usize..20,
            sample in coordinates(),
        ) {
            let triangles: Vec<[u32; 3]> = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            let tree = TriangleTree::new(&positions, &triangles);
            let point = sample.map(f64::from);
            let brute = triangles
                .iter()
                .map(|t| to_triangle(point, &t.map(|v| positions[v as usize].map(f64::from))))
                .fold(f64::INFINITY, f64::min);
            prop_assert_eq!(tree.distance_squared(point, -1.0), brute);
            prop_assert!(tree.distance_squared(point, brute + 0.1) <= brute + 0.1);
        }

        /// No point of the triangle is nearer than the distance says, and one is that near.
        #[test]
        fn triangle_distance_bounds_every_sample(corners in prop::array::uniform3(coordinates()), sample in coordinates()) {
            let corners = corners.map(|corner| corner.map(f64::from));
            let point = sample.map(f64::from);
            let distance = to_triangle(point, &corners).sqrt();
            let mut nearest = f64::INFINITY;
            for i in 0..=40 {
                for j in 0..=40 - i {
                    let (u, v) = (i as f64 / 40.0, j as f64 / 40.0);
                    let on: Point = std::array::from_fn(|axis| {
                        corners[0][axis] * (1.0 - u - v) + corners[1][axis] * u + corners[2][axis] * v
                    });
                    let gap = sub(&on, &point);
                    nearest = nearest.min(dot(&gap, &gap).sqrt());
                }
            }
            prop_assert!(distance <= nearest + 1e-12);
            prop_assert!(distance >= nearest - 0.05);
        }
    }
}
