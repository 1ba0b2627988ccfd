//! Budget: how far the source may lie from the surface after a collapse.
//!
//! Every triangle answers for some points of the source: places that collapsed, and the witnesses
//! of finer levels. A collapse is tried against the points of the triangles round it and refused
//! where one of them would lie farther off than the budget (Kobbelt et al., "A general framework
//! for mesh decimation", 1998: a one-sided Hausdorff distance). A place that costs much waits for
//! a later round, whose budget is larger, while all else goes on.

mod lines;
mod points;

use glam::{Vec3, Vec4};

use super::collapse::{Collapser, Kept};
use super::group::GroupMesh;
use super::nearest::{Four, gather, middle, nearer, to_triangles};
use super::pairs::Pairs;
use super::quadric::sub;
use super::samples::center;
use lines::{Kind, Line, PLAIN, Spoke};
pub(super) use points::{Answered, Source};
use points::{BETWEEN, NONE, Points};

/// The middle of an edge that goes is kept where its squared distance is more than this share of
/// the squared budget.
const KEPT: f32 = 0.1;
/// A point nearer than this share of the squared budget to the triangles that moved is not held
/// against those beside them.
const NEAR: f32 = 0.25;

/// A collapse is not tried whose mean squared distance to the planes round it is more than this
/// many squared budgets: of 10,000 such ones, about three would stay within.
const DEAR: f32 = 3.0;
/// The same on a line, whose own planes add to the distance and not to the weight.
const DEAR_ON_LINE: f32 = 15.0;

/// The triangle nearest to a place that goes, and its squared distance.
#[derive(Debug, Clone, Copy, Default)]
struct Under {
    squared: f32,
    triangle: u16,
    /// Places of its corners that were neighbours.
    corners: [u16; 3],
}

impl Under {
    /// Bound of the squared distance of the mean of the place and corners, `count` points in all,
    /// where `other` is one of its corners: these move nowhere, so the mean moves by so much less.
    fn shared(&self, other: u16, count: f32) -> Option<(f32, u16)> {
        let bound = self.squared / (count * count);
        self.corners
            .contains(&other)
            .then_some((bound, self.triangle))
    }
}

/// The distance allowed, and what a trial works with.
#[derive(Debug, Default)]
pub(super) struct Budget {
    /// Square of the distance allowed, units; infinite where every distance is.
    squared: f32,
    pub points: Points,
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
    /// The triangle nearest to the place on trial.
    under: Under,
    /// Points that the trial looked at, and the triangle nearest to each.
    found: Vec<(u32, u16)>,
    /// Points that the collapse adds, each with its line and its triangle.
    fresh: Vec<([f32; 3], Kind, u16)>,
}

impl Budget {
    /// Takes up a group's witnesses. `distance` is in units.
    pub fn start(&mut self, mesh: &GroupMesh, distance: f32) {
        self.squared = distance * distance;
        if self.is_limited() {
            self.points.start(mesh);
        } else {
            self.points.clear();
        }
    }

    /// Whether some distance is too large.
    pub fn is_limited(&self) -> bool {
        self.squared < f32::INFINITY
    }

    /// Whether a weighted sum of squared errors is more than the budget allows.
    pub fn is_exceeded(&self, sum: f32, weight: f32) -> bool {
        self.is_limited() && sum > self.squared * weight
    }

    /// Squared distance of a point to the triangles on trial and the number of the nearest.
    fn nearest(&self, at: [f32; 3]) -> (f32, u16) {
        let mut best = (f32::INFINITY, 0);
        for (number, four) in self.fours.iter().enumerate() {
            if number == self.moving && best.0 <= NEAR * self.squared {
                break;
            }
            if let Some((squared, lane)) = nearer(to_triangles(at, four), best.0) {
                best = (squared, 4 * number + lane);
            }
        }
        (best.0, self.around[best.1])
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
        let within = self.attributes_are_within(mesh, budget.squared, [from, to], pairs)
            && self.distance_is_within(mesh, &mut budget, [from, to], kept);
        self.budget = budget;
        within
    }

    /// Whether a collapse need not be tried: `far` is its weighted sum of squared distances to the
    /// planes round it.
    #[inline]
    pub(super) fn is_dear(&self, far: f32, from: u16, to: u16) -> bool {
        let weight = [from, to].map(|place| self.quadrics[place as usize].weight);
        let share = if self.on_line[from as usize] {
            DEAR_ON_LINE
        } else {
            DEAR
        };
        self.budget
            .is_exceeded(far, share * (weight[0] + weight[1]))
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
        let [from, to] = ends;
        let (squared, triangle) = budget.nearest(mesh.positions[from as usize]);
        budget.found.push((NONE, triangle));
        let moved = kept.iter().find(|own| own.triangle == triangle);
        let [a, b] = moved.map_or([to; 2], |own| own.others);
        budget.under = Under {
            squared,
            triangle,
            corners: [to, a, b],
        };
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
            let others = left_alone.into_iter().chain(middles);
            let others = others.map(|at| (at, None));
            let covered = budget.under.shared(third, 3.0);
            for (at, known) in others.chain([(center, covered)]) {
                let (squared, triangle) = known.unwrap_or_else(|| budget.nearest(at));
                if squared > budget.squared {
                    return false;
                }
                if uncovered || squared > KEPT * budget.squared {
                    budget.fresh.push((at, PLAIN, triangle));
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
            for (number, &known) in budget.points.of(own) {
                let (squared, nearest) = budget.nearest(known.at);
                if squared > budget.squared {
                    return false;
                }
                let triangle = match known.kind {
                    PLAIN => Some(nearest),
                    _ if on_line => budget.at_line(&budget.lines, known.at, known.kind),
                    _ if goes => Some(nearest),
                    _ => Some(own as u16),
                };
                let Some(triangle) = triangle else {
                    return false;
                };
                budget.found.push((number, triangle));
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
            budget.points.release(triangle);
        }
        let found = std::mem::take(&mut budget.found);
        for &(point, triangle) in &found {
            match point {
                NONE => {
                    let at = mesh.positions[from as usize];
                    budget.points.add(at, PLAIN, from, triangle);
                }
                known => budget.points.link(known, triangle),
            }
        }
        budget.found = found;
        let fresh = std::mem::take(&mut budget.fresh);
        for &(at, kind, triangle) in &fresh {
            budget.points.add(at, kind, BETWEEN, triangle);
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
        let known = budget.under.shared(other, 2.0);
        let (squared, triangle) = known.unwrap_or_else(|| budget.nearest(at));
        if squared > budget.squared {
            return false;
        }
        if squared > KEPT * budget.squared {
            budget.fresh.push((at, PLAIN, triangle));
        }
    }
    true
}

#[cfg(test)]
mod tests;
