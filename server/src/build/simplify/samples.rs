//! Samples: points of a group's new surface that may lie far from the source.

use super::group::GroupMesh;
use super::nearest::middle;

type Corners = [[f32; 3]; 3];

/// A triangle is looked at closely where a sample has this share of the largest distance.
pub(in super::super) const CLOSE: f32 = 0.75;
/// Parts of a side of such a triangle.
const CUTS: u32 = 5;

/// A point of the new surface.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct Sample {
    pub at: [f32; 3],
    /// Distance that it may have from the source, units.
    pub most: f32,
    /// Number of its triangle.
    pub triangle: u32,
}

/// Points of a new surface, in units from a centre.
#[derive(Debug, Default)]
pub(in super::super) struct Samples {
    pub points: Vec<Sample>,
    /// Triangles that the points lie on.
    pub triangles: Vec<Corners>,
    /// Grid index at the origin.
    pub center: [i32; 3],
    /// Grid steps of a unit.
    pub unit: f32,
}

impl Samples {
    /// No point yet, in the units of `mesh`.
    pub fn new(mesh: &GroupMesh) -> Self {
        Self {
            points: Vec::new(),
            triangles: Vec::new(),
            center: mesh.center,
            unit: mesh.unit,
        }
    }

    /// Middles of all `triangles` and of their edges; each may be as far from the source as `most`.
    pub fn of(mesh: &GroupMesh, triangles: &[[u16; 3]], most: f32) -> Self {
        let mut samples = Self::new(mesh);
        for &triangle in triangles {
            let corners = mesh.places(triangle).map(|place| mesh.positions[place]);
            let [a, b, c] = corners;
            let points = [center(&corners), middle(a, b), middle(b, c), middle(c, a)];
            samples.add(corners, &points.map(|at| (at, most)));
        }
        samples
    }

    /// Adds points of a triangle with the distance that each may have from the source.
    pub fn add(&mut self, corners: Corners, points: &[([f32; 3], f32)]) {
        let triangle = self.triangles.len() as u32;
        self.triangles.push(corners);
        self.points.extend(
            points
                .iter()
                .map(|&(at, most)| Sample { at, most, triangle }),
        );
    }

    /// Grid indices to units.
    pub fn local(&self, position: [i32; 3]) -> [f32; 3] {
        let scale = 1.0 / self.unit;
        std::array::from_fn(|axis| (position[axis] - self.center[axis]) as f32 * scale)
    }
}

pub(super) fn center([a, b, c]: &Corners) -> [f32; 3] {
    std::array::from_fn(|axis| (a[axis] + b[axis] + c[axis]) / 3.0)
}

/// Points of a triangle that cut its sides in `CUTS` parts.
pub(in super::super) fn closely(corners: Corners) -> impl Iterator<Item = [f32; 3]> {
    let rows = (0..=CUTS).flat_map(|a| (0..=CUTS - a).map(move |b| [a, b, CUTS - a - b]));
    rows.map(move |parts| {
        std::array::from_fn(|axis| {
            let part = |corner: usize| parts[corner] as f32 / CUTS as f32 * corners[corner][axis];
            part(0) + part(1) + part(2)
        })
    })
}
