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
use super::nearest::{middle, sure, to_segment, to_triangle};
use super::quadric::{dot, sub};

/// A witness nearer than this share of the farthest one is not handed on.
pub(in super::super) const HANDED_ON: f32 = 0.4;
/// A witness whose squared distance is less than this share of the largest so far is not looked at further.
const ENOUGH: f32 = 0.5;
/// Places whose mean squared distance to their planes is more than this share of the largest squared distance are loose.
const LOOSE: f32 = 0.2;

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
    seen: Vec<u32>,
    now: u32,
    /// First corner at each place of the group as it was, and the next of each.
    head: Vec<u16>,
    next: Vec<u16>,
    loose: Vec<bool>,
    /// Where each place went.
    went: Vec<u16>,
    /// Corners of what is left, and of the group as it was.
    left: Vec<[[f32; 3]; 3]>,
    old: Vec<[[f32; 3]; 3]>,
}

const NONE: u16 = u16::MAX;

impl Court {
    /// Hears every place that went, every place that moved from its `origins`, and every witness handed on.
    pub fn hear<const K: usize>(
        &mut self,
        state: &Collapser<K>,
        mesh: &GroupMesh,
        origins: &[[f32; 3]],
    ) -> Testimony {
        self.farthest.clear();
        self.farthest.resize(mesh.triangles.len(), (-1.0, [0; 3]));
        self.seen.clear();
        self.seen.resize(mesh.triangles.len(), 0);
        self.now = 0;
        self.went.clear();
        self.went
            .extend((0..origins.len()).map(|place| state.find(place as u16)));
        self.left.clear();
        self.old.clear();
        for (&vertices, &alive) in state.corners.iter().zip(&state.alive) {
            if alive {
                let places = mesh.places(vertices);
                self.left.push(places.map(|place| mesh.positions[place]));
            }
        }
        let mut worst = 0.0f32;
        let mut lost: Vec<[i32; 3]> = Vec::new();
        for place in loosest_first(state, &self.went) {
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
            match self.nearest(state, mesh, at, went_to, ENOUGH * worst) {
                Some((squared, triangle)) => {
                    let mut squared = sure(&self.left, at, squared, worst);
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
            match self.nearest(state, mesh, at, went_to, ENOUGH * worst) {
                Some((squared, triangle)) => {
                    let squared = sure(&self.left, at, squared, worst);
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
            vanished = self.search(state, mesh, &lost);
            worst = worst.max(vanished);
        }
        self.find_loose(state, mesh, origins, worst);
        let worst = self.old_edges(state, mesh, origins, worst);
        let step = self.new_triangles(state, mesh, origins, worst);
        let least = HANDED_ON * HANDED_ON * worst;
        let mut testimony = Testimony {
            distance: worst.sqrt(),
            step: step.sqrt(),
            lost: vanished.sqrt(),
            witnesses: Vec::new(),
        };
        let mut number = 0;
        for (triangle, &(squared, position)) in self.farthest.iter().enumerate() {
            if !state.alive[triangle] {
                continue;
            }
            if squared > least && squared > 0.0 {
                testimony.witnesses.push(Witness {
                    position,
                    triangle: number,
                });
            }
            number += 1;
        }
        testimony
    }

    /// Marks the places that are left whose quadrics promise an error near the largest one.
    fn find_loose<const K: usize>(
        &mut self,
        state: &Collapser<K>,
        mesh: &GroupMesh,
        origins: &[[f32; 3]],
        worst: f32,
    ) {
        self.loose.clear();
        self.loose.extend((0..origins.len()).map(|place| {
            let quadric = &state.quadrics[place];
            let offset = sub(mesh.positions[place], origins[place]);
            quadric.at(offset) > LOOSE * worst * quadric.weight
        }));
    }

    /// Largest squared distance, `worst` at least, of the middles of the group's old edges to what is left.
    fn old_edges<const K: usize>(
        &mut self,
        state: &Collapser<K>,
        mesh: &GroupMesh,
        origins: &[[f32; 3]],
        mut worst: f32,
    ) -> f32 {
        for &triangle in &mesh.triangles {
            let places = mesh.places(triangle);
            for side in 0..3 {
                let (a, b) = (places[side], places[(side + 1) % 3]);
                // Once for the two triangles of an edge.
                if a > b {
                    continue;
                }
                let ends = [self.went[a], self.went[b]];
                if ends[0] == ends[1] || !ends.iter().any(|&end| self.loose[end as usize]) {
                    continue;
                }
                let at = middle(origins[a], origins[b]);
                if let Some((squared, _)) = self.nearest(state, mesh, at, ends[0], worst) {
                    worst = worst.max(sure(&self.left, at, squared, worst));
                }
            }
        }
        worst
    }

    /// Largest squared distance of samples of the loose triangles to the group as it was; what is less than a share of
    /// `worst` is not looked at further.
    fn new_triangles<const K: usize>(
        &mut self,
        state: &Collapser<K>,
        mesh: &GroupMesh,
        origins: &[[f32; 3]],
        worst: f32,
    ) -> f32 {
        self.index(mesh);
        for &vertices in &mesh.triangles {
            let places = mesh.places(vertices);
            self.old.push(places.map(|place| origins[place]));
        }
        let mut step = 0.0f32;
        for triangle in 0..state.corners.len() {
            let places = mesh.places(state.corners[triangle]);
            if !state.alive[triangle] || !places.iter().any(|&place| self.loose[place]) {
                continue;
            }
            let [a, b, c] = places.map(|place| mesh.positions[place]);
            let center = std::array::from_fn(|axis| (a[axis] + b[axis] + c[axis]) / 3.0);
            let enough = (ENOUGH * worst).max(step);
            step = step.max(self.nearest_old(mesh, origins, center, places[0], enough));
            for side in 0..3 {
                let (from, to) = (places[side], places[(side + 1) % 3]);
                if from < to {
                    let at = middle(mesh.positions[from], mesh.positions[to]);
                    let enough = (ENOUGH * worst).max(step);
                    step = step.max(self.nearest_old(mesh, origins, at, from, enough));
                }
            }
        }
        step
    }

    fn index(&mut self, mesh: &GroupMesh) {
        self.head.clear();
        self.head.resize(mesh.positions.len(), NONE);
        self.next.clear();
        self.next.resize(3 * mesh.triangles.len(), NONE);
        for (triangle, &vertices) in mesh.triangles.iter().enumerate() {
            for (k, place) in mesh.places(vertices).into_iter().enumerate() {
                self.next[3 * triangle + k] = self.head[place];
                self.head[place] = (3 * triangle + k) as u16;
            }
        }
    }

    /// As [`Court::nearest`], to the triangles that the group had.
    fn nearest_old(
        &mut self,
        mesh: &GroupMesh,
        origins: &[[f32; 3]],
        at: [f32; 3],
        place: usize,
        enough: f32,
    ) -> f32 {
        self.now += 1;
        let mut best = (f32::INFINITY, 0usize);
        let (mut around, mut count) = ([place; 3], 1);
        loop {
            let before = best.0;
            for &place in &around[..count] {
                let mut corner = self.head[place];
                while corner != NONE {
                    let triangle = corner as usize / 3;
                    corner = self.next[corner as usize];
                    if self.seen[triangle] == self.now {
                        continue;
                    }
                    self.seen[triangle] = self.now;
                    let corners = mesh
                        .places(mesh.triangles[triangle])
                        .map(|place| origins[place]);
                    let squared = to_triangle(at, &corners, best.0);
                    if squared < best.0 {
                        best = (squared, triangle);
                        if squared <= enough {
                            return squared;
                        }
                    }
                }
            }
            if best.0 >= before {
                return sure(&self.old, at, best.0, enough);
            }
            (around, count) = (mesh.places(mesh.triangles[best.1]), 3);
        }
    }

    fn keep(&mut self, triangle: usize, squared: f32, position: [i32; 3]) {
        let farthest = &mut self.farthest[triangle];
        if squared > farthest.0 {
            *farthest = (squared, position);
        }
    }

    /// Squared distance to the nearest triangle found round `place`, going on from triangle to triangle as long as that
    /// brings it nearer; `None` where nothing is left there.
    fn nearest<const K: usize>(
        &mut self,
        state: &Collapser<K>,
        mesh: &GroupMesh,
        at: [f32; 3],
        place: u16,
        enough: f32,
    ) -> Option<(f32, usize)> {
        self.now += 1;
        let mut best: Option<(f32, usize)> = None;
        self.visit(state, mesh, at, place, enough, &mut best);
        loop {
            let (squared, triangle) = best?;
            if squared <= enough {
                return best;
            }
            for vertex in state.corners[triangle] {
                let place = mesh.welder.place_of[vertex as usize] as u16;
                self.visit(state, mesh, at, place, enough, &mut best);
            }
            if best.is_none_or(|(nearer, _)| nearer >= squared) {
                return best;
            }
        }
    }

    fn visit<const K: usize>(
        &mut self,
        state: &Collapser<K>,
        mesh: &GroupMesh,
        at: [f32; 3],
        place: u16,
        enough: f32,
        best: &mut Option<(f32, usize)>,
    ) {
        for (triangle, _) in state.star(place) {
            if self.seen[triangle] == self.now {
                continue;
            }
            self.seen[triangle] = self.now;
            let corners = mesh
                .places(state.corners[triangle])
                .map(|place| mesh.positions[place]);
            let least = best.map_or(f32::INFINITY, |(least, _)| least);
            let squared = to_triangle(at, &corners, least);
            if squared < least || best.is_none() {
                *best = Some((squared, triangle));
                if squared <= enough {
                    return;
                }
            }
        }
    }

    /// Largest squared distance of points whose part of the surface vanished, to anything that is left; they too are handed on.
    fn search<const K: usize>(
        &mut self,
        state: &Collapser<K>,
        mesh: &GroupMesh,
        lost: &[[i32; 3]],
    ) -> f32 {
        let alive: Vec<usize> = (0..state.corners.len())
            .filter(|&triangle| state.alive[triangle])
            .collect();
        let left: Vec<[u32; 3]> = alive
            .iter()
            .map(|&triangle| {
                let places = mesh.places(state.corners[triangle]);
                places.map(|place| place as u32)
            })
            .collect();
        let tree = TriangleTree::new(&mesh.positions, &left);
        let mut worst = 0.0f32;
        for &position in lost {
            if let Some((squared, number)) = tree.nearest(mesh.local(position).map(f64::from)) {
                worst = worst.max(squared as f32);
                self.keep(alive[number as usize], squared as f32, position);
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

/// Squared distance to the nearest open edge at `place`; 0 where there is none.
fn to_open_edge<const K: usize>(
    state: &Collapser<K>,
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
fn loosest_first<const K: usize>(state: &Collapser<K>, went: &[u16]) -> Vec<usize> {
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
