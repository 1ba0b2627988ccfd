//! Solids whose sides are no multiples of any grid step: what rounding does to them must be stated.

use std::f64::consts::TAU;

use glam::DVec3;
use lodestream_server::import::Mesh;

use super::cases::{Case, built, mapped, plain};

/// A box of sides in metres.
pub(super) fn cuboid(name: &'static str, note: &str, sides: DVec3) -> Case {
    built(name, note, box_of(sides))
}

/// The same, turned and far from the origin: f32 of the mesh still tells its sides.
pub(super) fn turned(name: &'static str, note: &str, sides: DVec3, metres: f64) -> Case {
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 0.7, 1.1);
    let mesh = mapped(box_of(sides), |at| turn * at + DVec3::splat(metres));
    built(name, note, mesh)
}

/// A closed prism of 24 sides.
pub(super) fn prism(name: &'static str, radius: f64, height: f64) -> Case {
    let sides = 24;
    let mut positions = vec![DVec3::ZERO, DVec3::Y * height];
    let mut triangles = Vec::new();
    for side in 0..sides {
        let (sine, cosine) = (TAU * f64::from(side) / f64::from(sides)).sin_cos();
        positions.extend([0.0, height].map(|y| DVec3::new(radius * cosine, y, radius * sine)));
        let [a, b] = [2 + 2 * side, 2 + 2 * ((side + 1) % sides)];
        triangles.extend([
            [0, a, b],
            [1, b + 1, a + 1],
            [a, a + 1, b],
            [b, a + 1, b + 1],
        ]);
    }
    let note = format!("radius {radius} m, height {height} m");
    built(name, note, plain(&positions, triangles))
}

fn box_of(sides: DVec3) -> Mesh {
    let bit = |at: u32, axis: u32| f64::from(at >> axis & 1);
    let corner = |at: u32| DVec3::new(bit(at, 0), bit(at, 1), bit(at, 2));
    let positions: Vec<DVec3> = (0..8).map(|at| corner(at) * sides).collect();
    let triangles = [
        [0, 2, 1],
        [1, 2, 3],
        [4, 5, 6],
        [5, 7, 6],
        [0, 1, 4],
        [1, 5, 4],
        [2, 6, 3],
        [3, 6, 7],
        [0, 4, 2],
        [2, 4, 6],
        [1, 3, 5],
        [3, 7, 5],
    ];
    plain(&positions, triangles.to_vec())
}
