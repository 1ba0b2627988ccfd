//! Points: places and witnesses of the source, and what lies between, by the triangle that answers
//! for them.

use super::super::group::GroupMesh;
use super::lines::{Kind, PLAIN};

/// No point.
pub(super) const NONE: u32 = u32::MAX;
/// The place of a point that is none.
pub(super) const BETWEEN: u16 = u16::MAX;

/// A point of the source.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct Point {
    pub at: [f32; 3],
    /// The line that it lies on.
    pub(super) kind: Kind,
    /// The place that it was, or [`BETWEEN`].
    place: u16,
}

/// A place or a witness that a triangle answers for.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct Answered {
    pub at: [f32; 3],
    pub triangle: usize,
    pub source: Source,
}

/// Where a point comes from.
#[derive(Debug, Clone, Copy)]
pub(in super::super) enum Source {
    Place(u16),
    /// Number of a witness of the group.
    Witness(u32),
}

/// All points of a group.
#[derive(Debug, Default)]
pub(in super::super) struct Points {
    /// First point of each triangle, and the next of each point.
    head: Vec<u32>,
    next: Vec<u32>,
    /// The first ones are the group's witnesses.
    all: Vec<Point>,
    witnesses: u32,
    /// The triangle that answers for each.
    triangles: Vec<u16>,
}

impl Points {
    pub fn clear(&mut self) {
        self.head.clear();
        self.next.clear();
        self.all.clear();
        self.triangles.clear();
    }

    /// Takes up a group's witnesses.
    pub fn start(&mut self, mesh: &GroupMesh) {
        self.clear();
        self.head.resize(mesh.triangles.len(), NONE);
        self.witnesses = mesh.witnesses.len() as u32;
        for witness in &mesh.witnesses {
            let at = mesh.local(witness.position);
            self.add(at, PLAIN, BETWEEN, witness.triangle as u16);
        }
    }

    /// Adds a point that a triangle answers for.
    pub(super) fn add(&mut self, at: [f32; 3], kind: Kind, place: u16, triangle: u16) {
        self.all.push(Point { at, kind, place });
        self.next.push(NONE);
        self.triangles.push(triangle);
        self.link(self.all.len() as u32 - 1, triangle);
    }

    /// Makes a triangle answer for a point that no other answers for.
    pub fn link(&mut self, point: u32, triangle: u16) {
        self.triangles[point as usize] = triangle;
        let head = &mut self.head[triangle as usize];
        self.next[point as usize] = *head;
        *head = point;
    }

    /// Makes a triangle answer for nothing.
    pub fn release(&mut self, triangle: usize) {
        self.head[triangle] = NONE;
    }

    /// Points that a triangle answers for, by number.
    pub fn of(&self, triangle: usize) -> impl Iterator<Item = (u32, &Point)> {
        let mut next = self.head[triangle];
        std::iter::from_fn(move || {
            let number = (next != NONE).then_some(next)?;
            next = self.next[number as usize];
            Some((number, &self.all[number as usize]))
        })
    }

    /// Places that went and witnesses, each with the triangle that answers for it, which was the
    /// nearest of those round it.
    pub fn answered(&self) -> impl Iterator<Item = Answered> + '_ {
        let all = (0..).zip(self.all.iter().zip(&self.triangles));
        all.filter_map(|(number, (&Point { at, place, .. }, &triangle))| {
            let source = match place {
                BETWEEN if number >= self.witnesses => return None,
                BETWEEN => Source::Witness(number),
                place => Source::Place(place),
            };
            let triangle = triangle as usize;
            Some(Answered {
                at,
                triangle,
                source,
            })
        })
    }
}
