//! Witness: how far the source surface lies from what stands for it now.
//!
//! Witnesses are points of the source that have been left behind, each with the triangle nearest to it. A group hands its
//! farthest ones on, so every level is measured against the source itself, not against the level before, and errors do not
//! add up. The distance from a witness is taken to triangles near the place that it went to: never below the distance to the
//! whole surface.
//!
//! Between the vertices two surfaces are farthest apart where their edges cross, so where the quadrics say that the surface
//! lies loose, the middles of the old edges bear witness too, and points of the new triangles
//! that may be farther from the source are handed to `back`. All are samples; `MARGIN` is for what
//! lies between them (`lodestream-loadtests build`
//! measures what is left).

mod answers;

use super::super::borders::OPEN;
use super::super::cluster::Witness;
use super::super::triangle_tree::TriangleTree;
use super::budget::Answered;
use super::collapse::Collapser;
use super::group::GroupMesh;
use super::nearest::{Patch, middle, to_segment};
use super::quadric::{dot, sub};
use super::samples::{CLOSE, Samples, center};
use super::{MARGIN, STEP_MARGIN};

/// A witness nearer than this share of the farthest one is not handed on.
pub(in super::super) const HANDED_ON: f32 = 0.25;
/// A witness whose squared distance is less than this share of the largest so far is not looked at further.
const ENOUGH: f32 = 0.5;
/// Places whose mean squared distance to their planes is more than this share of the largest squared distance are loose.
const LOOSE: f32 = 0.05;
/// An edge of more than this share of the typical length is looked at in four parts, not in two.
const LONG: f32 = 0.4;

/// A point of the new surface nearer to the group than this share of what is known is no sample.
const LEAST_STEP: f32 = 0.0625;

/// What the witnesses of a group say.
#[derive(Debug, Default)]
pub(in super::super) struct Testimony {
    /// Farthest distance of the source from what stands for it, units.
    pub distance: f32,
    /// Points of that which may be farther from the source.
    pub samples: Samples,
    /// Farthest distance of parts that vanished from what is left, units.
    pub lost: f32,
    /// Those handed on, by triangle.
    pub witnesses: Vec<Witness>,
}

/// Kept between groups.
#[derive(Debug, Default)]
pub(super) struct Court {
    /// Farthest witness of each triangle and its squared distance.
    farthest: Vec<(f32, [i32; 3])>,
    loose: Vec<bool>,
    /// Places where connections may have been given up.
    torn: Vec<bool>,

    /// Distance of each place from the group as it was that matters.
    reach: Vec<f32>,
    /// Where each place went.
    went: Vec<u16>,
    /// Places that went and witnesses, each with its squared distance to a triangle of `left`.
    answered: Vec<(Answered, f32)>,
    /// What is left, and the group as it was.
    left: Patch,
    old: Patch,
}

impl Court {
    /// Distance of every place that went from the surface near where it went, units.
    pub fn distances<const L: usize>(
        &mut self,
        state: &Collapser<L>,
        mesh: &GroupMesh,
    ) -> Vec<f32> {
        let left = state.corners.iter().zip(&state.alive);
        let left = left.filter(|&(_, &alive)| alive);
        self.left.set(
            &mesh.positions,
            left.map(|(&vertices, _)| mesh.places(vertices).map(|place| place as u16)),
        );
        let mut distances = Vec::new();
        for place in 0..mesh.positions.len() {
            let went_to = state.find(place as u16);
            if went_to as usize != place {
                let at = mesh.positions[place];
                let found = self.left.nearest(at, &[went_to], 0.0, f32::INFINITY);
                distances.extend(found.map(|(squared, _)| squared.sqrt()));
            }
        }
        distances
    }

    /// Hears every place that went, every place that moved from its `origins`, and every witness
    /// handed on. Each cluster lies within its number of `members` of the source, units.
    pub fn hear<const L: usize>(
        &mut self,
        state: &Collapser<L>,
        mesh: &GroupMesh,
        origins: &[[f32; 3]],
        members: &[f32],
    ) -> Testimony {
        self.went.clear();
        self.went
            .extend((0..origins.len()).map(|place| state.find(place as u16)));
        let left = state.corners.iter().zip(&state.alive);
        let left = left.filter(|&(_, &alive)| alive);
        self.left.set(
            &mesh.positions,
            left.map(|(&vertices, _)| mesh.places(vertices).map(|place| place as u16)),
        );
        self.farthest.clear();
        self.farthest.resize(state.live, (-1.0, [0; 3]));
        let is_limited = state.budget.is_limited();
        let mut worst = match is_limited {
            true => self.hear_answered(state, mesh),
            false => 0.0,
        };
        let mut lost: Vec<[i32; 3]> = Vec::new();
        for place in loosest_first(state, &self.went) {
            if mesh.answered[place] {
                continue;
            }
            let went_to = self.went[place];
            let stayed = went_to as usize == place;
            let at = origins[place];
            if is_limited && !stayed && self.left.holds(went_to) {
                continue;
            }
            if stayed && self.left.holds(went_to) {
                // It is no farther from the surface than it has moved.
                let step = sub(mesh.positions[place], at);
                if dot(step, step) <= ENOUGH * worst {
                    continue;
                }
            }
            match self.left.nearest(at, &[went_to], ENOUGH * worst, worst) {
                Some((mut squared, triangle)) => {
                    if !stayed && mesh.rules[place] == OPEN {
                        squared = squared.max(to_open_edge(state, mesh, at, went_to));
                    }
                    worst = worst.max(squared);
                    if squared > HANDED_ON * HANDED_ON * worst {
                        self.keep(triangle, squared, mesh.on_grid(at));
                    }
                }
                None => lost.push(mesh.on_grid(at)),
            }
        }
        if !is_limited {
            worst = self.hear_witnesses(mesh, origins, worst, &mut lost);
        }
        let mut vanished = 0.0;
        if !lost.is_empty() {
            vanished = self.search(mesh, &lost);
            worst = worst.max(vanished);
        }
        self.reach.clear();
        self.reach.resize(origins.len(), worst.sqrt());
        self.find_loose(state, mesh, origins);
        let worst = self.old_edges(mesh, origins, worst);
        let samples = self.new_triangles(state, mesh, origins, members, worst.sqrt());
        let least = HANDED_ON * HANDED_ON * worst;
        let mut testimony = Testimony {
            distance: worst.sqrt(),
            samples,
            lost: vanished.sqrt(),
            witnesses: Vec::new(),
        };
        for (triangle, &(squared, position)) in (0..).zip(&self.farthest) {
            if squared > least && squared > 0.0 {
                testimony.witnesses.push(Witness { position, triangle });
            }
        }
        testimony
    }

    /// Hears every witness handed on; gives the largest squared distance, `worst` at least.
    fn hear_witnesses(
        &mut self,
        mesh: &GroupMesh,
        origins: &[[f32; 3]],
        mut worst: f32,
        lost: &mut Vec<[i32; 3]>,
    ) -> f32 {
        for witness in &mesh.witnesses {
            let at = mesh.local(witness.position);
            let places = mesh.places(mesh.triangles[witness.triangle as usize]);
            let near = places.into_iter().min_by(|&a, &b| {
                let away = |place: usize| {
                    let side = sub(origins[place], at);
                    dot(side, side)
                };
                away(a).total_cmp(&away(b))
            });
            let went_to = self.went[near.unwrap_or(0)];
            match self.left.nearest(at, &[went_to], ENOUGH * worst, worst) {
                Some((squared, triangle)) => {
                    worst = worst.max(squared);
                    if squared > HANDED_ON * HANDED_ON * worst {
                        self.keep(triangle, squared, witness.position);
                    }
                }
                None => lost.push(witness.position),
            }
        }
        worst
    }

    /// Marks places where the surface may be loose: their quadrics are near the error that matters,
    /// or creases and folds hide it.
    fn find_loose<const L: usize>(
        &mut self,
        state: &Collapser<L>,
        mesh: &GroupMesh,
        origins: &[[f32; 3]],
    ) {
        self.torn.clone_from(&state.torn);
        self.loose.clear();
        self.loose.extend((0..origins.len()).map(|place| {
            let quadric = &state.quadrics[place];
            let offset = sub(mesh.positions[place], origins[place]);
            let least = LOOSE * self.reach[place] * self.reach[place];
            state.creased[place] || quadric.at(offset) > least * quadric.weight
        }));
    }

    /// Least distance that matters where the group may be off by as much as its `members`, if an
    /// error is `known`.
    fn find_reach(&mut self, mesh: &GroupMesh, members: &[f32], known: f32) {
        self.reach.fill(known);
        for (cluster, triangles) in mesh.clusters().enumerate() {
            let reach = (known - members[cluster]).max(LEAST_STEP * known);
            for place in triangles.iter().flat_map(|&corners| mesh.places(corners)) {
                let own = &mut self.reach[self.went[place] as usize];
                *own = own.min(reach);
            }
        }
    }

    /// Largest squared distance, `worst` at least, of the middles of the group's old edges to what is left.
    fn old_edges(&mut self, mesh: &GroupMesh, origins: &[[f32; 3]], mut worst: f32) -> f32 {
        for &triangle in &mesh.triangles {
            let places = mesh.places(triangle);
            let [a, b, c] = places;
            let ends = places.map(|place| self.went[place]);
            let gone = ends[0] == ends[1] || ends[1] == ends[2] || ends[2] == ends[0];
            if gone && ends.iter().any(|&end| self.torn[end as usize]) {
                // Nothing may be drawn over it: its vertices say nothing of its middle.
                let [a, b, c] = [a, b, c].map(|place| origins[place]);
                let center = std::array::from_fn(|axis| (a[axis] + b[axis] + c[axis]) / 3.0);
                for at in [center, middle(a, b), middle(b, c), middle(c, a)] {
                    if let Some((squared, _)) = self.left.nearest(at, &ends[..1], worst, worst) {
                        worst = worst.max(squared);
                    }
                }
            }
            for side in 0..3 {
                let (a, b) = (places[side], places[(side + 1) % 3]);
                // Once for the two triangles of an edge.
                if a > b || (mesh.answered[a] && mesh.answered[b]) {
                    continue;
                }
                let ends = [self.went[a], self.went[b]];
                if ends[0] == ends[1] || !ends.iter().any(|&end| self.loose[end as usize]) {
                    continue;
                }
                let ([a, b], mut far) = ([a, b].map(|place| origins[place]), false);
                let half = middle(a, b);
                if let Some((squared, _)) = self.left.nearest(half, &ends[..1], worst, worst) {
                    far = squared > HANDED_ON * worst;
                    worst = worst.max(squared);
                }
                // An edge that went round a corner is farthest off beside its middle.
                for at in [middle(a, half), middle(half, b)]
                    .into_iter()
                    .filter(|_| far)
                {
                    if let Some((squared, _)) = self.left.nearest(at, &ends[..1], worst, worst) {
                        worst = worst.max(squared);
                    }
                }
            }
        }
        worst
    }

    /// Points of the loose triangles that may be nearly as far from the source as what is known: the
    /// distance of the source, `worst`, and the members'.
    fn new_triangles<const L: usize>(
        &mut self,
        state: &Collapser<L>,
        mesh: &GroupMesh,
        origins: &[[f32; 3]],
        members: &[f32],
        worst: f32,
    ) -> Samples {
        let most = members.iter().copied().fold(0.0, f32::max);
        let known = CLOSE * (MARGIN as f32 * worst).max(most) / STEP_MARGIN as f32;
        self.find_reach(mesh, members, known);
        self.find_loose(state, mesh, origins);
        let places = |&vertices: &[u16; 3]| mesh.places(vertices).map(|place| place as u16);
        self.old.set(origins, mesh.gathered.iter().map(places));
        let left = state.corners.iter().zip(&state.alive);
        let left = left.filter(|&(_, &alive)| alive);
        let left: Vec<[u16; 3]> = left.map(|(&corners, _)| corners).collect();
        let long = LONG * mesh.typical_edge(&left);
        let mut samples = Samples::new(mesh);
        let mut looked_at = vec![false; origins.len()];
        let mut own = Vec::new();
        for triangle in left {
            let places = mesh.places(triangle);
            if !places.iter().any(|&place| self.loose[place]) {
                continue;
            }
            own.clear();
            let reach = places.map(|place| self.reach[place]);
            let least = reach.into_iter().fold(known, f32::min).powi(2);
            let mut look_at = |at: [f32; 3], place: usize| {
                // A walk that ends in a hollow says too much: the sample is measured all the same.
                let found = self.old.nearest(at, &[place as u16], least, f32::INFINITY);
                let Some((squared, nearest)) = found.filter(|&(squared, _)| squared > least) else {
                    return;
                };
                let most = squared.sqrt() + members[mesh.cluster_of(nearest)];
                if most > known {
                    own.push((at, most));
                }
            };
            let corners = places.map(|place| mesh.positions[place]);
            let middle_point = center(&corners);
            look_at(middle_point, places[0]);
            for side in 0..3 {
                let (place, next) = (places[side], places[(side + 1) % 3]);
                let (from, to) = (corners[side], corners[(side + 1) % 3]);
                // It is no farther off than it has moved.
                let step = sub(from, origins[place]);
                if !std::mem::replace(&mut looked_at[place], true) && dot(step, step) > least {
                    look_at(from, place);
                }
                let half = middle(from, to);
                // Once for the two triangles of an edge; one that may be open may have no other.
                if place < next || mesh.rules[place] == OPEN && mesh.rules[next] == OPEN {
                    look_at(half, place);
                    let along = sub(to, from);
                    let is_folded = state.folded[place] || state.folded[next];
                    if is_folded || dot(along, along) > long * long {
                        look_at(middle(from, half), place);
                        look_at(middle(half, to), next);
                    }
                }
                // Where the surface lies on itself, what is new may reach beyond its outline anywhere.
                if state.folded[place] {
                    look_at(middle(from, middle_point), place);
                }
            }
            if !own.is_empty() {
                samples.add(corners, &own);
            }
        }
        samples
    }

    fn keep(&mut self, triangle: usize, squared: f32, position: [i32; 3]) {
        let farthest = &mut self.farthest[triangle];
        if squared > farthest.0 {
            *farthest = (squared, position);
        }
    }

    /// Largest squared distance of points whose part of the surface vanished, to anything that is left; they too are handed on.
    fn search(&mut self, mesh: &GroupMesh, lost: &[[i32; 3]]) -> f32 {
        let left: Vec<[u32; 3]> = self
            .left
            .triangles()
            .map(|places| places.map(u32::from))
            .collect();
        let tree = TriangleTree::new(&mesh.positions, &left);
        let mut worst = 0.0f32;
        for &position in lost {
            if let Some((squared, number)) = tree.nearest(mesh.local(position).map(f64::from)) {
                worst = worst.max(squared as f32);
                self.keep(number as usize, squared as f32, position);
            }
        }
        worst
    }
}

/// Witnesses of a vertex clustering, which lets parts vanish, and the farthest one's distance, units: every place that moved
/// and every witness handed on, each with the triangle nearest to it.
pub(super) fn after_merge(
    mesh: &GroupMesh,
    places: &[[u32; 3]],
    moved_to: &[u16],
) -> (Vec<Witness>, f64) {
    let tree = TriangleTree::new(&mesh.positions, places);
    let mut farthest = vec![(0.0f64, [0; 3]); places.len()];
    let vertices = (0..).zip(&mesh.welder.vertices);
    let moved = vertices.filter(|&(vertex, _)| moved_to[vertex as usize] != vertex);
    let moved = moved.map(|(_, (value, _))| value.position);
    let handed_on = mesh.witnesses.iter().map(|witness| witness.position);
    for position in moved.chain(handed_on) {
        if let Some((squared, triangle)) = tree.nearest(mesh.local(position).map(f64::from)) {
            let own = &mut farthest[triangle as usize];
            if squared > own.0 {
                *own = (squared, position);
            }
        }
    }
    let worst = farthest.iter().fold(0.0, |most: f64, own| most.max(own.0));
    let least = (HANDED_ON * HANDED_ON) as f64 * worst;
    let handed_on = (0..).zip(&farthest).filter(|(_, own)| own.0 > least);
    let witnesses = handed_on.map(|(triangle, &(_, position))| Witness { position, triangle });
    (witnesses.collect(), worst.sqrt())
}

/// Squared distance to the nearest open edge, on a walk along the open edges from `place`; 0 where
/// there is none.
fn to_open_edge<const L: usize>(
    state: &Collapser<L>,
    mesh: &GroupMesh,
    at: [f32; 3],
    mut place: u16,
) -> f32 {
    let mut best = f32::INFINITY;
    loop {
        let before = best;
        let others: Vec<(usize, i32)> = state
            .star(place)
            .flat_map(|(triangle, k)| {
                let places = mesh.places(state.corners[triangle]);
                [(places[(k + 1) % 3], 1), (places[(k + 2) % 3], -1)]
            })
            .collect();
        let mut next = place;
        for &(other, _) in &others {
            // Triangles along and against an open edge do not balance.
            let own = others.iter().filter(|&&(same, _)| same == other);
            if own.map(|&(_, turn)| turn).sum::<i32>() != 0 {
                let (a, b) = (mesh.positions[place as usize], mesh.positions[other]);
                let squared = to_segment(at, a, b);
                if squared < best {
                    (best, next) = (squared, other as u16);
                }
            }
        }
        if best >= before {
            break;
        }
        place = next;
    }
    if best.is_finite() { best } else { 0.0 }
}

/// Places in their order, but those first that went where the quadrics say that the surface lies loosest: they set the scale
/// early.
fn loosest_first<const L: usize>(state: &Collapser<L>, went: &[u16]) -> Vec<usize> {
    let mean = |place: usize| {
        let quadric = &state.quadrics[place];
        match went[place] as usize == place && quadric.weight > 0.0 {
            true => quadric.c / quadric.weight,
            false => 0.0,
        }
    };
    let loosest = (0..went.len()).max_by(|&a, &b| mean(a).total_cmp(&mean(b)));
    let first = loosest.map_or(0, |place| place as u16);
    let (mut order, late): (Vec<usize>, Vec<usize>) =
        (0..went.len()).partition(|&place| went[place] == first);
    order.extend(late);
    order
}
