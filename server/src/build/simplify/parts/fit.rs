//! Fit: one part grown so that it stands for itself and another.
//!
//! It is mapped affinely: its main axes onto those of both surfaces together, as long as both
//! reach, and as wide as keeps the area of both. Cook et al., "Stochastic Simplification of
//! Aggregate Detail", 2007, scale by the root of the share that stays; a strip from one leaf to
//! the other lies half as far from either as they lie apart.

use glam::{DMat3, DVec3};

use super::super::super::triangle_tree::to_triangle;
use super::super::group::GroupMesh;
use super::{Corners, Part, at, square, sums};

/// Sweeps of Jacobi's method, three rotations each; four leave nothing in f64.
const SWEEPS: usize = 5;
/// A part thinner than this share of its length has one axis.
const THIN: f64 = 1e-3;
/// Corrections of the width: each leaves a fraction of what the area is off.
const CORRECTIONS: usize = 3;
/// Samples of a side at most.
const MOST_SAMPLES: f64 = 8.0;

/// A map of a part.
#[derive(Debug, Clone, Copy)]
pub(super) struct Growth {
    pub from: DVec3,
    pub to: DVec3,
    pub turn: DMat3,
}

/// A part where a growth takes it.
pub(super) struct Grown {
    pub growth: Growth,
    /// Its places and where they move to.
    pub places: Vec<(u16, [i32; 3])>,
    pub triangles: Vec<Corners>,
}

impl Growth {
    /// Larger about a point.
    pub fn about(center: DVec3, scale: f64) -> Self {
        Self {
            from: center,
            to: center,
            turn: DMat3::from_diagonal(DVec3::splat(scale)),
        }
    }

    /// Ways to grow a part so that it stands for another too: from end to end of both, or where
    /// it is.
    pub fn of_pair(stays: &Part, goes: &Part) -> impl Iterator<Item = Self> {
        let scale = ((stays.area + goes.area) / stays.area).sqrt();
        let in_place = Self::about(stays.center, scale);
        Self::spanning(stays, goes).into_iter().chain([in_place])
    }

    fn spanning(stays: &Part, goes: &Part) -> Option<Self> {
        let area = stays.area + goes.area;
        let shares = [stays, goes].map(|part| part.area / area);
        let center = stays.center * shares[0] + goes.center * shares[1];
        let moments = |part: &Part| part.spread + square(part.center - center);
        let all = moments(stays) * shares[0] + moments(goes) * shares[1];
        let (own, mut new) = (axes(stays.spread), axes(all));
        for k in 0..2 {
            if new.col(k).dot(own.col(k)) < 0.0 {
                *new.col_mut(k) = -new.col(k);
            }
        }
        *new.col_mut(2) = new.col(0).cross(new.col(1));
        let corners = stays.surface.as_flattened().iter();
        let (low, high) = range(corners.map(|&at| (at - stays.center).dot(own.col(0))));
        let points = stays.points.iter().chain(&goes.points);
        let (from, to) = range(points.map(|&at| (at - center).dot(new.col(0))));
        let variance = |k: usize| own.col(k).dot(stays.spread * own.col(k)).max(0.0);
        if high <= low || to <= from || variance(1) < THIN * THIN * variance(0) {
            return None;
        }
        let along = (to - from) / (high - low);
        let mut across = area / (stays.area * along);
        let turn = |across: f64| {
            let scales = DVec3::new(along, across, across.min(1.0));
            new * DMat3::from_diagonal(scales) * own.transpose()
        };
        // A bent or thick part has area off the plane of its first two axes.
        for _ in 0..CORRECTIONS {
            let turn = turn(across);
            let grown = stays.surface.iter().map(|own| own.map(|at| turn * at));
            across *= area / sums(&grown.collect::<Vec<_>>()).0;
        }
        Some(Self {
            from: stays.center,
            to: center + new.col(0) * (from - along * low),
            turn: turn(across),
        })
    }

    /// Triangles grown and on the grid; `None` where they would leave the group's bounds or fall
    /// together.
    pub fn apply(self, mesh: &GroupMesh, triangles: &[[u16; 3]]) -> Option<Grown> {
        let mut places: Vec<(u16, [i32; 3])> = Vec::new();
        for place in triangles.iter().flat_map(|&own| mesh.places(own)) {
            if places.iter().any(|&(known, _)| known as usize == place) {
                continue;
            }
            let to = self.to + self.turn * (at(mesh.positions[place]) - self.from);
            // Half a unit each way is what positions may be.
            if to.is_nan() || to.abs().max_element() > 0.5 {
                return None;
            }
            let to = on_grid(mesh, to);
            if places.iter().any(|&(_, known)| known == to) {
                return None;
            }
            places.push((place as u16, to));
        }
        let moved = |place: usize| {
            let known = places.iter().find(|&&(known, _)| known as usize == place);
            known.map_or(DVec3::ZERO, |&(_, to)| at(mesh.local(to)))
        };
        let own = triangles.iter();
        Some(Grown {
            growth: self,
            triangles: own.map(|&own| mesh.places(own).map(moved)).collect(),
            places,
        })
    }
}

fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let start = (f64::INFINITY, f64::NEG_INFINITY);
    values.fold(start, |(low, high), value| {
        (low.min(value), high.max(value))
    })
}

/// Nearest grid indices.
pub(super) fn on_grid(mesh: &GroupMesh, at: DVec3) -> [i32; 3] {
    mesh.on_grid(at.to_array().map(|value| value as f32))
}

/// Right-handed unit axes, the one along which a covariance is largest first (Jacobi's method).
pub(super) fn axes(covariance: DMat3) -> DMat3 {
    let mut rest = covariance;
    let mut axes = DMat3::IDENTITY;
    let trace = (0..3).map(|k| covariance.col(k)[k]).sum::<f64>();
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = rest.col(q)[p];
            if off.abs() <= f64::EPSILON * trace {
                continue;
            }
            let theta = (rest.col(q)[q] - rest.col(p)[p]) / (2.0 * off);
            let sign = if theta >= 0.0 { 1.0 } else { -1.0 };
            let tangent = sign / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
            let mut turn = DMat3::IDENTITY;
            turn.col_mut(p)[p] = cosine;
            turn.col_mut(q)[q] = cosine;
            turn.col_mut(q)[p] = tangent * cosine;
            turn.col_mut(p)[q] = -tangent * cosine;
            rest = turn.transpose() * rest * turn;
            axes *= turn;
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| rest.col(b)[b].total_cmp(&rest.col(a)[a]));
    let [first, second, _] = order.map(|k| axes.col(k));
    DMat3::from_cols(first, second, first.cross(second))
}

/// Squared distance to the nearest of some triangles, and its number.
pub(super) fn nearest(at: DVec3, triangles: &[Corners]) -> (f64, usize) {
    let mut best = (f64::INFINITY, 0);
    for (number, own) in triangles.iter().enumerate() {
        if to_box(at, own) < best.0 {
            let squared = to_corners(at, own);
            if squared < best.0 {
                best = (squared, number);
            }
        }
    }
    best
}

/// Whether a point lies within a squared distance of some triangles.
pub(super) fn is_near(at: DVec3, triangles: &[Corners], squared: f64) -> bool {
    let is_near = |own: &Corners| to_box(at, own) <= squared && to_corners(at, own) <= squared;
    triangles.iter().any(is_near)
}

/// Squared distance to the box of a triangle: never above that to the triangle.
fn to_box(at: DVec3, [a, b, c]: &Corners) -> f64 {
    let (low, high) = (a.min(*b).min(*c), a.max(*b).max(*c));
    (low - at).max(at - high).max(DVec3::ZERO).length_squared()
}

fn to_corners(at: DVec3, own: &Corners) -> f64 {
    to_triangle(at.to_array(), &own.map(|corner| corner.to_array()))
}

/// Whether all samples of some triangles hold: corners, middles, and points no farther than
/// `distance` apart on their sides.
pub(super) fn all_samples(
    triangles: &[Corners],
    distance: f64,
    holds: impl Fn(DVec3) -> bool,
) -> bool {
    triangles.iter().all(|&[a, b, c]| {
        let sides = [[a, b], [b, c], [c, a]];
        let on_side = |&[from, to]: &[DVec3; 2]| {
            let count = (from.distance(to) / distance).ceil().min(MOST_SAMPLES) as u32;
            (1..count).all(|k| holds(from.lerp(to, f64::from(k) / f64::from(count))))
        };
        [a, b, c].into_iter().all(&holds) && sides.iter().all(on_side) && holds((a + b + c) / 3.0)
    })
}
