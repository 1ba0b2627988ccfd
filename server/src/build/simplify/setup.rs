//! Setup: a group's connectivity, its quadrics, and the edges that wait to collapse.

use super::super::borders::{FREE, LOCKED, OPEN};
use super::super::vertex::Grids;
use super::collapse::{Collapser, Freedom, NONE};
use super::group::{GroupMesh, Weights};
use super::pairs::seam;
use super::quadric::{AttributeQuadric, Quadric, cross, dot, sub};

/// Weight of an open edge's or a fold's plane, against a triangle's as large as the edge's square.
const OPEN_EDGE_WEIGHT: f32 = 4.0;
/// The same for an edge where attributes or materials jump.
const SEAM_WEIGHT: f32 = 1.0;
/// The normals round a place sum up to less than this share of their lengths where it is folded.
const FOLDED: f32 = 0.5;
/// The same where it is creased.
const CREASED: f32 = 0.9;
/// Square of the cosine between the normals on the sides of a fold, and of all sharper ones.
const FOLD_COSINE_SQUARED: f32 = 0.9;
/// Triangles flatter than this share of their longest edge have no gradients.
const NEEDLE: f32 = 1e-5;

/// What the edge from a place to a neighbour looks like from its two sides.
#[derive(Debug, Clone, Copy)]
pub(super) struct Around {
    pub(super) neighbour: u16,
    /// Vertices here and there of the triangle along the edge, and of the one against it.
    pub(super) along: [u16; 2],
    pub(super) against: [u16; 2],
    /// Those two triangles.
    pub(super) triangles: [u16; 2],
    /// Triangles at the edge.
    pub(super) count: u8,
}

impl<const L: usize> Collapser<L> {
    /// Sets up the connectivity and the quadrics of a group.
    pub fn start(&mut self, mesh: &GroupMesh, grids: &Grids, weights: &Weights) {
        let places = mesh.positions.len();
        let vertices = mesh.welder.vertices.len();
        let triangles = mesh.triangles.len();
        refill(&mut self.moved_to, (0..places).map(|place| place as u16));
        refill(
            &mut self.place_of,
            mesh.welder.place_of.iter().map(|&place| place as u16),
        );
        refill(&mut self.corners, mesh.triangles.iter().copied());
        refill(&mut self.alive, std::iter::repeat_n(true, triangles));
        self.live = triangles;
        refill(&mut self.head, std::iter::repeat_n(NONE, places));
        refill(&mut self.tail, std::iter::repeat_n(NONE, places));
        refill(&mut self.next, std::iter::repeat_n(NONE, 3 * triangles));
        refill(&mut self.thirds, std::iter::repeat_n([NONE; 2], places));
        refill(&mut self.torn, std::iter::repeat_n(false, places));
        refill(&mut self.age, std::iter::repeat_n(0, places));
        refill(&mut self.stamp, std::iter::repeat_n(0, places));
        refill(
            &mut self.quadrics,
            std::iter::repeat_n(Quadric::default(), places),
        );
        refill(&mut self.normals, std::iter::repeat_n([0.0; 3], places));
        refill(&mut self.uses, std::iter::repeat_n(0, vertices));
        refill(
            &mut self.attribute_quadrics,
            std::iter::repeat_n(
                AttributeQuadric::default(),
                if L > 0 { vertices } else { 0 },
            ),
        );
        let uv_base = mesh.uv_base();
        let attributes = if L > 0 { vertices } else { 0 };
        refill(
            &mut self.attributes,
            (0..attributes).map(|vertex| mesh.attributes(grids, weights, uv_base, vertex)),
        );
        (self.now, self.open_moved) = (0, false);
        self.rings(mesh);
        for corner in (0..3 * triangles).rev() {
            let vertex = mesh.triangles[corner / 3][corner % 3] as usize;
            let place = mesh.welder.place_of[vertex] as usize;
            self.uses[vertex] += 1;
            self.next[corner] = self.head[place];
            self.head[place] = corner as u16;
            if self.tail[place] == NONE {
                self.tail[place] = corner as u16;
            }
        }
        for triangle in &mesh.triangles {
            self.add_triangle(mesh, *triangle);
        }
        self.find_folds();
    }

    fn rings(&mut self, mesh: &GroupMesh) {
        refill(
            &mut self.ring,
            (0..mesh.welder.vertices.len()).map(|vertex| vertex as u16),
        );
        refill(
            &mut self.on_line,
            std::iter::repeat_n(false, mesh.positions.len()),
        );
        refill(
            &mut self.only,
            std::iter::repeat_n(NONE, mesh.positions.len()),
        );
        for place in 0..mesh.positions.len() as u32 {
            let mut all = mesh.welder.vertices_at(place);
            let Some(first) = all.next() else { continue };
            let mut last = first;
            for vertex in all {
                self.ring[last as usize] = vertex as u16;
                last = vertex;
            }
            self.ring[last as usize] = first as u16;
            self.only[place as usize] = if last == first { first as u16 } else { NONE };
            let slot = |vertex: u32| mesh.welder.vertices[vertex as usize].1;
            let mut others = mesh.welder.vertices_at(place);
            let between = others.any(|vertex| slot(vertex) != slot(first));
            self.on_line[place as usize] = between || mesh.rules[place as usize] == OPEN;
        }
    }

    fn add_triangle(&mut self, mesh: &GroupMesh, triangle: [u16; 3]) {
        let places = mesh.places(triangle);
        let [a, b, c] = places.map(|place| mesh.positions[place]);
        let (ab, ac) = (sub(b, a), sub(c, a));
        let across = cross(ab, ac);
        let square = dot(across, across);
        if square <= 0.0 {
            return;
        }
        let length = square.sqrt();
        let area = 0.5 * length;
        let plane = Quadric::plane(across.map(|value| value / length), area);
        for place in places {
            // Linear and constant terms are 0: the plane runs through the corner.
            let quadric = &mut self.quadrics[place];
            quadric.add_matrix(&plane);
            quadric.weight += area;
            let sum = &mut self.normals[place];
            (0..3).for_each(|axis| sum[axis] += 0.5 * across[axis]);
        }
        if L == 0 {
            return;
        }
        let longest = dot(ab, ab).max(dot(ac, ac));
        if length < NEEDLE * longest {
            return;
        }
        // A step of the grid is 2^-24 at least, so this is 2^96 at most.
        let over = 1.0 / square;
        let duals = [cross(ac, across), cross(across, ab)].map(|v| v.map(|value| value * over));
        let [own, to_b, to_c] = triangle.map(|vertex| &self.attributes[vertex as usize]);
        let steps = [to_b, to_c].map(|to| std::array::from_fn(|k| to[k] - own[k]));
        let quadric = AttributeQuadric::<L>::triangle(duals, steps, area);
        for vertex in triangle {
            self.attribute_quadrics[vertex as usize].add_triangle(&quadric);
        }
    }

    /// Queues every live edge at what it costs now; the first time, open edges, folds and seams also get their planes.
    pub(super) fn enqueue(&mut self, mesh: &GroupMesh, first: bool) {
        if first {
            self.add_planes(mesh);
        }
        self.candidates.clear();
        self.costs.clear();
        for (triangle, vertices) in self.corners.iter().enumerate() {
            if !self.alive[triangle] {
                continue;
            }
            let places = vertices.map(|vertex| self.place_of[vertex as usize]);
            for side in 0..3 {
                let (a, b) = (places[side], places[(side + 1) % 3]);
                let fixed = [a, b].map(|place| mesh.rules[place as usize] != FREE);
                // Once for the two triangles of an edge; one that may be open may have no other triangle.
                if a > b && fixed != [true; 2] {
                    continue;
                }
                if let Some((cost, candidate)) = self.candidate(mesh, [a, b], Freedom::Kept) {
                    self.costs.push(cost);
                    self.candidates.push(candidate);
                }
            }
        }
        self.queue.clear(self.candidates.len());
        for (number, &cost) in (0..).zip(&self.costs) {
            self.queue.push(number, cost);
        }
    }

    /// Normal of a triangle, as long as it is large.
    fn normal(&self, mesh: &GroupMesh, triangle: u16) -> [f32; 3] {
        let places = mesh.places(self.corners[triangle as usize]);
        let [a, b, c] = places.map(|place| mesh.positions[place]);
        cross(sub(b, a), sub(c, a))
    }

    /// Marks places where the surface lies on itself, as both sides of a leaf do along its outline: planes say nothing there
    /// of where it ends.
    fn find_folds(&mut self) {
        let places = || self.quadrics.iter().zip(&self.normals);
        let turned = |(quadric, normal): (&Quadric, &[f32; 3]), least: f32| {
            dot(*normal, *normal) < least * least * quadric.weight * quadric.weight
        };
        refill(
            &mut self.folded,
            places().map(|place| turned(place, FOLDED)),
        );
        refill(
            &mut self.creased,
            places().map(|place| turned(place, CREASED)),
        );
    }

    /// Adds the planes of all open edges, folds and seams. Each has an end that is open, folded or of several vertices.
    fn add_planes(&mut self, mesh: &GroupMesh) {
        let looked_at = |state: &Self, place: u16| {
            let own = place as usize;
            state.only[own] == NONE || mesh.rules[own] == OPEN || state.folded[own]
        };
        let mut around = std::mem::take(&mut self.around);
        let mut slots = std::mem::take(&mut self.slots);
        slots.resize(mesh.positions.len().max(slots.len()), 0);
        for place in 0..mesh.positions.len() as u16 {
            if !looked_at(self, place) {
                continue;
            }
            around.clear();
            self.now += 1;
            let mut corner = self.head[place as usize];
            while corner != NONE {
                let (triangle, k) = (corner as usize / 3, corner as usize % 3);
                let vertices = self.corners[triangle];
                for (side, along) in [((k + 1) % 3, true), ((k + 2) % 3, false)] {
                    let neighbour = self.place(vertices[side]);
                    // It has had its turn.
                    if neighbour < place && looked_at(self, neighbour) {
                        continue;
                    }
                    let slot = &mut slots[neighbour as usize];
                    if self.stamp[neighbour as usize] != self.now {
                        self.stamp[neighbour as usize] = self.now;
                        *slot = around.len() as u16;
                        around.push(Around {
                            neighbour,
                            along: [NONE; 2],
                            against: [NONE; 2],
                            triangles: [NONE; 2],
                            count: 0,
                        });
                    }
                    let own = &mut around[*slot as usize];
                    let pair = [vertices[k], vertices[side]];
                    match along {
                        true => own.along = pair,
                        false => own.against = pair,
                    }
                    own.triangles[usize::from(!along)] = triangle as u16;
                    own.count = own.count.saturating_add(1);
                }
                corner = self.next[corner as usize];
            }
            for edge in &around {
                self.add_edge_planes(mesh, place, edge);
            }
        }
        self.around = around;
        self.slots = slots;
    }

    /// Planes that hold an open edge, a fold or a seam in place, upright on its triangle.
    fn add_edge_planes(&mut self, mesh: &GroupMesh, place: u16, edge: &Around) {
        let open = edge.along[0] == NONE || edge.against[0] == NONE;
        let differs = |end: usize| seam(mesh, edge.along[end], edge.against[end]);
        let folded = || {
            let [a, b] = edge.triangles.map(|triangle| self.normal(mesh, triangle));
            is_fold(a, b)
        };
        let ends = open || folded();
        if ends && edge.count == 2 {
            self.on_line[place as usize] = true;
            self.on_line[edge.neighbour as usize] = true;
        }
        if !ends && !differs(0) && !differs(1) {
            return;
        }
        let [a, b] = [place, edge.neighbour].map(|place| place as usize);
        if mesh.rules[a] == LOCKED && mesh.rules[b] == LOCKED {
            return;
        }
        let [along, against] = edge.triangles;
        let normal = self.normal(mesh, if along == NONE { against } else { along });
        let side = sub(mesh.positions[b], mesh.positions[a]);
        let upright = cross(side, normal);
        let square = dot(upright, upright);
        if square <= 0.0 {
            return;
        }
        let unit = upright.map(|value| value / square.sqrt());
        let weight = if ends { OPEN_EDGE_WEIGHT } else { SEAM_WEIGHT };
        let plane = Quadric::plane(unit, weight * dot(side, side));
        for place in [a, b] {
            self.quadrics[place].add_matrix(&plane);
        }
    }
}

/// Whether the surface turns back between two triangles of these normals.
pub(super) fn is_fold(a: [f32; 3], b: [f32; 3]) -> bool {
    let product = dot(a, b);
    product < 0.0 && product * product > FOLD_COSINE_SQUARED * dot(a, a) * dot(b, b)
}

fn refill<T>(list: &mut Vec<T>, items: impl Iterator<Item = T>) {
    list.clear();
    list.extend(items);
}
