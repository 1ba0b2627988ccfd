//! Lines: outlines of materials, and folds, held against the budget.
//!
//! A place on a line moves along it, and no line may shrink from its end: its points stay with
//! triangles at the line.

use super::super::collapse::{Collapser, Kept};
use super::super::group::GroupMesh;
use super::super::nearest::{middle, to_segment};
use super::super::quadric::{cross, sub};
use super::super::setup::is_fold;
use super::Budget;

/// A line: the outline of a material, by its slot, or one of these.
pub(super) type Kind = u16;
/// Where the surface turns back.
const FOLD: Kind = u16::MAX;
/// No line at all.
pub(super) const PLAIN: Kind = u16::MAX - 1;

/// An edge that lies on a line, and a triangle at it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    ends: [[f32; 3]; 2],
    triangle: u16,
    kind: Kind,
}

impl Line {
    fn squared(&self, at: [f32; 3]) -> f32 {
        to_segment(at, self.ends[0], self.ends[1])
    }

    fn middle(&self) -> [f32; 3] {
        middle(self.ends[0], self.ends[1])
    }
}

/// A triangle at the edge from a place to a neighbour.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spoke {
    other: u16,
    triangle: u16,
    slot: u16,
    normal: [f32; 3],
    /// 1 where the triangle runs along the edge, -1 where it runs against it.
    turn: i32,
}

impl Budget {
    /// A triangle at the nearest of some lines of a kind, if a point lies within the budget of it.
    pub(super) fn at_line(&self, lines: &[Line], at: [f32; 3], kind: Kind) -> Option<u16> {
        let own = lines.iter().filter(|line| line.kind == kind);
        let near = own.map(|line| (line.squared(at), line.triangle));
        let near = near.filter(|&(squared, _)| squared <= self.squared);
        let nearest = near.min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map(|(_, triangle)| triangle)
    }
}

impl<const L: usize> Collapser<L> {
    /// Whether the lines at `from`, outlines and folds, stay within the budget of those at
    /// `to` once `from` has moved there.
    pub(super) fn lines_are_within(
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
        let ends = budget.lines_before[of_from..].iter();
        let ends = ends.map(|line| (at(from), line.kind));
        let middles = budget.lines_before.iter();
        let middles = middles.map(|line| (line.middle(), line.kind));
        for (at, kind) in ends.chain(middles) {
            let Some(triangle) = budget.at_line(&budget.lines, at, kind) else {
                return false;
            };
            budget.fresh.push((at, kind, triangle));
        }
        budget.lines.iter().all(|line| {
            let nearest = budget.at_line(&budget.lines_before, line.middle(), line.kind);
            nearest.is_some()
        })
    }
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
