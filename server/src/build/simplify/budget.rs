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
use super::samples::center;
use super::setup::is_fold;

const NONE: u32 = u32::MAX;
/// The middle of an edge that goes is kept where its squared distance is more than this share of
/// the squared budget.
const KEPT: f32 = 0.1;
/// A point nearer than this share of the squared budget to the triangles that moved is not held
/// against those beside them.
const NEAR: f32 = 0.25;

/// A line: the outline of a material, by its slot, or one of these.
type Kind = u16;
/// Where the surface turns back.
const FOLD: Kind = u16::MAX;
/// No line at all.
const PLAIN: Kind = u16::MAX - 1;

/// An edge that lies on a line, and a triangle at it.
#[derive(Debug, Clone, Copy)]
struct Line {
    ends: [[f32; 3]; 2],
    triangle: u16,
    kind: Kind,
}

impl Line {
    fn squared(&self, at: [f32; 3]) -> f32 {
        to_segment(at, self.ends[0], self.ends[1])
    }

    fn middle(&self) -> Point {
        Point {
            at: middle(self.ends[0], self.ends[1]),
            kind: self.kind,
        }
    }
}

/// A point of the source.
#[derive(Debug, Clone, Copy)]
struct Point {
    at: [f32; 3],
    /// The line that it lies on.
    kind: Kind,
}

/// Points of the source by the triangle that answers for them.
#[derive(Debug, Default)]
pub(super) struct Budget {
    /// Square of the distance allowed, units; infinite where every distance is.
    squared: f32,
    /// First point of each triangle, and the next of each point.
    head: Vec<u32>,
    next: Vec<u32>,
    points: Vec<Point>,
    /// Triangles round the ends of the collapse on trial: their numbers, and their corners by four.
    around: Vec<u16>,
    corners: Vec<[Vec4; 3]>,
    fours: Vec<Four>,
    /// Triangles round the place on trial as they are.
    old: Vec<Four>,
    /// Fours of triangles that move.
    moving: usize,
    /// Neighbours of the place on trial with a triangle between, and the lines there: open edges,
    /// folds, and edges between materials.
    spokes: Vec<Spoke>,
    lines: Vec<Line>,
    /// The lines at both ends as they are.
    lines_before: Vec<Line>,
    /// Points that the trial looked at, and the triangle nearest to each.
    found: Vec<(u32, u16)>,
    /// Points that the collapse adds, and the triangle of each.
    fresh: Vec<(Point, u16)>,
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
            let at = mesh.local(witness.position);
            self.add(Point { at, kind: PLAIN }, witness.triangle as u16);
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

    /// A triangle at the nearest line of a point's kind among some, if the point lies within the
    /// budget of it.
    fn at_line(&self, lines: &[Line], point: Point) -> Option<u16> {
        let own = lines.iter().filter(|line| line.kind == point.kind);
        let near = own.map(|line| (line.squared(point.at), line.triangle));
        let near = near.filter(|&(squared, _)| squared <= self.squared);
        let nearest = near.min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map(|(_, triangle)| triangle)
    }

    fn add(&mut self, point: Point, triangle: u16) {
        self.points.push(point);
        self.next.push(NONE);
        self.link(self.points.len() as u32 - 1, triangle);
    }

    /// Takes up the corners that were collected, by four.
    fn add_fours(&mut self) {
        let (Some(last), Some(&number)) = (self.corners.len().checked_sub(1), self.around.last())
        else {
            return;
        };
        for first in (0..=last).step_by(4) {
            let four = [0, 1, 2, 3].map(|lane| &self.corners[(first + lane).min(last)]);
            self.fours.push(gather(four));
        }
        // Numbers run on in step with the lanes.
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
        ends: [u16; 2],
        kept: &[Kept],
    ) -> bool {
        budget.found.clear();
        budget.fresh.clear();
        self.collect_around(mesh, budget, ends, kept);
        if budget.fours.is_empty() {
            return false;
        }
        let [from, _] = ends;
        let (squared, triangle) = budget.nearest(mesh.positions[from as usize]);
        budget.found.push((NONE, triangle));
        squared <= budget.squared
            && (!self.on_line[from as usize] || self.lines_are_within(mesh, budget, ends, kept))
            && self.dying_are_within(mesh, budget, ends, kept)
            && edges_are_within(mesh, budget, ends, kept)
            && self.points_are_within(budget, ends)
            && self.new_are_within(mesh, budget, ends, kept)
    }

    /// Collects the triangles round both ends as they lie once `from` has moved onto `to`.
    fn collect_around(
        &self,
        mesh: &GroupMesh,
        budget: &mut Budget,
        [from, to]: [u16; 2],
        kept: &[Kept],
    ) {
        let at = |place: u16| Vec3::from(mesh.positions[place as usize]).extend(0.0);
        budget.around.clear();
        budget.corners.clear();
        budget.fours.clear();
        for own in kept {
            let [a, b] = own.others;
            budget.around.push(own.triangle);
            budget.corners.push([at(to), at(a), at(b)]);
        }
        budget.add_fours();
        budget.moving = budget.fours.len();
        for (triangle, [a, b]) in self.beside(to, from) {
            budget.around.push(triangle as u16);
            budget.corners.push([at(to), at(a), at(b)]);
        }
        budget.add_fours();
    }

    /// Triangles round a place, each with the places of its other two corners.
    fn spread(&self, place: u16) -> impl Iterator<Item = (usize, [u16; 2])> + '_ {
        self.star(place).map(|(triangle, k)| {
            let others = [(k + 1) % 3, (k + 2) % 3];
            let vertices = self.corners[triangle];
            (triangle, others.map(|corner| self.place(vertices[corner])))
        })
    }

    /// The same without the triangles that `other` shares.
    fn beside(&self, place: u16, other: u16) -> impl Iterator<Item = (usize, [u16; 2])> + '_ {
        let apart = move |(_, others): &(usize, [u16; 2])| !others.contains(&other);
        self.spread(place).filter(apart)
    }

    /// Whether the triangles that go stay covered: their middles, and places that lose their last
    /// triangle, lie within the budget.
    fn dying_are_within(
        &self,
        mesh: &GroupMesh,
        budget: &mut Budget,
        [from, to]: [u16; 2],
        kept: &[Kept],
    ) -> bool {
        let at = |place: u16| mesh.positions[place as usize];
        // Vertices say nothing of a triangle that nothing is drawn over.
        let uncovered = kept.is_empty() || self.dying(from, to) > 2;
        for (_, others) in self.spread(from) {
            let third = match others {
                [other, third] | [third, other] if other == to => third,
                _ => continue,
            };
            let [a, b, c] = [from, to, third].map(at);
            let center = std::array::from_fn(|axis| (a[axis] + b[axis] + c[axis]) / 3.0);
            let goes =
                |(_, others): (usize, [u16; 2])| others.contains(&from) && others.contains(&to);
            let left_alone = self.spread(third).all(goes).then_some(c);
            let middles = uncovered.then(|| [middle(a, b), middle(b, c), middle(c, a)]);
            let middles = middles.into_iter().flatten();
            for at in left_alone.into_iter().chain(middles).chain([center]) {
                let (squared, triangle) = budget.nearest(at);
                if squared > budget.squared {
                    return false;
                }
                if uncovered || squared > KEPT * budget.squared {
                    budget.fresh.push((Point { at, kind: PLAIN }, triangle));
                }
            }
        }
        true
    }

    /// Whether the points that the triangles round `from` answer for lie within the budget. Points
    /// of lines stay with triangles at lines, so that a line does not shrink from its end.
    fn points_are_within(&self, budget: &mut Budget, [from, to]: [u16; 2]) -> bool {
        let on_line = self.on_line[from as usize];
        for (own, others) in self.spread(from) {
            let goes = others.contains(&to);
            let mut point = budget.head[own];
            while point != NONE {
                let known = budget.points[point as usize];
                let (squared, nearest) = budget.nearest(known.at);
                if squared > budget.squared {
                    return false;
                }
                let triangle = match known.kind {
                    PLAIN => Some(nearest),
                    _ if on_line => budget.at_line(&budget.lines, known),
                    _ if goes => Some(nearest),
                    _ => Some(own as u16),
                };
                let Some(triangle) = triangle else {
                    return false;
                };
                budget.found.push((point, triangle));
                point = budget.next[point as usize];
            }
        }
        true
    }

    /// Whether the triangles that move stay within the budget of the surface as it is: their
    /// middles, and those of their edges.
    fn new_are_within(
        &self,
        mesh: &GroupMesh,
        budget: &mut Budget,
        [from, to]: [u16; 2],
        kept: &[Kept],
    ) -> bool {
        let at = |place: u16| mesh.positions[place as usize];
        let wide = |place: u16| Vec3::from(at(place)).extend(0.0);
        budget.old.clear();
        budget.corners.clear();
        let corners = &mut budget.corners;
        corners.extend(
            self.spread(from)
                .map(|(_, [a, b])| [wide(from), wide(a), wide(b)]),
        );
        let last = corners.len() - 1;
        for first in (0..=last).step_by(4) {
            let four = [0, 1, 2, 3].map(|lane| &corners[(first + lane).min(last)]);
            budget.old.push(gather(four));
        }
        corners.clear();
        let is_near = |at: [f32; 3]| {
            let beside = &budget.fours[budget.moving..];
            let mut all = budget.old.iter().chain(beside);
            all.any(|four| to_triangles(at, four).min_element() <= budget.squared)
        };
        kept.iter().all(|own| {
            let [a, b] = own.others;
            let center = center(&[at(to), at(a), at(b)]);
            is_near(center) && is_near(middle(at(to), at(a))) && is_near(middle(at(to), at(b)))
        })
    }

    /// Triangles that go when one place moves onto another.
    pub(super) fn dying(&self, from: u16, to: u16) -> usize {
        let shared = |(_, others): &(usize, [u16; 2])| others.contains(&to);
        self.spread(from).filter(shared).count()
    }

    /// Whether the lines at a place, which are open edges, folds and edges between materials, stay
    /// within the budget of those at `to` once the place has moved there.
    fn lines_are_within(
        &self,
        mesh: &GroupMesh,
        budget: &mut Budget,
        [from, to]: [u16; 2],
        kept: &[Kept],
    ) -> bool {
        let at = |place: u16| mesh.positions[place as usize];
        let spokes = |end: u16, triangle: usize, others: [u16; 2]| {
            let number = triangle as u16;
            let vertex = self.corners[triangle][0] as usize;
            let slot = mesh.welder.vertices[vertex].1;
            let [a, b, c] = [end, others[0], others[1]].map(at);
            let normal = cross(sub(b, a), sub(c, a));
            [0, 1].map(|side| Spoke {
                other: others[side],
                triangle: number,
                slot,
                normal,
                turn: 1 - 2 * side as i32,
            })
        };
        let moved = kept.iter().map(|own| (own.triangle as usize, own.others));
        let after = moved.chain(self.beside(to, from));
        budget.spokes.clear();
        for (triangle, others) in after {
            budget.spokes.extend(spokes(to, triangle, others));
        }
        let line = |end: u16, spoke: &Spoke, kind: Kind| Line {
            ends: [at(end), at(spoke.other)],
            triangle: spoke.triangle,
            kind,
        };
        let Budget {
            spokes: own,
            lines: found,
            ..
        } = budget;
        found.clear();
        lines(own, |spoke, kind| found.push(line(to, spoke, kind)));
        budget.lines_before.clear();
        let mut of_from = 0;
        for end in [to, from] {
            budget.spokes.clear();
            for (triangle, others) in self.spread(end) {
                budget.spokes.extend(spokes(end, triangle, others));
            }
            let Budget {
                spokes: own,
                lines_before: found,
                ..
            } = budget;
            of_from = found.len();
            lines(own, |spoke, kind| found.push(line(end, spoke, kind)));
        }
        let ends = budget.lines_before[of_from..].iter().map(|line| Point {
            at: at(from),
            kind: line.kind,
        });
        let middles = budget.lines_before.iter().map(Line::middle);
        for point in ends.chain(middles) {
            let Some(triangle) = budget.at_line(&budget.lines, point) else {
                return false;
            };
            budget.fresh.push((point, triangle));
        }
        let mut after = budget.lines.iter().map(Line::middle);
        after.all(|point| budget.at_line(&budget.lines_before, point).is_some())
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
            match point {
                NONE => {
                    let at = mesh.positions[from as usize];
                    budget.add(Point { at, kind: PLAIN }, triangle);
                }
                known => budget.link(known, triangle),
            }
        }
        budget.found = found;
        let fresh = std::mem::take(&mut budget.fresh);
        for &(point, triangle) in &fresh {
            budget.add(point, triangle);
        }
        budget.fresh = fresh;
        self.budget = budget;
    }
}

/// Whether the middles of the edges round `from`, where two surfaces over the same places are
/// farthest apart, lie within the budget.
fn edges_are_within(
    mesh: &GroupMesh,
    budget: &mut Budget,
    [from, to]: [u16; 2],
    kept: &[Kept],
) -> bool {
    // Round a place that no open edge ends at, every neighbour is the first of some triangle, but
    // for one.
    let is_last = |other: &u16| kept.iter().all(|own| own.others[0] != *other);
    let firsts = kept.iter().map(|own| own.others[0]);
    let lasts = kept.iter().map(|own| own.others[1]).filter(is_last);
    for other in firsts.chain(lasts).chain([to]) {
        let at = middle(
            mesh.positions[from as usize],
            mesh.positions[other as usize],
        );
        let (squared, triangle) = budget.nearest(at);
        if squared > budget.squared {
            return false;
        }
        if squared > KEPT * budget.squared {
            budget.fresh.push((Point { at, kind: PLAIN }, triangle));
        }
    }
    true
}

/// A triangle at the edge from a place to a neighbour.
#[derive(Debug, Clone, Copy)]
struct Spoke {
    other: u16,
    triangle: u16,
    slot: u16,
    normal: [f32; 3],
    /// 1 where the triangle runs along the edge, -1 where it runs against it.
    turn: i32,
}

/// The edges that lie on lines. A material ends where its triangles along and against an edge do
/// not balance.
fn lines(spokes: &mut [Spoke], mut each: impl FnMut(&Spoke, Kind)) {
    spokes.sort_unstable_by_key(|spoke| (spoke.other, spoke.slot));
    for edge in spokes.chunk_by(|a, b| a.other == b.other) {
        if edge.len() == 2 && is_fold(edge[0].normal, edge[1].normal) {
            each(&edge[0], FOLD);
        }
        for own in edge.chunk_by(|a, b| a.slot == b.slot) {
            if own.iter().map(|spoke| spoke.turn).sum::<i32>() != 0 {
                each(&own[0], own[0].slot);
            }
        }
    }
}

#[cfg(test)]
mod tests;
