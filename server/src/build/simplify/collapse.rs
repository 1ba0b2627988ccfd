//! Collapse: one place after another moves onto a neighbour, the cheapest first, until few enough triangles are left.
//!
//! All triangles round a place move with it, so whatever the order, edges are closed where they were closed, as long as
//! locked places stay. Costs only grow as quadrics add up, and attributes only add to them, so what an edge cost before a
//! neighbour collapsed, and without attributes, is a lower bound: the whole is worked out when its turn comes, not before.

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
    /// Seams of texture coordinates and materials stay seams, loose parts stay, the surface stays as connected as it was.
    Kept,
    /// Seams of texture coordinates may be crossed at the price of their difference; parts may vanish.
    Released,
}

/// An edge that waits for its turn.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    ends: [u16; 2],
    /// Times that something had collapsed onto the ends when the cost was worked out; [`BOUND`] where only a bound is known.
    age: u32,
    /// The second end moves onto the first.
    backwards: bool,
    /// The other way has been refused.
    last_chance: bool,
}

const BOUND: u32 = u32::MAX;

/// A live triangle round a place that stays when the place moves: the corner there, and the places of the other two.
#[derive(Debug, Clone, Copy)]
struct Kept {
    triangle: u16,
    corner: u8,
    others: [u16; 2],
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
    /// Whether a border between materials has moved other than along itself.
    pub material_crossed: bool,
    /// Place of each vertex.
    place_of: Vec<u16>,
    candidates: Vec<Candidate>,
    queue: Queue,
    kept: Vec<Kept>,
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

/// Pairs of vertices, one to go and one to take its corners; how many there are, and how many of them, the first, share a
/// triangle.
type Pairs = ([[u16; 2]; MOST_WEDGES], usize, usize);

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
            material_crossed: false,
            place_of: Vec::new(),
            candidates: Vec::new(),
            queue: Queue::default(),
            kept: Vec::new(),
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
        (self.now, self.attribute_error_squared) = (0, 0.0);
        (self.open_moved, self.material_crossed) = (false, false);
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
        self.enqueue(mesh, first);
        while self.live > target {
            let Some((number, bucket)) = self.queue.pop() else {
                return;
            };
            let candidate = self.candidates[number as usize];
            let ends = candidate.ends.map(|end| self.find(end));
            if ends[0] == ends[1] {
                continue;
            }
            let mut backwards = candidate.backwards;
            let mut last_chance = candidate.last_chance;
            let age = self.age[ends[0] as usize] + self.age[ends[1] as usize];
            if candidate.age != age || candidate.ends != ends {
                let Some((cost, back)) = self.cheaper(mesh, ends, freedom) else {
                    continue;
                };
                (backwards, last_chance) = (back, false);
                self.candidates[number as usize] = Candidate {
                    ends,
                    age,
                    backwards,
                    last_chance,
                };
                if Queue::bucket(cost) > bucket {
                    self.queue.push(number, cost);
                    continue;
                }
            }
            let [from, to] = turned(ends, backwards);
            if !self.collapse(mesh, from, to, freedom) && !last_chance {
                if let Some(cost) = self.cost(mesh, to, from, freedom) {
                    self.candidates[number as usize] = Candidate {
                        ends,
                        age,
                        backwards: !backwards,
                        last_chance: true,
                    };
                    self.queue.push(number, cost);
                }
            }
        }
    }

    /// The cheaper way to collapse an edge, its cost and whether it is backwards.
    fn cheaper(&self, mesh: &GroupMesh, ends: [u16; 2], freedom: Freedom) -> Option<(f32, bool)> {
        let bound = |backwards: bool| {
            let [from, to] = turned(ends, backwards);
            match may_move(mesh, from, to) {
                true => self.distance_cost(mesh, from, to),
                false => f32::INFINITY,
            }
        };
        let bounds = [bound(false), bound(true)];
        let first = bounds[1] < bounds[0];
        let cost = |backwards: bool| {
            let [from, to] = turned(ends, backwards);
            match bounds[usize::from(backwards)] {
                f32::INFINITY => None,
                distance => self.with_attributes(mesh, from, to, freedom, distance),
            }
        };
        let own = cost(first);
        let other_bound = bounds[usize::from(!first)];
        if own.is_some_and(|own| own <= other_bound) {
            return own.map(|own| (own, first));
        }
        match (own, cost(!first)) {
            (Some(own), Some(other)) if own <= other => Some((own, first)),
            (_, Some(other)) => Some((other, !first)),
            (own, None) => own.map(|own| (own, first)),
        }
    }

    /// Queues every live edge at what it costs at least; the first time, open edges and seams also get their planes.
    fn enqueue(&mut self, mesh: &GroupMesh, first: bool) {
        if first {
            self.add_planes(mesh);
        }
        self.candidates.clear();
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
                if may_move(mesh, a, b) || may_move(mesh, b, a) {
                    self.candidates.push(Candidate {
                        ends: [a, b],
                        age: BOUND,
                        backwards: false,
                        last_chance: false,
                    });
                }
            }
        }
        self.queue.clear(self.candidates.len());
        for (number, candidate) in (0..).zip(&self.candidates) {
            let [a, b] = candidate.ends;
            let bound = |from, to| match may_move(mesh, from, to) {
                true => self.distance_cost(mesh, from, to),
                false => f32::INFINITY,
            };
            self.queue.push(number, bound(a, b).min(bound(b, a)));
        }
    }

    /// Adds the planes of all open edges and seams. Each has an end on an open edge or of several vertices.
    fn add_planes(&mut self, mesh: &GroupMesh) {
        let looked_at = |state: &Self, place: u16| {
            let vertex = state.first_vertex(mesh, place);
            state.ring[vertex as usize] != vertex || mesh.rules[place as usize] == OPEN
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
                corner = self.next[corner as usize];
            }
            for edge in &around {
                if edge.neighbour > place || !looked_at(self, edge.neighbour) {
                    self.add_edge_planes(mesh, place, edge);
                }
            }
        }
        self.around = around;
        self.slots = slots;
    }

    /// Planes that hold an open edge or a seam in place, upright on its triangle.
    fn add_edge_planes(&mut self, mesh: &GroupMesh, place: u16, edge: &Around) {
        let open = edge.along[0] == NONE || edge.against[0] == NONE;
        let differs = |end: usize| seam(mesh, edge.along[end], edge.against[end]);
        if !open && !differs(0) && !differs(1) {
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
        loop {
            let next = self.moved_to[place as usize];
            if next == place {
                return place;
            }
            place = next;
        }
    }

    /// Whether something has collapsed onto a place, and it is still there.
    pub fn has_taken(&self, place: u16) -> bool {
        self.moved_to[place as usize] == place && self.age[place as usize] > 0
    }

    /// What it costs at least to move `from` onto `to`: the attributes come on top.
    #[inline]
    fn distance_cost(&self, mesh: &GroupMesh, from: u16, to: u16) -> f32 {
        let offset = sub(mesh.positions[to as usize], mesh.positions[from as usize]);
        let quadric = &self.quadrics[from as usize];
        quadric.at(offset)
            + self.quadrics[to as usize].c
            + LENGTH_WEIGHT * quadric.weight * dot(offset, offset)
    }

    /// What it costs to move all of `from` onto `to`; `None` where that is not allowed whatever lies round it.
    fn cost(&self, mesh: &GroupMesh, from: u16, to: u16, freedom: Freedom) -> Option<f32> {
        if !may_move(mesh, from, to) {
            return None;
        }
        let distance = self.distance_cost(mesh, from, to);
        self.with_attributes(mesh, from, to, freedom, distance)
    }

    /// The same where the cost of the distance is known.
    fn with_attributes(
        &self,
        mesh: &GroupMesh,
        from: u16,
        to: u16,
        freedom: Freedom,
        distance: f32,
    ) -> Option<f32> {
        let mut cost = distance;
        let offset = sub(mesh.positions[to as usize], mesh.positions[from as usize]);
        let first = self.first_vertex(mesh, from);
        if self.ring[first as usize] == first {
            // One vertex: any vertex of the other end that shares a triangle with it takes its corners.
            if K > 0 {
                let target = self.first_vertex(mesh, to);
                let target = match self.ring[target as usize] == target {
                    true => target,
                    false => self.partner(from, to)?,
                };
                cost += self.attribute_cost(offset, first, target);
            }
            return Some(cost);
        }
        let (pairs, count, _) = self.pairs(mesh, from, to, freedom)?;
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

    fn place(&self, vertex: u16) -> u16 {
        self.place_of[vertex as usize]
    }

    /// The vertex of `to` in some triangle that it shares with `from`.
    fn partner(&self, from: u16, to: u16) -> Option<u16> {
        self.star(from).find_map(|(triangle, _)| {
            let vertices = self.triangle(triangle);
            vertices
                .into_iter()
                .find(|&vertex| self.place(vertex) == to)
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

    /// For every vertex of `from` the one of `to` that takes its corners: of the triangle that both share, else the nearest
    /// one in attributes on the same side of all seams, else, where seams are released, of the same material.
    fn pairs(&self, mesh: &GroupMesh, from: u16, to: u16, freedom: Freedom) -> Option<Pairs> {
        let mut pairs = [[NONE; 2]; MOST_WEDGES];
        let mut count = 0;
        for (triangle, k) in self.star(from) {
            let vertices = self.corners[triangle];
            let shared = (1..3)
                .map(|step| vertices[(k + step) % 3])
                .find(|&vertex| self.place(vertex) == to);
            let Some(target) = shared else { continue };
            let own = vertices[k];
            match pairs[..count].iter().find(|pair| pair[0] == own) {
                // The same vertex here, two there: a seam begins at this place.
                Some(pair) => {
                    if freedom == Freedom::Kept && seam(mesh, pair[1], target) {
                        return None;
                    }
                }
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
        let sharing = count;
        let first = self.first_vertex(mesh, from);
        let mut vertex = first;
        loop {
            let used = self.uses[vertex as usize] > 0;
            if used && !pairs[..count].iter().any(|pair| pair[0] == vertex) {
                if count == MOST_WEDGES {
                    return None;
                }
                let beside = pairs[..sharing]
                    .iter()
                    .find(|pair| !seam(mesh, pair[0], vertex));
                let target = match beside {
                    Some(pair) => {
                        self.nearest_vertex(mesh, vertex, to, |other| !seam(mesh, other, pair[1]))
                    }
                    None if freedom == Freedom::Kept => None,
                    None => {
                        let slot = |vertex: u16| mesh.welder.vertices[vertex as usize].1;
                        self.nearest_vertex(mesh, vertex, to, |other| slot(other) == slot(vertex))
                    }
                };
                pairs[count] = [vertex, target?];
                count += 1;
            }
            vertex = self.ring[vertex as usize];
            if vertex == first {
                return Some((pairs, count, sharing));
            }
        }
    }

    /// The vertex of `to`, of those that are `fit`, whose attributes are nearest.
    fn nearest_vertex(
        &self,
        mesh: &GroupMesh,
        own: u16,
        to: u16,
        fit: impl Fn(u16) -> bool,
    ) -> Option<u16> {
        let first = self.first_vertex(mesh, to);
        let mut best = None;
        let mut vertex = first;
        loop {
            if fit(vertex) {
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
        let mut kept = std::mem::take(&mut self.kept);
        let allowed = self.allowed(mesh, from, to, freedom, &mut kept);
        if let Some((pairs, count, sharing)) = &allowed {
            let slot = |pair: &[u16; 2]| mesh.welder.vertices[pair[0] as usize].1;
            let pairs = &pairs[..*count];
            self.material_crossed |=
                sharing < count && pairs.iter().any(|pair| slot(pair) != slot(&pairs[0]));
            self.apply(mesh, from, to, pairs, &kept);
        }
        self.kept = kept;
        allowed.is_some()
    }

    fn apply(&mut self, mesh: &GroupMesh, from: u16, to: u16, pairs: &[[u16; 2]], kept: &[Kept]) {
        let mut corner = self.head[from as usize];
        while corner != NONE {
            let triangle = corner as usize / 3;
            corner = self.next[corner as usize];
            let vertices = self.corners[triangle];
            if self.alive[triangle] && vertices.iter().any(|&vertex| self.place(vertex) == to) {
                self.alive[triangle] = false;
                self.live -= 1;
                for vertex in vertices {
                    self.uses[vertex as usize] -= 1;
                }
            }
        }
        // Only live corners move to the other list.
        let mut end = self.tail[to as usize];
        for own in kept {
            let (triangle, k) = (own.triangle as usize, own.corner as usize);
            let vertex = self.corners[triangle][k];
            if let Some(pair) = pairs.iter().find(|pair| pair[0] == vertex) {
                self.corners[triangle][k] = pair[1];
                self.uses[vertex as usize] -= 1;
                self.uses[pair[1] as usize] += 1;
            }
            let corner = own.triangle * 3 + own.corner as u16;
            self.next[end as usize] = corner;
            end = corner;
        }
        self.next[end as usize] = NONE;
        self.tail[to as usize] = end;
        let offset = sub(mesh.positions[to as usize], mesh.positions[from as usize]);
        let moved = self.quadrics[from as usize].moved(offset);
        self.quadrics[to as usize].add(&moved);
        if K > 0 {
            for &[own, target] in pairs {
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
    }

    /// Whether `from` may move onto `to` with what lies round it now; gives the vertices' pairs and fills `kept`.
    fn allowed(
        &mut self,
        mesh: &GroupMesh,
        from: u16,
        to: u16,
        freedom: Freedom,
        kept: &mut Vec<Kept>,
    ) -> Option<Pairs> {
        kept.clear();
        let mut opposite = [NONE; 8];
        let mut dying = 0;
        for (triangle, k) in self.star(from) {
            let vertices = self.corners[triangle];
            let others = [
                self.place(vertices[(k + 1) % 3]),
                self.place(vertices[(k + 2) % 3]),
            ];
            let third = match others {
                [a, b] if a == to => b,
                [a, b] if b == to => a,
                _ => {
                    kept.push(Kept {
                        triangle: triangle as u16,
                        corner: k as u8,
                        others,
                    });
                    continue;
                }
            };
            if dying == opposite.len() {
                return None;
            }
            opposite[dying] = third;
            dying += 1;
        }
        let strict = freedom == Freedom::Kept;
        // A place on an open edge moves along an open edge, which has one triangle.
        let leaves_edge = mesh.rules[from as usize] == OPEN && dying != 1;
        if dying == 0 || strict && (kept.is_empty() || leaves_edge) {
            return None;
        }
        let at = |place: u16| mesh.positions[place as usize];
        let (before, after) = (at(from), at(to));
        if kept
            .iter()
            .any(|own| flips(before, after, own.others.map(at)))
        {
            return None;
        }
        if strict && self.pinches(from, to, &opposite[..dying], kept) {
            return None;
        }
        self.pairs(mesh, from, to, freedom)
    }

    /// The link condition (Dey et al., "Topology preserving edge contraction", 1999): the two ends have no neighbour in
    /// common but across the triangles that go, or the surface would be pinched.
    fn pinches(&mut self, from: u16, to: u16, opposite: &[u16], kept: &[Kept]) -> bool {
        self.now += 1;
        for own in kept {
            for place in own.others {
                if !opposite.contains(&place) {
                    self.stamp[place as usize] = self.now;
                }
            }
        }
        // Dead corners go from the list on the way.
        let mut last = NONE;
        let mut corner = self.head[to as usize];
        let mut found = false;
        while corner != NONE {
            let next = self.next[corner as usize];
            let triangle = corner as usize / 3;
            if self.alive[triangle] {
                for vertex in self.corners[triangle] {
                    let place = self.place(vertex);
                    found |= self.stamp[place as usize] == self.now && place != to && place != from;
                }
                last = corner;
            } else if last != NONE && next != NONE {
                self.next[last as usize] = next;
            }
            corner = next;
        }
        found
    }
}

/// Whether two vertices of one place lie on different sides of a seam of texture coordinates or materials. Normals and
/// colours that differ are no seam: crossing costs what they differ by.
fn seam(mesh: &GroupMesh, a: u16, b: u16) -> bool {
    let [a, b] = [a, b].map(|vertex| &mesh.welder.vertices[vertex as usize]);
    a.0.uv != b.0.uv || a.1 != b.1
}

fn turned(ends: [u16; 2], backwards: bool) -> [u16; 2] {
    match backwards {
        true => [ends[1], ends[0]],
        false => ends,
    }
}

/// Whether the rules let `from` move onto `to`.
fn may_move(mesh: &GroupMesh, from: u16, to: u16) -> bool {
    match (mesh.rules[from as usize], mesh.rules[to as usize]) {
        (LOCKED, _) => false,
        (OPEN, to) => to != FREE,
        _ => true,
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
