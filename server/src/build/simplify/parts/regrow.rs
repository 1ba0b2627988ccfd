//! Regrow: parts get the area back that collapses took from them, and hand their outermost points
//! on to the next level.

use lodestream_format::cluster::Attributes;

use super::super::super::borders::FREE;
use super::super::super::cluster::Witness;
use super::super::collapse::Collapser;
use super::super::group::GroupMesh;
use super::fit::{Growth, nearest, on_grid};
use super::thin::{Limits, Thinner, apply};
use super::{Corners, Part, corners, outermost, sums};

/// A part that keeps this share of its area stays as it is.
const FULL: f64 = 0.98;

impl Thinner {
    /// Grows parts about their middles to the area that they stand for, as far as that keeps within
    /// the limits.
    pub fn regrow<const L: usize>(
        &mut self,
        mesh: &mut GroupMesh,
        state: &Collapser<L>,
        limits: &Limits,
    ) {
        for part in &self.parts {
            let live: Vec<[u16; 3]> = live(part, state).map(|own| state.corners[own]).collect();
            let triangles: Vec<Corners> = live.iter().map(|&own| corners(mesh, own)).collect();
            let (area, center) = sums(&triangles);
            if area <= 0.0 || area >= FULL * part.area {
                continue;
            }
            let whole = (part.area / area).sqrt();
            let grown = [whole, 0.5 * (1.0 + whole)].into_iter().find_map(|scale| {
                let grown = Growth::about(center, scale).apply(mesh, &live)?;
                let holds = limits.hold(&grown.triangles, &part.surface, &part.points);
                holds.then_some(grown)
            });
            if let Some(grown) = grown {
                self.open_moved |= apply(mesh, &grown, Attributes::default());
            }
        }
        // Where a part ends is no rim of a surface: its points say how far it lies off.
        for &own in self.parts.iter().flat_map(|part| &part.triangles) {
            for place in mesh.places(mesh.triangles[own as usize]) {
                mesh.rules[place] = FREE;
            }
        }
    }

    /// Adds the outermost points of parts to the witnesses found. Triangles are numbered as they
    /// are left.
    pub fn hand_on<const L: usize>(
        &self,
        mesh: &GroupMesh,
        state: &Collapser<L>,
        found: &mut Vec<Witness>,
    ) {
        let mut numbers = Vec::with_capacity(state.alive.len());
        let mut next = 0;
        for &alive in &state.alive {
            numbers.push(next);
            next += u32::from(alive);
        }
        for part in &self.parts {
            let live: Vec<usize> = live(part, state).collect();
            if live.is_empty() {
                continue;
            }
            let own = live.iter().map(|&own| state.corners[own]);
            let triangles: Vec<Corners> = own.map(|own| corners(mesh, own)).collect();
            found.extend(outermost(&part.points).into_iter().map(|at| Witness {
                position: on_grid(mesh, at),
                triangle: numbers[live[nearest(at, &triangles).1]],
            }));
        }
        found.sort_by_key(|witness| (witness.triangle, witness.position));
        found.dedup();
    }
}

/// Triangles of a part that are left.
fn live<'a, const L: usize>(
    part: &'a Part,
    state: &'a Collapser<L>,
) -> impl Iterator<Item = usize> + 'a {
    let own = part.triangles.iter().map(|&own| own as usize);
    own.filter(|&own| state.alive[own])
}
