//! Budget: how far the source may lie from the surface after a collapse.
//!
//! Every triangle answers for some points of the source: places that collapsed, and the witnesses
//! of finer levels. A collapse is tried against the points of the triangles round it and refused
//! where one of them would lie farther off than the budget (Kobbelt et al., "A general framework
//! for mesh decimation", 1998: a one-sided Hausdorff distance). A place that costs much waits for
//! a later round, whose budget is larger, while all else goes on.

use glam::{Vec3, Vec4};

use super::collapse::{Collapser, Kept};
use super::group::GroupMesh;
use super::nearest::{Four, gather, middle, to_segment, to_triangles};
use super::pairs::Pairs;
use super::quadric::{cross, sub};
use super::setup::is_fold;

const NONE: u32 = u32::MAX;
/// The middle of an edge that goes is kept where its squared distance is more than this share of
/// the squared budget.
const KEPT: f32 = 0.1;
/// A point nearer than this share of the squared budget to the triangles that moved is not held
/// against those beside them.
const NEAR: f32 = 0.25;

/// Points of the source by the triangle that answers for them.
#[derive(Debug, Default)]
pub(super) struct Budget {
    /// Square of the distance allowed, units; infinite where every distance is.
    squared: f32,
    /// First point of each triangle, and the next of each point.
    head: Vec<u32>,
    next: Vec<u32>,
    /// Each with whether it lay on a line.
    points: Vec<([f32; 3], bool)>,
    /// Triangles round the ends of the collapse on trial: their numbers, and their corners by four.
    around: Vec<u16>,
    corners: Vec<[Vec4; 3]>,
    fours: Vec<Four>,
    /// Fours of triangles that move.
    moving: usize,
    /// Neighbours of the place on trial with the material of the triangle between, and the lines
    /// there: open edges, and edges between materials.
    spokes: Vec<Spoke>,
    lines: Vec<[[f32; 3]; 2]>,
    /// Points that the trial looked at, and the triangle nearest to each.
    found: Vec<(u32, u16)>,
    /// Points that the collapse adds.
    fresh: Vec<([f32; 3], u16)>,
}

impl Budget {
    /// Takes up a group's witnesses. `distance` is in units.
    pub fn start(&mut self, mesh: &GroupMesh, distance: f32) {
        self.squared = distance * distance;
        self.head.clear();
        self.next.clear();
        self.points.clear();
        if !self.is_limited() {
            return;
        }
        self.head.resize(mesh.triangles.len(), NONE);
        for witness in &mesh.witnesses {
            let point = self.points.len() as u32;
            self.points.push((mesh.local(witness.position), false));
            self.next.push(NONE);
            self.link(point, witness.triangle as u16);
        }
    }

    /// Whether some distance is too large.
    pub fn is_limited(&self) -> bool {
        self.squared < f32::INFINITY
    }

    fn link(&mut self, point: u32, triangle: u16) {
        let head = &mut self.head[triangle as usize];
        self.next[point as usize] = *head;
        *head = point;
    }

    /// Squared distance of a point to the triangles on trial and the number of the nearest.
    fn nearest(&self, at: [f32; 3]) -> (f32, u16) {
        let mut best = (f32::INFINITY, 0);
        for (number, four) in self.fours.iter().enumerate() {
            if number == self.moving && best.0 <= NEAR * self.squared {
                break;
            }
            let squared = to_triangles(at, four).to_array();
            for (lane, squared) in squared.into_iter().enumerate() {
                if squared < best.0 {
                    best = (squared, 4 * number + lane);
                }
            }
        }
        (best.0, self.around[best.1])
    }

    fn is_near_line(&self, at: [f32; 3]) -> bool {
        let is_near = |&[a, b]: &[[f32; 3]; 2]| to_segment(at, a, b) <= self.squared;
        self.lines.iter().any(is_near)
    }

    fn add_fours(&mut self) {
        let last = self.corners.len() - 1;
        for first in (0..=last).step_by(4) {
            let four = [0, 1, 2, 3].map(|lane| &self.corners[(first + lane).min(last)]);
            self.fours.push(gather(four));
        }
        // Numbers run on in step with the lanes.
        let number = self.around[self.around.len() - 1];
        self.around.resize(4 * self.fours.len(), number);
        self.corners.clear();
    }
}

impl<const L: usize> Collapser<L> {
    /// Whether the points round `from` lie within the budget once `from` has moved onto `to`, and
    /// remembers the triangle nearest to each.
    pub(super) fn is_within_budget(
        &mut self,
        mesh: &GroupMesh,
        [from, to]: [u16; 2],
        pairs: &Pairs,
        kept: &[Kept],
    ) -> bool {
        if !self.budget.is_limited() {
            return true;
        }
        let mut budget = std::mem::take(&mut self.budget);
        let within = self.distance_is_within(mesh, &mut budget, [from, to], kept)
            && self.attributes_are_within(mesh, budget.squared, [from, to], pairs);
        self.budget = budget;
        within
    }

    fn distance_is_within(
        &self,
        mesh: &GroupMesh,
        budget: &mut Budget,
        [from, to]: [u16; 2],
        kept: &[Kept],
    ) -> bool {
        let at = |place: u16| Vec3::from(mesh.positions[place as usize]).extend(0.0);
        let own = mesh.positions[from as usize];
        budget.around.clear();
        budget.corners.clear();
        budget.fours.clear();
        for own in kept {
            budget.around.push(own.triangle);
            budget
                .corners
                .push([at(to), at(own.others[0]), at(own.others[1])]);
        }
        if !budget.corners.is_empty() {
            budget.add_fours();
        }
        budget.moving = budget.fours.len();
        for (triangle, _) in self.star(to) {
            let places = self.corners[triangle].map(|vertex| self.place(vertex));
            if !places.contains(&from) {
                budget.around.push(triangle as u16);
                budget.corners.push(places.map(at));
            }
        }
        if !budget.corners.is_empty() {
            budget.add_fours();
        }
        if budget.fours.is_empty() {
            return false;
        }
        budget.found.clear();
        budget.fresh.clear();
        let (squared, triangle) = budget.nearest(own);
        if squared > budget.squared {
            return false;
        }
        let on_line = self.on_line[from as usize];
        if on_line && !self.lines_are_within(mesh, budget, [from, to], kept) {
            return false;
        }
        budget.found.push((NONE, triangle));
        let uncovered = kept.is_empty() || self.dying(from, to) > 2;
        for (triangle, k) in self.star(from) {
            let places = self.corners[triangle].map(|vertex| self.place(vertex));
            let others = [places[(k + 1) % 3], places[(k + 2) % 3]];
            if !others.contains(&to) {
                continue;
            }
            let third = if others[0] == to {
                others[1]
            } else {
                others[0]
            };
            let goes = |(triangle, _): (usize, usize)| {
                let places = self.corners[triangle].map(|vertex| self.place(vertex));
                places.contains(&from) && places.contains(&to)
            };
            let [a, b, c] = places.map(|place| mesh.positions[place as usize]);
            // A place that loses its last triangle is a point of the source too, and a triangle
            // that nothing is drawn over leaves its middle.
            let third = self
                .star(third)
                .all(goes)
                .then(|| mesh.positions[third as usize]);
            let center = std::array::from_fn(|axis| (a[axis] + b[axis] + c[axis]) / 3.0);
            let middles = uncovered.then(|| [middle(a, b), middle(b, c), middle(c, a)]);
            let middles = middles.into_iter().flatten();
            for at in third.into_iter().chain(middles).chain([center]) {
                let (squared, triangle) = budget.nearest(at);
                if squared > budget.squared {
                    return false;
                }
                if uncovered || squared > KEPT * budget.squared {
                    budget.fresh.push((at, triangle));
                }
            }
        }
        // Two surfaces over the same places are farthest apart where their edges cross.
        let last = |other: u16| kept.iter().all(|own| own.others[0] != other);
        let last = kept
            .iter()
            .map(|own| own.others[1])
            .filter(|&other| last(other));
        let others = kept.iter().map(|own| own.others[0]).chain(last);
        for other in others.chain([to]) {
            let at = middle(own, mesh.positions[other as usize]);
            let (squared, triangle) = budget.nearest(at);
            if squared > budget.squared {
                return false;
            }
            if squared > KEPT * budget.squared {
                budget.fresh.push((at, triangle));
            }
        }
        for (triangle, _) in self.star(from) {
            let mut point = budget.head[triangle];
            while point != NONE {
                let (at, is_of_line) = budget.points[point as usize];
                let (squared, triangle) = budget.nearest(at);
                if squared > budget.squared || (on_line && is_of_line && !budget.is_near_line(at)) {
                    return false;
                }
                budget.found.push((point, triangle));
                point = budget.next[point as usize];
            }
        }
        true
    }

    /// Triangles that go when one place moves onto another.
    pub(super) fn dying(&self, from: u16, to: u16) -> usize {
        let shared = |&(triangle, _): &(usize, usize)| {
            let mut places = self.corners[triangle]
                .iter()
                .map(|&vertex| self.place(vertex));
            places.any(|place| place == to)
        };
        self.star(from).filter(shared).count()
    }

    /// Whether the lines at a place, which are open edges and edges between materials, stay within
    /// the budget of those at `to` once the place has moved there.
    fn lines_are_within(
        &self,
        mesh: &GroupMesh,
        budget: &mut Budget,
        [from, to]: [u16; 2],
        kept: &[Kept],
    ) -> bool {
        let slot = |triangle: usize| {
            let vertex = self.corners[triangle][0] as usize;
            mesh.welder.vertices[vertex].1
        };
        let at = |place: u16| mesh.positions[place as usize];
        let normal = |places: [u16; 3]| {
            let [a, b, c] = places.map(|place| mesh.positions[place as usize]);
            cross(sub(b, a), sub(c, a))
        };
        budget.spokes.clear();
        for own in kept {
            let slot = slot(own.triangle as usize);
            let normal = normal([to, own.others[0], own.others[1]]);
            budget
                .spokes
                .extend(own.others.map(|other| (other, slot, normal)));
        }
        for (triangle, k) in self.star(to) {
            let places = self.corners[triangle].map(|vertex| self.place(vertex));
            if !places.contains(&from) {
                let others = [places[(k + 1) % 3], places[(k + 2) % 3]];
                let (slot, normal) = (slot(triangle), normal([to, others[0], others[1]]));
                budget
                    .spokes
                    .extend(others.map(|other| (other, slot, normal)));
            }
        }
        budget.lines.clear();
        lines(&mut budget.spokes, |other| {
            budget.lines.push([at(to), at(other)])
        });
        if !budget.is_near_line(at(from)) {
            return false;
        }
        let mut within = true;
        for end in [from, to] {
            budget.spokes.clear();
            for (triangle, k) in self.star(end) {
                let places = self.corners[triangle].map(|vertex| self.place(vertex));
                let others = [places[(k + 1) % 3], places[(k + 2) % 3]];
                let (slot, normal) = (slot(triangle), normal([end, others[0], others[1]]));
                budget
                    .spokes
                    .extend(others.map(|other| (other, slot, normal)));
            }
            let mut spokes = std::mem::take(&mut budget.spokes);
            lines(&mut spokes, |other| {
                within = within && budget.is_near_line(middle(at(end), at(other)));
            });
            budget.spokes = spokes;
        }
        within
    }

    /// Whether the attributes' error is within the budget.
    fn attributes_are_within(
        &self,
        mesh: &GroupMesh,
        squared: f32,
        [from, to]: [u16; 2],
        (pairs, count): &Pairs,
    ) -> bool {
        if L == 0 {
            return true;
        }
        let offset = sub(mesh.positions[to as usize], mesh.positions[from as usize]);
        let is_within = |&[own, target]: &[u16; 2]| {
            let weights = [own, target].map(|v| self.attribute_quadrics[v as usize].base.weight);
            let weight = weights[0] + weights[1];
            self.attribute_cost(offset, own, target) <= squared * weight
        };
        pairs[..*count].iter().all(is_within)
    }

    /// Hands the points round `from` to the triangles that the trial found nearest.
    pub(super) fn hand_points(&mut self, mesh: &GroupMesh, from: u16) {
        if !self.budget.is_limited() {
            return;
        }
        let mut budget = std::mem::take(&mut self.budget);
        for (triangle, _) in self.star(from) {
            budget.head[triangle] = NONE;
        }
        let found = std::mem::take(&mut budget.found);
        for &(point, triangle) in &found {
            let point = match point {
                NONE => {
                    let on_line = self.on_line[from as usize];
                    budget.points.push((mesh.positions[from as usize], on_line));
                    budget.next.push(NONE);
                    budget.points.len() as u32 - 1
                }
                known => known,
            };
            budget.link(point, triangle);
        }
        budget.found = found;
        let fresh = std::mem::take(&mut budget.fresh);
        for &(at, triangle) in &fresh {
            budget.points.push((at, false));
            budget.next.push(NONE);
            budget.link(budget.points.len() as u32 - 1, triangle);
        }
        budget.fresh = fresh;
        self.budget = budget;
    }
}

/// The neighbours to which a line leads: one triangle lies between, two of different materials, or
/// two between which the surface turns back.
fn lines(spokes: &mut [Spoke], mut each: impl FnMut(u16)) {
    spokes.sort_unstable_by_key(|&(other, slot, _)| (other, slot));
    for spoke in spokes.chunk_by(|a, b| a.0 == b.0) {
        let folded = spoke.len() == 2 && is_fold(spoke[0].2, spoke[1].2);
        if spoke.len() == 1 || folded || spoke[0].1 != spoke[spoke.len() - 1].1 {
            each(spoke[0].0);
        }
    }
}

/// A neighbour, with the material and the normal of a triangle between.
type Spoke = (u16, u16, [f32; 3]);

#[cfg(test)]
mod tests {
    use super::super::super::borders::{FREE, LOCKED};
    use super::super::super::steps::{PositionStep, Wanted};
    use super::super::super::vertex::{Grids, Vertex};
    use super::super::super::{grids, survey};
    use super::super::group::Weights;
    use super::*;
    use crate::build::TriangleTree;
    use crate::import::Mesh;

    const SIDE: i32 = 24;

    /// Squares of 64 steps under two waves of other lengths; the rim stays.
    fn waves() -> GroupMesh {
        let mut mesh = GroupMesh::default();
        mesh.welder.clear(((SIDE + 1) * (SIDE + 1)) as usize);
        for y in 0..=SIDE {
            for x in 0..=SIDE {
                let wave = |k: f64| (k * x as f64).sin() * (0.7 * k * y as f64).cos();
                let height = 90.0 * wave(0.3) + 25.0 * wave(1.7);
                let vertex = Vertex {
                    position: [64 * x, 64 * y, height as i32],
                    ..Vertex::default()
                };
                mesh.welder.number(&vertex, 0);
                let rim = [x, y].iter().any(|&at| at == 0 || at == SIDE);
                mesh.rules.push(if rim { LOCKED } else { FREE });
            }
        }
        for y in 0..SIDE {
            for x in 0..SIDE {
                let a = (y * (SIDE + 1) + x) as u16;
                let [b, c, d] = [a + 1, a + SIDE as u16 + 2, a + SIDE as u16 + 1];
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        mesh.first_triangles.push(0);
        mesh.place_positions();
        mesh
    }

    fn some_grids() -> Grids {
        let mesh = Mesh {
            name: "triangle".into(),
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            triangle_materials: vec![0],
            triangles: vec![[0, 1, 2]],
            material_slots: vec![0],
            ..Mesh::default()
        };
        let wanted = Wanted {
            step: PositionStep::default(),
            shared_exponent: None,
        };
        let survey = survey::survey(&mesh).expect("a survey");
        grids("triangle", &survey, wanted, &mut Vec::new()).expect("grids")
    }

    /// Triangles left and the farthest place of the source, units, when all goes that may.
    fn run(distance: f32) -> (usize, f64) {
        let mesh = waves();
        let mut state = Collapser::<0>::default();
        let weights = Weights {
            normal: 0.0,
            uv: 0.0,
            color: 0.0,
        };
        state.start(&mesh, &some_grids(), &weights);
        state.budget.start(&mesh, distance);
        state.run(&mesh, 200, true);
        let left: Vec<[u32; 3]> = (0..mesh.triangles.len())
            .filter(|&triangle| state.alive[triangle])
            .map(|triangle| {
                mesh.places(state.corners[triangle])
                    .map(|place| place as u32)
            })
            .collect();
        let tree = TriangleTree::new(&mesh.positions, &left);
        let away = mesh.positions.iter().map(|at| {
            let squared = tree.distance_squared(at.map(f64::from), -1.0);
            squared.sqrt()
        });
        (left.len(), away.fold(0.0, f64::max))
    }

    #[test]
    fn no_place_goes_farther_than_the_budget() {
        let (free, farthest) = run(f32::INFINITY);
        assert!(free <= 200 && farthest > 0.01, "{free} {farthest}");
        let mut before = usize::MAX;
        for budget in [0.004, 0.006, 0.009, 0.014] {
            let (left, farthest) = run(budget);
            assert!(
                farthest <= 1.0001 * budget as f64 && farthest > 0.5 * budget as f64,
                "{farthest} for {budget}"
            );
            assert!(left < before, "{left} after {before}");
            before = left;
        }
        assert!(before >= free);
    }
}
