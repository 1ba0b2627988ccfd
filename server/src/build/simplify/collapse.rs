//! Collapse: one place after another moves onto a neighbour, the cheapest first, until few enough triangles are left.
//!
//! All triangles round a place move with it, so whatever the order, edges are closed where they were closed, as long as
//! locked places stay. Costs only grow as quadrics add up, so a cost worked out before a neighbour collapsed is a lower
//! bound: it is worked out again when its turn comes, and not before.

use super::super::borders::{FREE, LOCKED, OPEN};
use super::super::vertex::Grids;
use super::group::{GroupMesh, Weights};
use super::quadric::{AttributeQuadric, Quadric, cross, dot, sub};
use super::queue::Queue;

/// Weight of an open edge's plane, against a triangle's as large as the edge's square.
const OPEN_EDGE_WEIGHT: f32 = 4.0;
/// The same for an edge where attributes or materials jump.
const SEAM_WEIGHT: f32 = 1.0;
/// Share of an edge's length that counts as an error between edges that cost nothing else, so that flat parts keep
/// triangles of good shape.
const LENGTH_WEIGHT: f32 = 1e-6;
/// Square of the cosine between a triangle's normals before and after: beyond 75 degrees it has flipped.
const FLIP_COSINE_SQUARED: f32 = 0.0625;
/// Triangles flatter than this share of their longest edge have no gradients.
const NEEDLE: f32 = 1e-5;
/// Most vertices of a place that are told apart.
const MOST_WEDGES: usize = 16;

const NONE: u16 = u16::MAX;

/// How freely places may collapse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Freedom {
    /// Seams stay seams, loose parts stay, and the surface stays as connected as it was.
    Kept,
    /// Seams of attributes may be crossed at the price of their difference; parts may vanish.
    Released,
}

/// An edge that waits for its turn.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    ends: [u16; 2],
    /// Times that something had collapsed onto the ends when the cost was worked out.
    age: u32,
    /// The first end moves onto the second, or the other way round.
    backwards: bool,
    /// The other way has been refused.
    last_chance: bool,
}

/// The state of a simplification; kept between groups.
#[derive(Debug)]
pub(super) struct Collapser<const K: usize> {
    /// Where each place has gone: itself while it is there.
    pub moved_to: Vec<u16>,
    /// Vertices of each triangle.
    pub corners: Vec<[u16; 3]>,
    pub alive: Vec<bool>,
    pub live: usize,
    /// First and last corner at each place, and the next of each; corner = 3 triangle + k.
    head: Vec<u16>,
    tail: Vec<u16>,
    next: Vec<u16>,
    age: Vec<u32>,
    pub quadrics: Vec<Quadric>,
    /// Next vertex of the same place, in a ring.
    pub ring: Vec<u16>,
    /// Live corners of each vertex.
    pub uses: Vec<u16>,
    pub attributes: Vec<[f32; K]>,
    pub attribute_quadrics: Vec<AttributeQuadric<K>>,
    /// Largest mean square of the attributes' error so far.
    pub attribute_error_squared: f32,
    /// Whether a place on an open edge has moved.
    pub open_moved: bool,
    candidates: Vec<Candidate>,
    queue: Queue,
    stamp: Vec<u32>,
    now: u32,
    around: Vec<Around>,
    /// Number of each neighbour in `around`.
    slots: Vec<u16>,
}

/// What the edge from a place to a neighbour looks like from its two sides.
#[derive(Debug, Clone, Copy)]
struct Around {
    neighbour: u16,
    /// Vertices here and there of the triangle along the edge, and of the one against it.
    along: [u16; 2],
    against: [u16; 2],
    triangle: u16,
}

/// Pairs of vertices, one to go and one to take its corners.
type Pairs = ([[u16; 2]; MOST_WEDGES], usize);

impl<const K: usize> Default for Collapser<K> {
    fn default() -> Self {
        Self {
            moved_to: Vec::new(),
            corners: Vec::new(),
            alive: Vec::new(),
            live: 0,
            head: Vec::new(),
            tail: Vec::new(),
            next: Vec::new(),
            age: Vec::new(),
            quadrics: Vec::new(),
            ring: Vec::new(),
            uses: Vec::new(),
            attributes: Vec::new(),
            attribute_quadrics: Vec::new(),
            attribute_error_squared: 0.0,
            open_moved: false,
            candidates: Vec::new(),
            queue: Queue::default(),
            stamp: Vec::new(),
            now: 0,
            around: Vec::new(),
            slots: Vec::new(),
        }
    }
}

impl<const K: usize> Collapser<K> {
    /// Sets up the connectivity and the quadrics of a group.
    pub fn start(&mut self, mesh: &GroupMesh, grids: &Grids, weights: &Weights) {
        let places = mesh.positions.len();
        let vertices = mesh.welder.vertices.len();
        let triangles = mesh.triangles.len();
        refill(&mut self.moved_to, (0..places).map(|place| place as u16));
        refill(&mut self.corners, mesh.triangles.iter().copied());
        refill(&mut self.alive, std::iter::repeat_n(true, triangles));
        self.live = triangles;
        refill(&mut self.head, std::iter::repeat_n(NONE, places));
        refill(&mut self.tail, std::iter::repeat_n(NONE, places));
        refill(&mut self.next, std::iter::repeat_n(NONE, 3 * triangles));
        refill(&mut self.age, std::iter::repeat_n(0, places));
        refill(&mut self.stamp, std::iter::repeat_n(0, places));
        refill(
            &mut self.quadrics,
            std::iter::repeat_n(Quadric::default(), places),
        );
        refill(&mut self.uses, std::iter::repeat_n(0, vertices));
        refill(
            &mut self.attribute_quadrics,
            std::iter::repeat_n(
                AttributeQuadric::default(),
                if K > 0 { vertices } else { 0 },
            ),
        );
        let uv_base = mesh.uv_base();
        let attributes = if K > 0 { vertices } else { 0 };
        refill(
            &mut self.attributes,
            (0..attributes).map(|vertex| mesh.attributes(grids, weights, uv_base, vertex)),
        );
        (self.now, self.attribute_error_squared, self.open_moved) = (0, 0.0, false);
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
    }

    fn rings(&mut self, mesh: &GroupMesh) {
        refill(
            &mut self.ring,
            (0..mesh.welder.vertices.len()).map(|vertex| vertex as u16),
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
            (0..6).for_each(|i| quadric.a[i] += plane.a[i]);
            quadric.weight += area;
        }
        if K == 0 {
            return;
        }
        let longest = dot(ab, ab).max(dot(ac, ac));
        if length < NEEDLE * longest {
            return;
        }
        let duals = [cross(ac, across), cross(across, ab)].map(|v| v.map(|value| value / square));
        let [own, to_b, to_c] = triangle.map(|vertex| &self.attributes[vertex as usize]);
        let steps = [to_b, to_c].map(|to| std::array::from_fn(|k| to[k] - own[k]));
        let quadric = AttributeQuadric::<K>::triangle(duals, steps, area);
        for vertex in triangle {
            let sum = &mut self.attribute_quadrics[vertex as usize];
            (0..6).for_each(|i| sum.base.a[i] += quadric.base.a[i]);
            sum.base.weight += area;
            for axis in 0..3 {
                (0..K).for_each(|k| sum.gradient[axis][k] += quadric.gradient[axis][k]);
            }
        }
    }

    /// Collapses until at most `target` triangles are left or nothing more is allowed.
    pub fn run(&mut self, mesh: &GroupMesh, target: usize, freedom: Freedom, first: bool) {
        self.enqueue(mesh, freedom, first);
        while self.live > target {
            let Some(number) = self.queue.pop() else {
                return;
            };
            let candidate = self.candidates[number as usize];
            let ends = candidate.ends.map(|end| self.find(end));
            if ends[0] == ends[1] {
                continue;
            }
            if candidate.ends != ends || candidate.age != self.age_of(ends) {
                if let Some((cost, fresh)) = self.evaluate(mesh, ends, freedom) {
                    self.candidates[number as usize] = fresh;
                    self.queue.push(number, cost);
                }
                continue;
            }
            let [from, to] = match candidate.backwards {
                false => ends,
                true => [ends[1], ends[0]],
            };
            if !self.collapse(mesh, from, to, freedom) && !candidate.last_chance {
                if let Some(cost) = self.cost(mesh, to, from, freedom) {
                    self.candidates[number as usize] = Candidate {
                        backwards: !candidate.backwards,
                        last_chance: true,
                        ..candidate
                    };
                    self.queue.push(number, cost);
                }
            }
        }
    }

    /// Queues every live edge; the first time, open edges and seams also get their planes.
    fn enqueue(&mut self, mesh: &GroupMesh, freedom: Freedom, first: bool) {
        self.candidates.clear();
        let mut around = std::mem::take(&mut self.around);
        let mut slots = std::mem::take(&mut self.slots);
        slots.resize(mesh.positions.len().max(slots.len()), 0);
        for place in 0..mesh.positions.len() as u16 {
            if self.moved_to[place as usize] != place {
                continue;
            }
            around.clear();
            self.now += 1;
            let mut corner = self.head[place as usize];
            while corner != NONE {
                let (triangle, k) = (corner as usize / 3, corner as usize % 3);
                if self.alive[triangle] {
                    let vertices = self.triangle(triangle);
                    for (side, along) in [((k + 1) % 3, true), ((k + 2) % 3, false)] {
                        let neighbour = self.place(mesh, vertices[side]);
                        let slot = &mut slots[neighbour as usize];
                        if self.stamp[neighbour as usize] != self.now {
                            self.stamp[neighbour as usize] = self.now;
                            *slot = around.len() as u16;
                            around.push(Around {
                                neighbour,
                                along: [NONE; 2],
                                against: [NONE; 2],
                                triangle: triangle as u16,
                            });
                        }
                        let own = &mut around[*slot as usize];
                        let pair = [vertices[k], vertices[side]];
                        if along {
                            own.along = pair;
                        } else {
                            own.against = pair;
                        }
                    }
                }
                corner = self.next[corner as usize];
            }
            for edge in &around {
                if edge.neighbour < place {
                    continue;
                }
                if first {
                    self.add_edge_planes(mesh, place, edge);
                }
                self.candidates.push(Candidate {
                    ends: [place, edge.neighbour],
                    age: 0,
                    backwards: false,
                    last_chance: false,
                });
            }
        }
        self.around = around;
        self.slots = slots;
        self.queue.clear(self.candidates.len());
        for number in 0..self.candidates.len() {
            let ends = self.candidates[number].ends;
            if let Some((cost, fresh)) = self.evaluate(mesh, ends, freedom) {
                self.candidates[number] = fresh;
                self.queue.push(number as u32, cost);
            }
        }
    }

    /// Planes that hold an open edge or a seam in place, upright on its triangle.
    fn add_edge_planes(&mut self, mesh: &GroupMesh, place: u16, edge: &Around) {
        let open = edge.along[0] == NONE || edge.against[0] == NONE;
        if !open && edge.along == edge.against {
            return;
        }
        let [a, b] = [place, edge.neighbour].map(|place| place as usize);
        if mesh.rules[a] == LOCKED && mesh.rules[b] == LOCKED {
            return;
        }
        let [p, q, r] = mesh
            .places(self.triangle(edge.triangle as usize))
            .map(|place| mesh.positions[place]);
        let normal = cross(sub(q, p), sub(r, p));
        let side = sub(mesh.positions[b], mesh.positions[a]);
        let upright = cross(side, normal);
        let square = dot(upright, upright);
        if square <= 0.0 {
            return;
        }
        let unit = upright.map(|value| value / square.sqrt());
        let weight = if open { OPEN_EDGE_WEIGHT } else { SEAM_WEIGHT };
        let plane = Quadric::plane(unit, weight * dot(side, side));
        for place in [a, b] {
            let quadric = &mut self.quadrics[place];
            (0..6).for_each(|i| quadric.a[i] += plane.a[i]);
        }
    }

    pub fn find(&self, mut place: u16) -> u16 {
        while self.moved_to[place as usize] != place {
            place = self.moved_to[place as usize];
        }
        place
    }

    /// Whether something has collapsed onto a place, and it is still there.
    pub fn has_taken(&self, place: u16) -> bool {
        self.moved_to[place as usize] == place && self.age[place as usize] > 0
    }

    fn age_of(&self, [a, b]: [u16; 2]) -> u32 {
        self.age[a as usize] + self.age[b as usize]
    }

    /// The cheaper way to collapse an edge, if any is allowed.
    fn evaluate(
        &self,
        mesh: &GroupMesh,
        ends: [u16; 2],
        freedom: Freedom,
    ) -> Option<(f32, Candidate)> {
        let forwards = self.cost(mesh, ends[0], ends[1], freedom);
        let backwards = self.cost(mesh, ends[1], ends[0], freedom);
        let fresh = |backwards: bool, last_chance: bool| Candidate {
            ends,
            age: self.age_of(ends),
            backwards,
            last_chance,
        };
        match (forwards, backwards) {
            (None, None) => None,
            (Some(cost), None) => Some((cost, fresh(false, true))),
            (None, Some(cost)) => Some((cost, fresh(true, true))),
            (Some(there), Some(back)) if there <= back => Some((there, fresh(false, false))),
            (Some(_), Some(back)) => Some((back, fresh(true, false))),
        }
    }

    /// What it costs to move all of `from` onto `to`; `None` where that is not allowed whatever lies round it.
    fn cost(&self, mesh: &GroupMesh, from: u16, to: u16, freedom: Freedom) -> Option<f32> {
        let (from_rule, to_rule) = (mesh.rules[from as usize], mesh.rules[to as usize]);
        if from_rule == LOCKED || from_rule == OPEN && to_rule == FREE {
            return None;
        }
        let offset = sub(mesh.positions[to as usize], mesh.positions[from as usize]);
        let quadric = &self.quadrics[from as usize];
        let mut cost = quadric.at(offset)
            + self.quadrics[to as usize].c
            + LENGTH_WEIGHT * quadric.weight * dot(offset, offset);
        let first = self.first_vertex(mesh, from);
        if self.ring[first as usize] == first {
            // One vertex: any vertex of the other end that shares a triangle with it takes its corners.
            if K > 0 {
                let target = self.first_vertex(mesh, to);
                let target = match self.ring[target as usize] == target {
                    true => target,
                    false => self.partner(mesh, from, to)?,
                };
                cost += self.attribute_cost(offset, first, target);
            }
            return Some(cost);
        }
        let (pairs, count) = self.pairs(mesh, from, to, freedom)?;
        if K > 0 {
            for &[own, target] in &pairs[..count] {
                cost += self.attribute_cost(offset, own, target);
            }
        }
        Some(cost)
    }

    fn attribute_cost(&self, offset: [f32; 3], own: u16, target: u16) -> f32 {
        let change = self.change(own, target);
        let quadric = &self.attribute_quadrics[own as usize];
        quadric.at(offset, &change) + self.attribute_quadrics[target as usize].base.c
    }

    fn change(&self, own: u16, target: u16) -> [f32; K] {
        let (from, to) = (
            &self.attributes[own as usize],
            &self.attributes[target as usize],
        );
        std::array::from_fn(|k| to[k] - from[k])
    }

    fn first_vertex(&self, mesh: &GroupMesh, place: u16) -> u16 {
        mesh.welder.first_vertex(place as u32) as u16
    }

    pub fn triangle(&self, triangle: usize) -> [u16; 3] {
        self.corners[triangle]
    }

    fn place(&self, mesh: &GroupMesh, vertex: u16) -> u16 {
        mesh.welder.place_of[vertex as usize] as u16
    }

    /// The vertex of `to` in some triangle that it shares with `from`.
    fn partner(&self, mesh: &GroupMesh, from: u16, to: u16) -> Option<u16> {
        self.star(from).find_map(|(triangle, _)| {
            let vertices = self.triangle(triangle);
            vertices
                .into_iter()
                .find(|&vertex| self.place(mesh, vertex) == to)
        })
    }

    /// Live triangles round a place, with the corner that lies there.
    pub fn star(&self, place: u16) -> impl Iterator<Item = (usize, usize)> + '_ {
        let mut corner = self.head[place as usize];
        std::iter::from_fn(move || {
            while corner != NONE {
                let own = corner as usize;
                corner = self.next[own];
                if self.alive[own / 3] {
                    return Some((own / 3, own % 3));
                }
            }
            None
        })
    }

    /// For every vertex of `from` the one of `to` that takes its corners: of the triangle that both share, or where seams
    /// are released the one of the same material whose attributes are nearest.
    fn pairs(&self, mesh: &GroupMesh, from: u16, to: u16, freedom: Freedom) -> Option<Pairs> {
        let mut pairs = [[NONE; 2]; MOST_WEDGES];
        let mut count = 0;
        for (triangle, k) in self.star(from) {
            let vertices = self.triangle(triangle);
            let shared = (1..3)
                .map(|step| vertices[(k + step) % 3])
                .find(|&vertex| self.place(mesh, vertex) == to);
            let Some(target) = shared else { continue };
            let own = vertices[k];
            match pairs[..count].iter().find(|pair| pair[0] == own) {
                // The same vertex here, two there: the seam begins at this place.
                Some(pair) if pair[1] != target && freedom == Freedom::Kept => return None,
                Some(_) => {}
                None if count == MOST_WEDGES => return None,
                None => {
                    pairs[count] = [own, target];
                    count += 1;
                }
            }
        }
        if count == 0 {
            return None;
        }
        let first = self.first_vertex(mesh, from);
        let mut vertex = first;
        loop {
            let used = self.uses[vertex as usize] > 0;
            if used && !pairs[..count].iter().any(|pair| pair[0] == vertex) {
                if freedom == Freedom::Kept || count == MOST_WEDGES {
                    return None;
                }
                pairs[count] = [vertex, self.nearest_vertex(mesh, vertex, to)?];
                count += 1;
            }
            vertex = self.ring[vertex as usize];
            if vertex == first {
                return Some((pairs, count));
            }
        }
    }

    fn nearest_vertex(&self, mesh: &GroupMesh, own: u16, to: u16) -> Option<u16> {
        let material = mesh.welder.vertices[own as usize].1;
        let first = self.first_vertex(mesh, to);
        let mut best = None;
        let mut vertex = first;
        loop {
            if mesh.welder.vertices[vertex as usize].1 == material {
                let away: f32 = match K {
                    0 => 0.0,
                    _ => self.change(own, vertex).iter().map(|x| x * x).sum(),
                };
                if best.is_none_or(|(least, _)| away < least) {
                    best = Some((away, vertex));
                }
            }
            vertex = self.ring[vertex as usize];
            if vertex == first {
                return best.map(|(_, vertex)| vertex);
            }
        }
    }

    /// Moves all of `from` onto `to`, unless that would flip a triangle, or pinch the surface.
    fn collapse(&mut self, mesh: &GroupMesh, from: u16, to: u16, freedom: Freedom) -> bool {
        let Some((pairs, count)) = self.pairs(mesh, from, to, freedom) else {
            return false;
        };
        if !self.allowed(mesh, from, to, freedom) {
            return false;
        }
        let mut corner = self.head[from as usize];
        while corner != NONE {
            let (triangle, k) = (corner as usize / 3, corner as usize % 3);
            corner = self.next[corner as usize];
            if !self.alive[triangle] {
                continue;
            }
            let vertices = self.corners[triangle];
            if vertices
                .iter()
                .any(|&vertex| self.place(mesh, vertex) == to)
            {
                self.alive[triangle] = false;
                self.live -= 1;
                vertices
                    .iter()
                    .for_each(|&vertex| self.uses[vertex as usize] -= 1);
                continue;
            }
            let own = vertices[k];
            if let Some(pair) = pairs[..count].iter().find(|pair| pair[0] == own) {
                self.corners[triangle][k] = pair[1];
                self.uses[own as usize] -= 1;
                self.uses[pair[1] as usize] += 1;
            }
        }
        let (head, tail) = (self.head[from as usize], self.tail[from as usize]);
        let end = self.tail[to as usize];
        self.next[end as usize] = head;
        self.tail[to as usize] = tail;
        let offset = sub(mesh.positions[to as usize], mesh.positions[from as usize]);
        let moved = self.quadrics[from as usize].moved(offset);
        self.quadrics[to as usize].add(&moved);
        if K > 0 {
            for &[own, target] in &pairs[..count] {
                let change = self.change(own, target);
                let moved = self.attribute_quadrics[own as usize].moved(offset, &change);
                let sum = &mut self.attribute_quadrics[target as usize];
                sum.add(&moved);
                if sum.base.weight > 0.0 {
                    self.attribute_error_squared = self
                        .attribute_error_squared
                        .max(sum.base.c / sum.base.weight);
                }
            }
        }
        self.moved_to[from as usize] = to;
        self.age[to as usize] += 1;
        self.open_moved |= mesh.rules[from as usize] == OPEN;
        true
    }

    fn allowed(&mut self, mesh: &GroupMesh, from: u16, to: u16, freedom: Freedom) -> bool {
        self.now += 1;
        let mut opposite = [NONE; 8];
        let (mut dying, mut kept) = (0, 0);
        for (triangle, k) in self.star(from) {
            let vertices = self.triangle(triangle);
            let others = [1, 2].map(|step| self.place(mesh, vertices[(k + step) % 3]));
            let third = match others {
                [a, b] if a == to => b,
                [a, b] if b == to => a,
                _ => {
                    kept += 1;
                    let at = |place: u16| mesh.positions[place as usize];
                    if flips(at(from), at(to), others.map(at)) {
                        return false;
                    }
                    continue;
                }
            };
            if dying == opposite.len() {
                return false;
            }
            opposite[dying] = third;
            dying += 1;
        }
        if dying == 0 {
            return false;
        }
        // A place on an open edge moves along an open edge, which has one triangle.
        if mesh.rules[from as usize] == OPEN && dying != 1 && freedom == Freedom::Kept {
            return false;
        }
        if freedom == Freedom::Released {
            return true;
        }
        if kept == 0 {
            return false;
        }
        // The link condition (Dey et al., "Topology preserving edge contraction", 1999): no neighbour in common but
        // across the triangles that go, or the surface would be pinched.
        let now = self.now;
        let mut corner = self.head[to as usize];
        while corner != NONE {
            let triangle = corner as usize / 3;
            corner = self.next[corner as usize];
            if self.alive[triangle] {
                for vertex in self.corners[triangle] {
                    let place = self.place(mesh, vertex);
                    self.stamp[place as usize] = now;
                }
            }
        }
        for (triangle, _) in self.star(from) {
            for vertex in self.triangle(triangle) {
                let place = self.place(mesh, vertex);
                if self.stamp[place as usize] == now
                    && place != from
                    && place != to
                    && !opposite[..dying].contains(&place)
                {
                    return false;
                }
            }
        }
        true
    }
}

/// Whether the triangle over `others` turns over when its third corner moves. One without area cannot.
pub(super) fn flips(from: [f32; 3], to: [f32; 3], [a, b]: [[f32; 3]; 2]) -> bool {
    let before = cross(sub(a, from), sub(b, from));
    let after = cross(sub(a, to), sub(b, to));
    let (square, product) = (dot(before, before), dot(before, after));
    if square <= 0.0 {
        return false;
    }
    product <= 0.0 || product * product < FLIP_COSINE_SQUARED * square * dot(after, after)
}

fn refill<T>(list: &mut Vec<T>, items: impl Iterator<Item = T>) {
    list.clear();
    list.extend(items);
}
