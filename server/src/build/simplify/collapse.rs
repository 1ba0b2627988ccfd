//! Collapse: one place after another moves onto a neighbour, the cheapest first, until few enough triangles are left.
//!
//! All triangles round a place move with it, so whatever the order, edges are closed where they were closed, as long as
//! locked places stay. Costs only grow as quadrics add up, so what an edge cost before a neighbour collapsed is a lower bound:
//! it is worked out again when its turn comes, not before.

use super::super::borders::{FREE, LOCKED, OPEN};
use super::budget::Budget;
use super::group::GroupMesh;
use super::pairs::Pairs;
use super::quadric::{AttributeQuadric, Quadric, cross, dot, sub};
use super::queue::Queue;
use super::setup::Around;
use glam::Vec4;

/// Square of the cosine between a triangle's normals before and after: beyond 75 degrees it has flipped.
const FLIP_COSINE_SQUARED: f32 = 0.0625;

/// How many times its cost a collapse must be worth that breaks a seam or a connection: 4 and 16 give much the same.
const RELEASED: f32 = 8.0;

pub(super) const NONE: u16 = u16::MAX;

/// How freely places may collapse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Freedom {
    /// Seams of texture coordinates and materials stay seams, loose parts stay, the surface stays as connected as it was.
    Kept,
    /// Seams of texture coordinates may be crossed at the price of their difference; parts may vanish.
    Released,
}

impl Freedom {
    /// What the distance costs, in squares.
    fn factor(self) -> f32 {
        match self {
            Self::Kept => 1.0,
            Self::Released => RELEASED,
        }
    }
}

/// An edge that waits for its turn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) ends: [u16; 2],
    /// Times that something had collapsed onto the ends when the cost was worked out.
    pub(super) age: u32,
    /// The second end moves onto the first.
    pub(super) backwards: bool,
    /// The other way has been refused.
    pub(super) last_chance: bool,
    pub(super) freedom: Freedom,
    /// It was refused, but not if it were free.
    pub(super) strayed: bool,
}

/// Why a collapse does not happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Refusal {
    /// Not as things lie now.
    Plain,
    /// Not while seams and connections are kept.
    Kept,
}

/// A live triangle round a place that stays when the place moves: the corner there, and the places of the other two.
#[derive(Debug, Clone, Copy)]
pub(super) struct Kept {
    pub(super) triangle: u16,
    corner: u8,
    pub(super) others: [u16; 2],
}

/// The state of a simplification; kept between groups.
#[derive(Debug)]
pub(super) struct Collapser<const L: usize> {
    /// Where each place has gone: itself while it is there.
    pub(super) moved_to: Vec<u16>,
    /// Vertices of each triangle.
    pub(super) corners: Vec<[u16; 3]>,
    pub(super) alive: Vec<bool>,
    pub(super) live: usize,
    /// First and last corner at each place, and the next of each; corner = 3 triangle + k.
    pub(super) head: Vec<u16>,
    pub(super) tail: Vec<u16>,
    pub(super) next: Vec<u16>,
    /// Of each place that has gone, the third corners of two triangles that went with it, or [`NONE`].
    pub(super) thirds: Vec<[u16; 2]>,
    pub(super) age: Vec<u32>,
    pub(super) quadrics: Vec<Quadric>,
    /// Sum of the normals round each place, times the areas.
    pub(super) normals: Vec<[f32; 3]>,
    /// Whether the surface lies on itself round a place, or round one that has gone there.
    pub(super) folded: Vec<bool>,
    /// Whether there is a crease at a place, or one that has gone there, or that was released: a mean over the planes says
    /// little of a narrow side's.
    pub(super) creased: Vec<bool>,
    /// Whether a connection was given up at a place, or one that has gone there.
    pub(super) torn: Vec<bool>,
    /// Next vertex of the same place, in a ring.
    pub(super) ring: Vec<u16>,
    /// The vertex of each place that has one, or [`NONE`].
    pub(super) only: Vec<u16>,
    /// Live corners of each vertex.
    pub(super) uses: Vec<u16>,
    pub(super) attributes: Vec<[Vec4; L]>,
    pub(super) attribute_quadrics: Vec<AttributeQuadric<L>>,
    /// Whether a place on an open edge has moved.
    pub(super) open_moved: bool,
    /// Place of each vertex.
    pub(super) place_of: Vec<u16>,
    pub(super) candidates: Vec<Candidate>,
    /// What each candidate costs at first.
    pub(super) costs: Vec<f32>,
    pub(super) queue: Queue,
    pub(super) kept: Vec<Kept>,
    /// Whether each place lies on an open edge, on a fold or between materials.
    pub(super) on_line: Vec<bool>,
    /// How far the source may lie off.
    pub(super) budget: Budget,
    pub(super) stamp: Vec<u32>,
    pub(super) now: u32,
    pub(super) around: Vec<Around>,
    /// Number of each neighbour in `around`.
    pub(super) slots: Vec<u16>,
}

impl<const L: usize> Default for Collapser<L> {
    fn default() -> Self {
        Self {
            moved_to: Vec::new(),
            corners: Vec::new(),
            alive: Vec::new(),
            live: 0,
            head: Vec::new(),
            tail: Vec::new(),
            next: Vec::new(),
            thirds: Vec::new(),
            age: Vec::new(),
            quadrics: Vec::new(),
            normals: Vec::new(),
            folded: Vec::new(),
            creased: Vec::new(),
            torn: Vec::new(),
            ring: Vec::new(),
            only: Vec::new(),
            uses: Vec::new(),
            attributes: Vec::new(),
            attribute_quadrics: Vec::new(),
            open_moved: false,
            place_of: Vec::new(),
            candidates: Vec::new(),
            costs: Vec::new(),
            queue: Queue::default(),
            kept: Vec::new(),
            on_line: Vec::new(),
            budget: Budget::default(),
            stamp: Vec::new(),
            now: 0,
            around: Vec::new(),
            slots: Vec::new(),
        }
    }
}

impl<const L: usize> Collapser<L> {
    /// Collapses until at most `target` triangles are left or nothing more is allowed.
    pub fn run(&mut self, mesh: &GroupMesh, target: usize, first: bool) {
        self.enqueue(mesh, first);
        while self.live > target {
            let Some((number, bucket)) = self.queue.pop() else {
                return;
            };
            let mut candidate = self.candidates[number as usize];
            let ends = candidate.ends.map(|end| self.find(end));
            if ends[0] == ends[1] || self.is_double(candidate.ends, ends) {
                continue;
            }
            let age = self.age[ends[0] as usize] + self.age[ends[1] as usize];
            if candidate.age != age || candidate.ends != ends {
                let Some((cost, renewed)) = self.candidate(mesh, ends, candidate.freedom) else {
                    continue;
                };
                candidate = renewed;
                self.candidates[number as usize] = candidate;
                if Queue::bucket(cost) > bucket {
                    self.queue.push(number, cost);
                    continue;
                }
            }
            let [from, to] = turned(ends, candidate.backwards);
            let Err(refusal) = self.collapse(mesh, from, to, candidate.freedom) else {
                continue;
            };
            candidate.strayed |= refusal == Refusal::Kept;
            if !candidate.last_chance
                && let Some(cost) = self.cost(mesh, to, from, candidate.freedom)
            {
                candidate.backwards ^= true;
                candidate.last_chance = true;
                self.candidates[number as usize] = candidate;
                self.queue.push(number, cost * candidate.freedom.factor());
            } else if candidate.strayed
                && candidate.freedom == Freedom::Kept
                && let Some((cost, freer)) = self.candidate(mesh, ends, Freedom::Released)
            {
                self.candidates[number as usize] = freer;
                self.queue.push(number, cost);
            }
        }
    }

    /// The cheaper way to collapse an edge, with its cost: released where it cannot be kept.
    pub(super) fn candidate(
        &self,
        mesh: &GroupMesh,
        ends: [u16; 2],
        freedom: Freedom,
    ) -> Option<(f32, Candidate)> {
        let (cost, backwards, freedom) = match (self.cheaper(mesh, ends, freedom), freedom) {
            (Some((cost, backwards)), _) => (cost, backwards, freedom),
            (None, Freedom::Released) => return None,
            // One vertex at each end: nothing to release.
            (None, Freedom::Kept) if ends.iter().all(|&end| self.only[end as usize] != NONE) => {
                return None;
            }
            (None, Freedom::Kept) => {
                let (cost, backwards) = self.cheaper(mesh, ends, Freedom::Released)?;
                (cost, backwards, Freedom::Released)
            }
        };
        let candidate = Candidate {
            ends,
            age: self.age[ends[0] as usize] + self.age[ends[1] as usize],
            backwards,
            last_chance: false,
            freedom,
            strayed: false,
        };
        Some((cost * freedom.factor(), candidate))
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

    /// Whether another candidate stands for the edge that this one has become: one end's collapse made the edges to the
    /// third corners of the triangles that went one.
    fn is_double(&self, before: [u16; 2], ends: [u16; 2]) -> bool {
        (0..2).any(|side| {
            let mut place = before[side];
            while place != ends[side] {
                let thirds = self.thirds[place as usize];
                if thirds
                    .iter()
                    .any(|&third| third != NONE && self.find(third) == ends[1 - side])
                {
                    return true;
                }
                place = self.moved_to[place as usize];
            }
            false
        })
    }

    /// Whether something has collapsed onto a place, and it is still there.
    pub fn has_taken(&self, place: u16) -> bool {
        self.moved_to[place as usize] == place && self.age[place as usize] > 0
    }

    pub(super) fn first_vertex(&self, mesh: &GroupMesh, place: u16) -> u16 {
        mesh.welder.first_vertex(place as u32) as u16
    }

    pub fn triangle(&self, triangle: usize) -> [u16; 3] {
        self.corners[triangle]
    }

    pub(super) fn place(&self, vertex: u16) -> u16 {
        self.place_of[vertex as usize]
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

    /// Moves all of `from` onto `to`, unless that would flip a triangle, or pinch the surface.
    fn collapse(
        &mut self,
        mesh: &GroupMesh,
        from: u16,
        to: u16,
        freedom: Freedom,
    ) -> Result<(), Refusal> {
        let mut kept = std::mem::take(&mut self.kept);
        let mut allowed = self.allowed(mesh, from, to, freedom, &mut kept);
        if let Ok(pairs) = &allowed
            && !self.is_within_budget(mesh, [from, to], pairs, &kept)
        {
            allowed = Err(Refusal::Plain);
        }
        if let Ok((pairs, count)) = &allowed {
            let dying = self.dying(from, to);
            self.hand_points(mesh, from);
            self.apply(mesh, from, to, &pairs[..*count], &kept);
            self.creased[to as usize] |=
                self.creased[from as usize] || freedom == Freedom::Released;
            self.torn[to as usize] |=
                self.torn[from as usize] || freedom == Freedom::Released || dying > 2;
        }
        self.kept = kept;
        allowed.map(|_| ())
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
        if L > 0 {
            for &[own, target] in pairs {
                let change = self.change(own, target);
                let moved = self.attribute_quadrics[own as usize].moved(offset, &change);
                self.attribute_quadrics[target as usize].add(&moved);
            }
        }
        self.moved_to[from as usize] = to;
        self.age[to as usize] += 1;
        self.folded[to as usize] |= self.folded[from as usize];
        self.on_line[to as usize] |= self.on_line[from as usize];
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
    ) -> Result<Pairs, Refusal> {
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
                return Err(Refusal::Plain);
            }
            opposite[dying] = third;
            dying += 1;
        }
        let strict = freedom == Freedom::Kept;
        // A place on an open edge moves along an open edge, which has one triangle.
        let leaves_edge = mesh.rules[from as usize] == OPEN && dying != 1;
        if dying == 0 {
            return Err(Refusal::Plain);
        }
        let at = |place: u16| mesh.positions[place as usize];
        let (before, after) = (at(from), at(to));
        if kept
            .iter()
            .any(|own| flips(before, after, own.others.map(at)))
        {
            return Err(Refusal::Plain);
        }
        let changes = || kept.is_empty() || leaves_edge;
        if strict && (changes() || self.pinches(from, to, &opposite[..dying], kept)) {
            return Err(Refusal::Kept);
        }
        self.thirds[from as usize] = [opposite[0], opposite[1]];
        self.pairs(mesh, from, to, freedom).ok_or(Refusal::Kept)
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

pub(super) fn turned(ends: [u16; 2], backwards: bool) -> [u16; 2] {
    match backwards {
        true => [ends[1], ends[0]],
        false => ends,
    }
}

/// Whether the rules let `from` move onto `to`.
pub(super) fn may_move(mesh: &GroupMesh, from: u16, to: u16) -> bool {
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
