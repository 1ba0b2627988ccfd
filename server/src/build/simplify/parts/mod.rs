//! Parts: connected triangles of a group, with their area and extent. Small loose parts become
//! fewer and larger (`thin`): leaves of a crown, twigs, blades, cards, screws.

mod fit;
mod near;
mod regrow;
mod thin;

#[cfg(test)]
mod tests;

use glam::{DMat3, DVec3};

use super::super::borders::LOCKED;
use super::group::GroupMesh;
pub(super) use thin::{Limits, Thinner};

/// A part of more triangles is a surface of its own.
const MOST_TRIANGLES: usize = 128;
/// Half of the directions in which the outermost points of a part are kept: sides and corners of
/// a cube.
const DIRECTIONS: [DVec3; 7] = [
    DVec3::X,
    DVec3::Y,
    DVec3::Z,
    DVec3::new(1.0, 1.0, 1.0),
    DVec3::new(1.0, 1.0, -1.0),
    DVec3::new(1.0, -1.0, 1.0),
    DVec3::new(-1.0, 1.0, 1.0),
];

type Corners = [DVec3; 3];

/// A small part without a locked place, of one material.
#[derive(Debug, Clone)]
struct Part {
    /// Its triangles, ascending.
    triangles: Vec<u16>,
    slot: u16,
    /// Area that it stands for, square units.
    area: f64,
    /// Mean of its surface, units.
    center: DVec3,
    /// Covariance of its surface, square units.
    spread: DMat3,
    /// Points of the source that it stands for. The distance to a convex shape is largest at a
    /// point that is outermost in some direction, so those suffice.
    points: Vec<DVec3>,
    /// Farthest of `points` from the centre.
    radius: f64,
    /// The surface that it stands for, as the group had it.
    surface: Vec<Corners>,
    /// Whether `points` were handed on, not taken from the surface.
    told: bool,
}

/// Root of each place's part.
#[derive(Debug, Default)]
struct Roots(Vec<u16>);

impl Roots {
    fn find(&self, mut place: u16) -> u16 {
        while self.0[place as usize] != place {
            place = self.0[place as usize];
        }
        place
    }

    /// Joins the places of each triangle; a root is the smallest place of its part.
    fn join(&mut self, mesh: &GroupMesh) {
        self.0.clear();
        self.0.extend(0..mesh.positions.len() as u16);
        for &triangle in &mesh.triangles {
            let roots = mesh.places(triangle).map(|place| self.find(place as u16));
            let least = roots[0].min(roots[1]).min(roots[2]);
            for root in roots {
                self.0[root as usize] = least;
            }
        }
        for place in 0..self.0.len() {
            // Every place before is a root or names one.
            self.0[place] = self.0[self.0[place] as usize];
        }
    }
}

/// The small parts of a group that nothing holds, by their first triangles.
fn find(mesh: &GroupMesh, roots: &mut Roots) -> Vec<Part> {
    roots.join(mesh);
    let vertex = |triangle: u16| mesh.triangles[triangle as usize][0] as usize;
    let root = |triangle: u16| roots.0[mesh.welder.place_of[vertex(triangle)] as usize] as usize;
    let slot = |triangle: u16| mesh.welder.vertices[vertex(triangle)].1;
    let all = 0..mesh.triangles.len() as u16;
    let mut sizes = vec![0u32; mesh.positions.len()];
    all.clone().for_each(|own| sizes[root(own)] += 1);
    for (place, &rule) in mesh.rules.iter().enumerate() {
        if rule == LOCKED {
            sizes[roots.0[place] as usize] = u32::MAX;
        }
    }
    const NONE: u32 = u32::MAX;
    let mut numbers = vec![NONE; mesh.positions.len()];
    let mut parts: Vec<Part> = Vec::new();
    for own in all {
        let root = root(own);
        if sizes[root] as usize > MOST_TRIANGLES {
            continue;
        }
        if numbers[root] == NONE {
            numbers[root] = parts.len() as u32;
            parts.push(Part::new(slot(own), sizes[root] as usize));
        }
        parts[numbers[root] as usize].triangles.push(own);
    }
    for witness in &mesh.witnesses {
        let number = numbers[root(witness.triangle as u16)];
        if let Some(part) = parts.get_mut(number as usize) {
            part.points.push(at(mesh.local(witness.position)));
        }
    }
    parts.iter_mut().for_each(|part| part.weigh(mesh));
    let of_one_material = |part: &Part| part.triangles.iter().all(|&own| slot(own) == part.slot);
    parts.retain(|part| part.area > 0.0 && of_one_material(part));
    parts
}

impl Part {
    fn new(slot: u16, size: usize) -> Self {
        Self {
            triangles: Vec::with_capacity(size),
            slot,
            area: 0.0,
            center: DVec3::ZERO,
            spread: DMat3::ZERO,
            points: Vec::new(),
            radius: 0.0,
            surface: Vec::new(),
            told: true,
        }
    }

    /// Takes up its surface, sums it up, and takes its points from it where it has none.
    fn weigh(&mut self, mesh: &GroupMesh) {
        let own = self
            .triangles
            .iter()
            .map(|&own| mesh.triangles[own as usize]);
        self.surface = own.map(|own| corners(mesh, own)).collect();
        (self.area, self.center) = sums(&self.surface);
        if self.area <= 0.0 {
            return;
        }
        let mut moments = DMat3::ZERO;
        for own in &self.surface {
            let [a, b, c] = own.map(|corner| corner - self.center);
            let area = 0.5 * (b - a).cross(c - a).length();
            let middle = (a + b + c) / 3.0;
            // Of a triangle about its mean: a twelfth of the corners' squares.
            let own = [a, b, c].map(|corner| square(corner - middle));
            moments += ((own[0] + own[1] + own[2]) * (1.0 / 12.0) + square(middle)) * area;
        }
        self.spread = moments * (1.0 / self.area);
        // More points than triangles: the outermost ones, handed on. Other surfaces hand on one a
        // triangle at most, beside which their corners count.
        if self.points.len() <= self.triangles.len() {
            self.told = false;
            for corner in self.surface.as_flattened() {
                if !self.points.contains(corner) {
                    self.points.push(*corner);
                }
            }
        }
        self.reach();
    }

    /// Finds how far its points reach.
    fn reach(&mut self) {
        let away = self.points.iter().map(|point| point.distance(self.center));
        self.radius = away.fold(0.0, f64::max);
    }

    /// Takes over what another part stands for.
    fn take(&mut self, other: Self) {
        self.area += other.area;
        self.surface.extend(other.surface);
        self.points.extend(other.points);
        self.points = outermost(&self.points);
        self.told &= other.told;
        self.reach();
    }
}

fn at(position: [f32; 3]) -> DVec3 {
    DVec3::from(position.map(f64::from))
}

/// Corners of a triangle.
fn corners(mesh: &GroupMesh, triangle: [u16; 3]) -> Corners {
    mesh.places(triangle).map(|place| at(mesh.positions[place]))
}

/// Product of a vector with itself, a matrix.
fn square(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Area of some triangles and the mean of their surface.
fn sums(triangles: &[Corners]) -> (f64, DVec3) {
    let (mut all, mut sum) = (0.0, DVec3::ZERO);
    for &[a, b, c] in triangles {
        let area = 0.5 * (b - a).cross(c - a).length();
        all += area;
        sum += (a + b + c) * (area / 3.0);
    }
    (all, if all > 0.0 { sum / all } else { sum })
}

/// The outermost of some points, in the order of their directions.
fn outermost(points: &[DVec3]) -> Vec<DVec3> {
    let mut kept: Vec<DVec3> = Vec::with_capacity(2 * DIRECTIONS.len());
    for direction in DIRECTIONS {
        let along = |point: &DVec3| point.dot(direction);
        let by = |a: &&DVec3, b: &&DVec3| along(a).total_cmp(&along(b));
        for point in [points.iter().min_by(by), points.iter().max_by(by)] {
            if let Some(point) = point.filter(|point| !kept.contains(point)) {
                kept.push(*point);
            }
        }
    }
    kept
}
