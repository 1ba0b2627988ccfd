//! Witness: how far the source surface lies from what stands for it now.
//!
//! Witnesses are points of the source that have been left behind, each with the triangle nearest to it. A group hands its
//! farthest ones on, so every level is measured against the source itself, not against the level before, and errors do not
//! add up. The distance from a witness is taken to triangles near the place that it went to: never below the distance to the
//! whole surface.
//!
//! Between the vertices two surfaces are farthest apart where their edges cross, so where the quadrics say that the surface
//! lies loose, the middles of the old edges bear witness too, and the new triangles are held against the old ones. All are
//! samples; `MARGIN` is for what lies between them (`lodestream-loadtests build` measures what is left).

use super::super::borders::OPEN;
use super::super::cluster::Witness;
use super::super::triangle_tree::TriangleTree;
use super::collapse::Collapser;
use super::group::GroupMesh;
use super::nearest::{Patch, middle, to_segment};
use super::quadric::{dot, sub};

/// A witness nearer than this share of the farthest one is not handed on.
pub(in super::super) const HANDED_ON: f32 = 0.25;
/// A witness whose squared distance is less than this share of the largest so far is not looked at further.
const ENOUGH: f32 = 0.5;
/// Places whose mean squared distance to their planes is more than this share of the largest squared distance are loose.
const LOOSE: f32 = 0.05;
/// An edge of more than this times the typical length is looked at in four parts, not in two.
const LONG: f32 = 1.4;

/// Share of the largest squared distance that a triangle must have so that it is looked at once more.
const CLOSE: f32 = 0.75;
/// New triangles that are looked at once more, at more places.
const CLOSER_LOOKS: usize = 4;
/// Parts of a side of such a triangle.
const CUTS: u32 = 5;
const NOTHING: usize = usize::MAX;

/// What the witnesses of a group say.
#[derive(Debug, Default)]
pub(in super::super) struct Testimony {
    /// Farthest distance of the source from what stands for it, units.
    pub distance: f32,
    /// Farthest distance of that from the group as it was, units.
    pub step: f32,
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
    /// Where each place went.
    went: Vec<u16>,
    /// What is left, and the group as it was.
    left: Patch,
    old: Patch,
}

impl Court {
    /// Hears every place that went, every place that moved from its `origins`, and every witness handed on.
    pub fn hear<const L: usize>(
        &mut self,
        state: &Collapser<L>,
        mesh: &GroupMesh,
        origins: &[[f32; 3]],
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
        let mut worst = 0.0f32;
        let mut lost: Vec<[i32; 3]> = Vec::new();
        for place in loosest_first(state, &self.went) {
            if mesh.answered[place] {
                continue;
            }
            let went_to = self.went[place];
            let stayed = went_to as usize == place;
            let at = origins[place];
            if stayed {
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
        let mut vanished = 0.0;
        if !lost.is_empty() {
            vanished = self.search(mesh, &lost);
            worst = worst.max(vanished);
        }
        self.find_loose(state, mesh, origins, worst);
        let worst = self.old_edges(mesh, origins, worst);
        let step = self.new_triangles(state, mesh, origins, worst);
        let least = HANDED_ON * HANDED_ON * worst;
        let mut testimony = Testimony {
            distance: worst.sqrt(),
            step: step.sqrt(),
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

    /// Marks the places whose quadrics promise an error near the largest one, and where they cannot: at creases
    /// and folds.
    fn find_loose<const L: usize>(
        &mut self,
        state: &Collapser<L>,
        mesh: &GroupMesh,
        origins: &[[f32; 3]],
        worst: f32,
    ) {
        self.loose.clear();
        self.loose.extend((0..origins.len()).map(|place| {
            let quadric = &state.quadrics[place];
            let offset = sub(mesh.positions[place], origins[place]);
            state.creased[place] || quadric.at(offset) > LOOSE * worst * quadric.weight
        }));
    }

    /// Largest squared distance, `worst` at least, of the middles of the group's old edges to what is left.
    fn old_edges(&mut self, mesh: &GroupMesh, origins: &[[f32; 3]], mut worst: f32) -> f32 {
        for &triangle in &mesh.triangles {
            let places = mesh.places(triangle);
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
                let at = middle(origins[a], origins[b]);
                if let Some((squared, _)) = self.left.nearest(at, &ends[..1], worst, worst) {
                    worst = worst.max(squared);
                }
            }
        }
        worst
    }

    /// Largest squared distance of samples of the loose triangles to the group as it was; what is less than a share of
    /// `worst` is not looked at further.
    fn new_triangles<const L: usize>(
        &mut self,
        state: &Collapser<L>,
        mesh: &GroupMesh,
        origins: &[[f32; 3]],
        worst: f32,
    ) -> f32 {
        let places = |&vertices: &[u16; 3]| mesh.places(vertices).map(|place| place as u16);
        self.old.set(origins, mesh.gathered.iter().map(places));
        let left = state.corners.iter().zip(&state.alive);
        let left = left.filter(|&(_, &alive)| alive);
        let left: Vec<[u16; 3]> = left.map(|(&corners, _)| corners).collect();
        let long = LONG * mesh.typical_edge(&left);
        let mut step = 0.0f32;
        // The triangles that lie farthest off in samples so far, farthest first.
        let mut farthest = [(0.0f32, NOTHING); CLOSER_LOOKS];
        for triangle in 0..state.corners.len() {
            let places = mesh.places(state.corners[triangle]);
            if !state.alive[triangle] || !places.iter().any(|&place| self.loose[place]) {
                continue;
            }
            let corners = places.map(|place| mesh.positions[place]);
            let [a, b, c] = corners;
            let center = std::array::from_fn(|axis| (a[axis] + b[axis] + c[axis]) / 3.0);
            let mut own = 0.0f32;
            let mut look_at = |at: [f32; 3], place: usize| {
                let enough = (ENOUGH * worst).max(CLOSE * step);
                if let Some((squared, _)) = self.old.nearest(at, &[place as u16], enough, enough) {
                    own = own.max(squared);
                }
            };
            look_at(center, places[0]);
            for side in 0..3 {
                let next = (side + 1) % 3;
                let half = middle(corners[side], corners[next]);
                if places[side] < places[next] {
                    look_at(half, places[side]);
                }
                let along = sub(corners[next], corners[side]);
                let folded = state.folded[places[side]];
                if folded || dot(along, along) > long * long {
                    look_at(middle(corners[side], half), places[side]);
                    look_at(middle(half, corners[next]), places[next]);
                }
                // Where the surface lies on itself, what is new may reach beyond its outline anywhere.
                if folded {
                    look_at(corners[side], places[side]);
                    look_at(half, places[side]);
                    look_at(middle(corners[side], center), places[side]);
                }
            }
            step = step.max(own);
            let rank = farthest.iter().position(|&(other, _)| own > other);
            if let Some(rank) = rank.filter(|_| own > 0.0) {
                farthest[rank..].rotate_right(1);
                farthest[rank] = (own, triangle);
            }
        }
        for (own, triangle) in farthest {
            if triangle == NOTHING || own < CLOSE * step {
                break;
            }
            let places = mesh.places(state.corners[triangle]);
            let corners = places.map(|place| mesh.positions[place]);
            for (weights, nearest) in between() {
                let at = std::array::from_fn(|axis| {
                    (0..3)
                        .map(|corner| weights[corner] * corners[corner][axis])
                        .sum()
                });
                let place = [places[nearest] as u16];
                if let Some((squared, _)) = self.old.nearest(at, &place, step, step) {
                    step = step.max(squared);
                }
            }
        }
        step
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

/// Weights of the corners at the points of a triangle that cut its sides in `CUTS` parts, and the corner that is nearest,
/// without the corners themselves.
fn between() -> impl Iterator<Item = ([f32; 3], usize)> {
    let rows = (0..=CUTS).flat_map(|a| (0..=CUTS - a).map(move |b| [a, b, CUTS - a - b]));
    let inner = rows.filter(|parts| !parts.contains(&CUTS));
    inner.map(|parts| {
        let nearest = (0..3).fold(0, |best, k| if parts[k] > parts[best] { k } else { best });
        (parts.map(|part| part as f32 / CUTS as f32), nearest)
    })
}

/// Squared distance to the nearest open edge at `place`; 0 where there is none.
fn to_open_edge<const L: usize>(
    state: &Collapser<L>,
    mesh: &GroupMesh,
    at: [f32; 3],
    place: u16,
) -> f32 {
    let mut best = f32::INFINITY;
    let others: Vec<usize> = state
        .star(place)
        .flat_map(|(triangle, k)| {
            let places = mesh.places(state.corners[triangle]);
            [places[(k + 1) % 3], places[(k + 2) % 3]]
        })
        .collect();
    for &other in &others {
        if others.iter().filter(|&&same| same == other).count() == 1 {
            let (a, b) = (mesh.positions[place as usize], mesh.positions[other]);
            best = best.min(to_segment(at, a, b));
        }
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
