//! Thin: two parts that lie near each other become one of the area of both, where every point of
//! the source that they stand for keeps within the budget of it, and all of it within the budget
//! of them.
//!
//! The nearest pairs come first and no part twice in a round, so that a crown gets thinner evenly.
//! The one that stays is drawn by the areas, so that colours and kinds keep their shares. Parts of
//! different materials never stand for each other.

use glam::DVec3;
use lodestream_format::cluster::Attributes;
use lodestream_format::octahedral;

use super::super::super::borders::OPEN;
use super::super::super::cluster::Witness;
use super::super::group::GroupMesh;
use super::fit::{Grown, Growth, all_samples, is_near, nearest, on_grid};
use super::near::pairs;
use super::{Corners, Part, Roots, corners, find};

/// A part of more triangles is left to the collapses.
const MOST_TRIANGLES: usize = 32;
/// Budgets that a part reaches at most. Outermost points say how far a convex shape lies off: of a
/// larger part with notches they say too little.
const REACH: f64 = 2.0;

/// How far parts may go.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct Limits<'a> {
    /// Distance between the source and its stand-in, units; infinite where any is allowed.
    pub budget: f64,
    /// Distance between the source and each cluster of the group, units.
    pub members: &'a [f32],
    /// Triangles to leave.
    pub target: usize,
}

impl Limits<'_> {
    /// Whether the `points` of the source lie near to a new surface, and all of it near to the old
    /// one, or to such a point.
    pub(super) fn hold(&self, new: &[Corners], old: &[Corners], points: &[DVec3]) -> bool {
        let members = self.members.iter().copied().fold(0.0, f32::max);
        let step = (self.budget - f64::from(members)).max(0.5 * self.budget);
        let (budget, squared) = (self.budget * self.budget, step * step);
        let is_known = |at: DVec3| {
            points
                .iter()
                .any(|point| point.distance_squared(at) <= budget)
        };
        points.iter().all(|&at| is_near(at, new, budget))
            && all_samples(new, step, |at| is_known(at) || is_near(at, old, squared))
    }
}

/// Kept between groups.
#[derive(Debug, Default)]
pub(in super::super) struct Thinner {
    roots: Roots,
    /// The group's small parts, as long as they stay.
    pub(super) parts: Vec<Part>,
    /// Farthest that a part that went lies from its stand-in, units.
    pub lost: f64,
    /// Whether an open edge has moved.
    pub open_moved: bool,
}

impl Thinner {
    /// Takes up the parts of a group that are small beside the `budget`, units.
    pub fn start(&mut self, mesh: &GroupMesh, budget: f64) {
        (self.lost, self.open_moved) = (0.0, false);
        self.parts = find(mesh, &mut self.roots);
        self.parts.retain(|part| part.radius <= REACH * budget);
    }

    /// Lets parts stand for others until the target is reached or none is near.
    pub fn thin(&mut self, mesh: &mut GroupMesh, limits: &Limits, attributes: Attributes) {
        let parts = &mut self.parts;
        let is_small = |part: &Part| part.triangles.len() <= MOST_TRIANGLES;
        let mut free: Vec<bool> = parts.iter().map(is_small).collect();
        let mut gone = vec![false; mesh.triangles.len()];
        let mut left = mesh.triangles.len();
        for pair in pairs(parts, limits.budget) {
            if left <= limits.target {
                break;
            }
            let [a, b] = pair.parts.map(|part| part as usize);
            if !free[a] || !free[b] {
                continue;
            }
            let (stays, goes) = match stays_first(&parts[a], &parts[b]) {
                true => (a, b),
                false => (b, a),
            };
            let Some(grown) = fit(mesh, &parts[stays], &parts[goes], limits) else {
                continue;
            };
            (free[a], free[b]) = (false, false);
            self.open_moved |= apply(mesh, &grown, attributes);
            let empty = Part::new(parts[goes].slot, 0);
            let went = std::mem::replace(&mut parts[goes], empty);
            for &at in &went.points {
                self.lost = self.lost.max(nearest(at, &grown.triangles).0.sqrt());
            }
            left -= went.triangles.len();
            for &triangle in &went.triangles {
                gone[triangle as usize] = true;
            }
            parts[stays].take(went);
        }
        parts.retain(|part| !part.triangles.is_empty());
        if left < gone.len() {
            self.drop_triangles(mesh, &gone);
        }
        self.tell(mesh);
    }

    fn drop_triangles(&mut self, mesh: &mut GroupMesh, gone: &[bool]) {
        let mut numbers = Vec::with_capacity(gone.len());
        let mut next = 0;
        for &gone in gone {
            numbers.push(next);
            next += u32::from(!gone);
        }
        let mut of_triangles = gone.iter();
        mesh.triangles
            .retain(|_| of_triangles.next() == Some(&false));
        mesh.witnesses.retain_mut(|witness| {
            let triangle = witness.triangle as usize;
            witness.triangle = numbers[triangle];
            !gone[triangle]
        });
        for own in self.parts.iter_mut().flat_map(|part| &mut part.triangles) {
            *own = numbers[*own as usize] as u16;
        }
    }

    /// Lets the points of every part bear witness, in place of what it had.
    fn tell(&self, mesh: &mut GroupMesh) {
        let mut of_parts = vec![false; mesh.triangles.len()];
        mesh.answered.clear();
        mesh.answered.resize(mesh.positions.len(), false);
        for part in &self.parts {
            for &own in &part.triangles {
                of_parts[own as usize] = true;
                for place in mesh.places(mesh.triangles[own as usize]) {
                    mesh.answered[place] = part.told;
                }
            }
        }
        mesh.witnesses
            .retain(|witness| !of_parts[witness.triangle as usize]);
        for part in &self.parts {
            let own = part
                .triangles
                .iter()
                .map(|&own| mesh.triangles[own as usize]);
            let triangles: Vec<Corners> = own.map(|own| corners(mesh, own)).collect();
            for &at in &part.points {
                let position = on_grid(mesh, at);
                let triangle = u32::from(part.triangles[nearest(at, &triangles).1]);
                mesh.witnesses.push(Witness { position, triangle });
            }
        }
    }
}

/// Whether the first of two parts stays: drawn by their areas, the same at every run.
fn stays_first(a: &Part, b: &Part) -> bool {
    let values = [a, b].map(|part| part.center.to_array());
    // Multiplicative hashing (Knuth, TAOCP 3, 6.4).
    let bits = values.as_flattened().iter().fold(0u64, |bits, value| {
        (bits ^ value.to_bits())
            .wrapping_mul(0x9e37_79b9_7f4a_7c15)
            .rotate_left(29)
    });
    let drawn = (bits >> 11) as f64 / (1u64 << 53) as f64;
    drawn * (a.area + b.area) < a.area
}

/// The first growth that keeps within the limits.
fn fit(mesh: &GroupMesh, stays: &Part, goes: &Part, limits: &Limits) -> Option<Grown> {
    let old: Vec<Corners> = stays.surface.iter().chain(&goes.surface).copied().collect();
    let points: Vec<DVec3> = stays.points.iter().chain(&goes.points).copied().collect();
    let own = stays.triangles.iter();
    let own: Vec<[u16; 3]> = own.map(|&own| mesh.triangles[own as usize]).collect();
    Growth::of_pair(stays, goes).find_map(|growth| {
        let grown = growth.apply(mesh, &own)?;
        limits
            .hold(&grown.triangles, &old, &points)
            .then_some(grown)
    })
}

/// Moves a part with its normals; gives whether an open edge has moved.
pub(super) fn apply(mesh: &mut GroupMesh, grown: &Grown, attributes: Attributes) -> bool {
    let turned = grown.growth.turn.inverse().transpose();
    let mut open_moved = false;
    for &(place, to) in &grown.places {
        open_moved |= mesh.rules[place as usize] == OPEN;
        mesh.positions[place as usize] = mesh.local(to);
        let vertices: Vec<u32> = mesh.welder.vertices_at(u32::from(place)).collect();
        for number in vertices {
            let vertex = &mut mesh.welder.vertices[number as usize].0;
            vertex.position = to;
            if attributes.has(Attributes::NORMAL) {
                let normal = turned * super::at(octahedral::decode(vertex.normal));
                let unit = normal.normalize_or_zero();
                vertex.normal = octahedral::encode(unit.to_array().map(|value| value as f32));
            }
        }
    }
    open_moved
}
