//! The stiff and extreme inputs, made in code.

use std::f64::consts::TAU;

use glam::DVec3;
use lodestream_server::import::Mesh;

use super::super::inputs::{self, Generated, Shape};
use super::solids;
use crate::samples::number::Random;

/// What should become of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expected {
    /// An asset.
    Built,
    /// A refusal that contains these words.
    Refused(&'static str),
}

/// An input, and what it is for.
#[derive(Debug, Clone)]
pub struct Case {
    /// Its row.
    pub name: &'static str,
    /// What the numbers of the input really hold.
    pub note: String,
    /// The input.
    pub mesh: Mesh,
    /// What should become of it.
    pub expected: Expected,
    /// Samples each way a group and a surface, at most about.
    pub most_samples: usize,
}

/// Usual samples of a case: a group of a thousand triangles whole.
const SAMPLES: usize = 15_000;

/// How large the cases are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sizes {
    /// Triangles of the ordinary surfaces, about.
    pub surface: u64,
    /// Disconnected triangles, and neighbours of the hub.
    pub many: u32,
}

impl Sizes {
    /// For every day.
    pub const USUAL: Self = Self {
        surface: 12_000,
        many: 20_000,
    };
    /// A million where the case says so.
    pub const FULL: Self = Self {
        surface: 50_000,
        many: 1_000_000,
    };
}

/// Every case. One is made when it is asked for, so that only one is held at a time.
pub fn all(sizes: Sizes) -> Vec<Box<dyn FnOnce() -> Case>> {
    let torus = move || surface(Shape::Torus, sizes);
    let sphere = move || surface(Shape::Sphere, sizes);
    vec![
        Box::new(slivers),
        Box::new(move || duplicates(sphere())),
        Box::new(move || far(sphere(), "1e7 m away", 1e7, 1e3)),
        Box::new(move || far(sphere(), "1e4 m away, millimetres", 1e4, 1.0)),
        Box::new(move || scaled(torus(), "scale 1e-6", 1e-6)),
        Box::new(move || scaled(torus(), "scale 1e6", 1e6)),
        Box::new(flat),
        Box::new(collinear),
        Box::new(nearly_flat),
        Box::new(ruled),
        Box::new(move || two_scales(torus())),
        Box::new(move || spoiled(sphere(), "not a number", f32::NAN)),
        Box::new(move || spoiled(sphere(), "infinite", f32::NEG_INFINITY)),
        Box::new(|| first_triangles("one triangle", 1)),
        Box::new(|| first_triangles("two triangles", 2)),
        Box::new(move || disconnected(sizes.many)),
        Box::new(move || hub(sizes.many)),
        Box::new(move || tetrahedra(sizes.many / 4)),
        Box::new(move || intersecting(sphere())),
        Box::new(move || mixed_winding(sphere())),
        Box::new(three_sheets),
        Box::new(|| {
            let sides = DVec3::new(5.013, 5.007, 5.021);
            solids::cuboid("a box of 5.013 m", "5.013 x 5.007 x 5.021 m", sides)
        }),
        Box::new(|| {
            let sides = DVec3::new(1.219, 2.743, 0.001);
            solids::cuboid("a panel of 1 mm", "1.219 x 2.743 x 0.001 m", sides)
        }),
        Box::new(|| {
            let sides = DVec3::new(5.013, 5.007, 5.021);
            solids::turned("a turned box 1e4 m away", "f32 steps of 1 mm", sides, 1e4)
        }),
        Box::new(|| solids::prism("a prism of 24 sides", 1.2345, 7.891)),
    ]
}

fn surface(shape: Shape, sizes: Sizes) -> Mesh {
    let triangles = sizes.surface;
    Generated { shape, triangles }.mesh()
}

pub(super) fn built(name: &'static str, note: impl Into<String>, mesh: Mesh) -> Case {
    Case {
        name,
        note: note.into(),
        mesh,
        expected: Expected::Built,
        most_samples: SAMPLES,
    }
}

/// A mesh of positions alone (and their normals), in f64.
pub(super) fn plain(positions: &[DVec3], triangles: Vec<[u32; 3]>) -> Mesh {
    let positions = positions.iter().map(|at| at.as_vec3().to_array()).collect();
    inputs::mesh("case", positions, None, triangles)
}

pub(super) fn mapped(mesh: Mesh, map: impl Fn(DVec3) -> DVec3) -> Mesh {
    let at = |position: &[f32; 3]| map(DVec3::from(position.map(f64::from)));
    let positions = mesh.positions.iter();
    Mesh {
        positions: positions.map(|it| at(it).as_vec3().to_array()).collect(),
        ..mesh
    }
}

fn joined(mut mesh: Mesh, other: &Mesh) -> Mesh {
    let first = mesh.positions.len() as u32;
    let shifted = other
        .triangles
        .iter()
        .map(|corners| corners.map(|it| it + first));
    mesh.triangles.extend(shifted);
    mesh.positions.extend(&other.positions);
    mesh.triangle_materials.extend(&other.triangle_materials);
    if let (Some(own), Some(others)) = (&mut mesh.normals, &other.normals) {
        own.extend(others);
    }
    if let (Some(own), Some(others)) = (&mut mesh.uvs, &other.uvs) {
        own.extend(others);
    }
    mesh
}

/// A closed tube whose sides are a million times as long as wide.
fn slivers() -> Case {
    let sides = 1000;
    let width = TAU / f64::from(sides);
    let mut positions = vec![DVec3::ZERO, DVec3::Z * (1e6 * width)];
    let mut triangles = Vec::new();
    for side in 0..sides {
        let angle = width * f64::from(side);
        for end in [0.0, 1e6 * width] {
            positions.push(DVec3::new(angle.cos(), angle.sin(), end));
        }
        let [a, b] = [2 + 2 * side, 2 + 2 * ((side + 1) % sides)];
        triangles.extend([
            [a, b, b + 1],
            [a, b + 1, a + 1],
            [0, b, a],
            [1, a + 1, b + 1],
        ]);
    }
    built(
        "slivers of aspect 1e6",
        "closed tube, 6283 m long, 1000 sides of 6 mm",
        plain(&positions, triangles),
    )
}

fn duplicates(mut mesh: Mesh) -> Case {
    let count = mesh.triangles.len();
    for index in (0..count).step_by(5) {
        let [a, b, c] = mesh.triangles[index];
        let [from, to] = [a, b].map(|it| mesh.positions[it as usize]);
        let middle = mesh.positions.len() as u32;
        mesh.positions
            .push(std::array::from_fn(|axis| 0.5 * (from[axis] + to[axis])));
        let copy = |values: &mut Option<Vec<[f32; 3]>>| {
            if let Some(values) = values {
                values.push(values[a as usize]);
            }
        };
        copy(&mut mesh.normals);
        if let Some(uvs) = &mut mesh.uvs {
            uvs.push(uvs[a as usize]);
        }
        mesh.triangles.extend([[a, b, c], [a, middle, b]]);
    }
    mesh.triangle_materials = vec![0; mesh.triangles.len()];
    built(
        "zero-area and duplicate triangles",
        "a sphere, every fifth triangle twice and one of no area along its edge",
        mesh,
    )
}

fn far(mesh: Mesh, name: &'static str, metres: f64, size: f64) -> Case {
    let mesh = mapped(mesh, |at| at * size + DVec3::splat(metres));
    let step = f64::from((metres as f32).next_up()) - f64::from(metres as f32);
    let note = format!(
        "a sphere of {} m; f32 there holds steps of {step} m, what is finer is lost before the build",
        2.0 * size
    );
    built(name, note, mesh)
}

fn scaled(mesh: Mesh, name: &'static str, factor: f64) -> Case {
    built(
        name,
        "the torus, 3 m before",
        mapped(mesh, |at| at * factor),
    )
}

/// Vertices of a grid and its triangles.
fn sheet(quads: u32, place: impl Fn(f64, f64) -> DVec3) -> Mesh {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for y in 0..=quads {
        for x in 0..=quads {
            positions.push(place(f64::from(x), f64::from(y)));
            if x < quads && y < quads {
                let a = y * (quads + 1) + x;
                let [b, c, d] = [a + 1, a + quads + 2, a + quads + 1];
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    plain(&positions, triangles)
}

fn flat() -> Case {
    let mesh = sheet(70, |x, y| DVec3::new(x, y, 0.0));
    built(
        "exactly flat",
        "70 x 70 quads in a plane, open border",
        mesh,
    )
}

fn collinear() -> Case {
    let mesh = sheet(40, |x, y| DVec3::new(x + 41.0 * y, 0.0, 0.0));
    built(
        "exactly collinear",
        "3200 triangles without area on one line",
        mesh,
    )
}

fn nearly_flat() -> Case {
    let mesh = sheet(70, |x, y| {
        DVec3::new(x, y, 1e-5 * ((x * 0.7).sin() + (y * 1.3).cos()))
    });
    built(
        "nearly singular quadrics",
        "70 m of plane with waves of 10 micrometres",
        mesh,
    )
}

fn ruled() -> Case {
    let mesh = sheet(70, |x, y| {
        let (sine, cosine) = (x / 70.0 * TAU * 0.9).sin_cos();
        DVec3::new(10.0 * cosine, 10.0 * sine, y)
    });
    built(
        "straight rulings",
        "an open cylinder: quadrics without curvature one way",
        mesh,
    )
}

fn two_scales(mesh: Mesh) -> Case {
    let small = mapped(mesh.clone(), |at| at * 1e-3 + DVec3::X * 3.0);
    built(
        "scale 1 and 0.001 in one mesh",
        "the torus and a copy of 3 mm beside it",
        joined(mesh, &small),
    )
}

fn spoiled(mut mesh: Mesh, name: &'static str, value: f32) -> Case {
    mesh.positions[17][1] = value;
    Case {
        expected: Expected::Refused("position 17"),
        ..built(name, "one coordinate of a sphere", mesh)
    }
}

fn first_triangles(name: &'static str, count: usize) -> Case {
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let mut triangles = vec![[0, 1, 2], [0, 2, 3]];
    triangles.truncate(count);
    let positions = corners.map(|[x, y]| DVec3::new(x, y, 0.0));
    built(name, "", plain(&positions[..count + 2], triangles))
}

/// A point of a cube of one metre.
fn somewhere(random: &mut Random) -> DVec3 {
    DVec3::from([(); 3].map(|()| random.between(-0.5, 0.5)))
}

fn disconnected(count: u32) -> Case {
    let mut random = Random::new(3, 1);
    let size = 0.5 / f64::from(count).cbrt();
    let mut positions = Vec::new();
    for _ in 0..count {
        let middle = somewhere(&mut random);
        positions.extend([(); 3].map(|()| middle + somewhere(&mut random) * size));
    }
    let triangles = (0..count).map(|it| [3 * it, 3 * it + 1, 3 * it + 2]);
    let mesh = plain(&positions, triangles.collect());
    built("disconnected triangles", "", mesh)
}

fn hub(neighbours: u32) -> Case {
    let mut positions = vec![DVec3::Z * 0.3, DVec3::Z * -0.3];
    let mut triangles = Vec::new();
    for index in 0..neighbours {
        let angle = TAU * f64::from(index) / f64::from(neighbours);
        let radius = 1.0 + 0.2 * (9.0 * angle).sin();
        positions.push(DVec3::new(angle.cos() * radius, angle.sin() * radius, 0.0));
        let [a, b] = [2 + index, 2 + (index + 1) % neighbours];
        triangles.extend([[0, a, b], [1, b, a]]);
    }
    let mesh = plain(&positions, triangles);
    // Boxes around slivers that all meet at one place overlap: each sample looks at a good part of them.
    let most_samples = (30_000_000 / neighbours as usize).clamp(90, SAMPLES);
    let note = format!("two of them, closed; {most_samples} samples a surface and group");
    Case {
        most_samples,
        ..built("a vertex with many neighbours", note, mesh)
    }
}

fn tetrahedra(count: u32) -> Case {
    let mut random = Random::new(3, 2);
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for _ in 0..count {
        let first = positions.len() as u32;
        let middle = somewhere(&mut random);
        let corners = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]];
        for corner in corners {
            positions.push(middle + DVec3::from(corner.map(f64::from)) * 1e-4);
        }
        let faces = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        triangles.extend(faces.map(|corners: [u32; 3]| corners.map(|it| it + first)));
    }
    built(
        "closed tiny tetrahedra",
        "0.2 mm each, in a cube of 1 m",
        plain(&positions, triangles),
    )
}

fn intersecting(mesh: Mesh) -> Case {
    let other = mapped(mesh.clone(), |at| {
        DVec3::new(at.y, at.z, at.x) + DVec3::X * 0.7
    });
    built(
        "self-intersections",
        "two spheres through each other",
        joined(mesh, &other),
    )
}

fn mixed_winding(mut mesh: Mesh) -> Case {
    mesh.triangles
        .iter_mut()
        .step_by(3)
        .for_each(|it| it.swap(1, 2));
    built(
        "mixed winding",
        "a sphere, every third triangle turned over",
        mesh,
    )
}

fn three_sheets() -> Case {
    let quads = 45;
    let wing = |turn: f64| {
        let (sine, cosine) = (turn * TAU).sin_cos();
        sheet(quads, move |x, y| {
            let bend = 1.0 + 0.02 * (y * 0.4).sin() * x;
            DVec3::new(x * cosine * bend, x * sine * bend, y)
        })
    };
    let mesh = joined(joined(wing(0.0), &wing(1.0 / 3.0)), &wing(2.0 / 3.0));
    built(
        "non-manifold edge",
        "three sheets that share one side and lie folded on themselves",
        mesh,
    )
}
