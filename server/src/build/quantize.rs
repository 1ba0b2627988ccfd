//! Source mesh to grid: from here on every stage works on the positions that will be drawn.

use std::collections::HashMap;

use lodestream_format::cluster::Attributes;
use lodestream_format::grid::Grid;
use lodestream_format::octahedral;
use rayon::prelude::*;

use super::error::BuildError;
use super::steps::{self, PositionStep};
use crate::import::Mesh;

/// A vertex as the format stores it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(super) struct Vertex {
    /// Grid indices relative to the centre.
    pub position: [i32; 3],
    pub normal: [u16; 2],
    pub uv: [i32; 2],
    pub color: [u8; 4],
}

/// Three vertices and the material slot between them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Triangle {
    pub vertices: [u32; 3],
    pub material: u16,
}

/// The source on its grids: no two vertices are equal, no triangle has two corners at one place.
#[derive(Debug)]
pub(super) struct QuantizedMesh {
    pub attributes: Attributes,
    pub position_grid: Grid,
    pub uv_grid: Grid,
    pub center_q: [i64; 3],
    pub material_slots: u32,
    pub vertices: Vec<Vertex>,
    /// For each vertex the number of its place; vertices that differ only in attributes share it.
    pub place_of: Vec<u32>,
    /// Grid indices of each place, exact in f32.
    pub places: Vec<[f32; 3]>,
    pub triangles: Vec<Triangle>,
    pub warnings: Vec<String>,
}

impl QuantizedMesh {
    /// Places of a triangle's corners.
    pub fn places_of(&self, triangle: &Triangle) -> [u32; 3] {
        triangle
            .vertices
            .map(|vertex| self.place_of[vertex as usize])
    }

    /// Metres of one grid step.
    pub fn step_metres(&self) -> f64 {
        self.position_grid.step()
    }

    /// Local position of a vertex, metres; exact.
    pub fn local_metres(&self, vertex: u32) -> [f32; 3] {
        let step = self.step_metres();
        self.vertices[vertex as usize]
            .position
            .map(|q| (q as f64 * step) as f32)
    }
}

/// Puts `mesh` on its grids, welds what became equal and drops triangles of which two corners meet.
pub(super) fn quantize(mesh: &Mesh, step: PositionStep) -> Result<QuantizedMesh, BuildError> {
    check(mesh)?;
    let mut warnings = Vec::new();
    let position_grid = steps::position_grid(mesh, step, &mut warnings)?;
    let uv_grid = steps::uv_grid(mesh.uvs.as_deref().unwrap_or(&[]));
    let on_grid = |position: &[f32; 3]| position.map(|x| position_grid.quantize(x as f64));
    let center_q = center(mesh.positions.iter().map(on_grid));
    let uv_base = uv_base(mesh, uv_grid);

    let has = |present: bool, flag: u32| if present { flag } else { 0 };
    let attributes = Attributes(
        has(mesh.normals.is_some(), Attributes::NORMAL)
            | has(mesh.uvs.is_some(), Attributes::UV)
            | has(mesh.colors.is_some(), Attributes::COLOR),
    );
    let source: Vec<Vertex> = (0..mesh.positions.len())
        .into_par_iter()
        .map(|index| Vertex {
            position: {
                let q = on_grid(&mesh.positions[index]);
                std::array::from_fn(|axis| (q[axis] - center_q[axis]) as i32)
            },
            normal: mesh
                .normals
                .as_ref()
                .map_or([0; 2], |all| octahedral::encode(all[index])),
            uv: mesh.uvs.as_ref().map_or([0; 2], |all| {
                std::array::from_fn(|axis| {
                    let q = uv_grid.quantize(all[index][axis] as f64);
                    q.clamp(uv_base[axis], uv_base[axis] + steps::MOST_UV_STEPS) as i32
                })
            }),
            color: mesh.colors.as_ref().map_or([0; 4], |all| all[index]),
        })
        .collect();

    let mut quantized = QuantizedMesh {
        attributes,
        position_grid,
        uv_grid,
        center_q,
        material_slots: mesh.material_slots.len().max(1) as u32,
        vertices: Vec::new(),
        place_of: Vec::new(),
        places: Vec::new(),
        triangles: Vec::with_capacity(mesh.triangles.len()),
        warnings,
    };
    weld(&mut quantized, mesh, &source);
    Ok(quantized)
}

fn weld(quantized: &mut QuantizedMesh, mesh: &Mesh, source: &[Vertex]) {
    let mut welded: HashMap<Vertex, u32> = HashMap::with_capacity(source.len());
    let mut places: HashMap<[i32; 3], u32> = HashMap::with_capacity(source.len());
    let mut vertex_of = vec![u32::MAX; source.len()];
    let mut number = |quantized: &mut QuantizedMesh, index: u32| {
        let known = &mut vertex_of[index as usize];
        if *known == u32::MAX {
            let vertex = source[index as usize];
            *known = *welded.entry(vertex).or_insert_with(|| {
                let place = *places.entry(vertex.position).or_insert_with(|| {
                    quantized.places.push(vertex.position.map(|q| q as f32));
                    quantized.places.len() as u32 - 1
                });
                quantized.vertices.push(vertex);
                quantized.place_of.push(place);
                quantized.vertices.len() as u32 - 1
            });
        }
        *known
    };
    let mut collapsed = None;
    for (corners, &material) in mesh.triangles.iter().zip(&mesh.triangle_materials) {
        // A triangle that collapses is dropped before its vertices are numbered.
        let [a, b, c] = corners.map(|index| source[index as usize].position);
        if a == b || b == c || c == a {
            collapsed.get_or_insert((corners, material));
            continue;
        }
        let vertices = corners.map(|index| number(quantized, index));
        quantized.triangles.push(Triangle { vertices, material });
    }
    let dropped = mesh.triangles.len() - quantized.triangles.len();
    if dropped > 0 {
        let step = quantized.step_metres();
        quantized.warnings.push(format!(
            "mesh {:?}: {dropped} triangles collapsed on the position grid of {step:e} metres and were dropped",
            mesh.name
        ));
    }
    if let (true, Some((corners, material))) = (quantized.triangles.is_empty(), collapsed) {
        let vertices = corners.map(|index| number(quantized, index));
        quantized.triangles.push(Triangle { vertices, material });
        quantized.warnings.push(format!(
            "mesh {:?}: every triangle collapsed; the first stays, without area",
            mesh.name
        ));
    }
}

/// Grid index in the middle of the bounds.
fn center(positions: impl Iterator<Item = [i64; 3]>) -> [i64; 3] {
    let (mut low, mut high) = ([i64::MAX; 3], [i64::MIN; 3]);
    for q in positions {
        for axis in 0..3 {
            low[axis] = low[axis].min(q[axis]);
            high[axis] = high[axis].max(q[axis]);
        }
    }
    std::array::from_fn(|axis| low[axis] + (high[axis] - low[axis]) / 2)
}

fn uv_base(mesh: &Mesh, grid: Grid) -> [i64; 2] {
    let uvs = mesh.uvs.as_deref().unwrap_or(&[]);
    std::array::from_fn(|axis| {
        uvs.iter()
            .map(|uv| grid.quantize(uv[axis] as f64))
            .min()
            .unwrap_or(0)
    })
}

/// The promises of [`Mesh`], which unchecked foreign code relies on further down.
fn check(mesh: &Mesh) -> Result<(), BuildError> {
    let wrong = |at: String, expected: String, found: String| BuildError::InvalidMesh {
        mesh: mesh.name.clone(),
        at,
        expected,
        found,
    };
    if mesh.triangles.is_empty() {
        return Err(BuildError::NoTriangles {
            mesh: mesh.name.clone(),
        });
    }
    let vertices = mesh.positions.len();
    let lengths = [
        ("normals", mesh.normals.as_ref().map(Vec::len), vertices),
        ("uvs", mesh.uvs.as_ref().map(Vec::len), vertices),
        ("colors", mesh.colors.as_ref().map(Vec::len), vertices),
        (
            "triangle materials",
            Some(mesh.triangle_materials.len()),
            mesh.triangles.len(),
        ),
    ];
    for (name, length, expected) in lengths {
        if let Some(found) = length.filter(|&length| length != expected) {
            return Err(wrong(name.into(), expected.to_string(), found.to_string()));
        }
    }
    // Half of u32: an edge packs two places and a sign into 64 bits.
    let most = (u32::MAX / 2) as usize;
    if vertices > most || mesh.triangles.len() > most / 3 {
        let found = format!("{vertices} and {}", mesh.triangles.len());
        return Err(wrong(
            "vertices and triangles".into(),
            format!("at most {most} and {}", most / 3),
            found,
        ));
    }
    let outside = mesh
        .triangles
        .iter()
        .position(|corners| corners.iter().any(|&index| index as usize >= vertices));
    if let Some(triangle) = outside {
        let found = format!("{:?}", mesh.triangles[triangle]);
        return Err(wrong(
            format!("triangle {triangle}"),
            format!("indices below {vertices}"),
            found,
        ));
    }
    let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
    if let Some(index) = mesh.positions.iter().position(|position| !finite(position)) {
        let found = format!("{:?}", mesh.positions[index]);
        return Err(wrong(
            format!("position {index}"),
            "finite numbers".into(),
            found,
        ));
    }
    let uvs = mesh.uvs.as_deref().unwrap_or(&[]);
    if let Some(index) = uvs.iter().position(|uv| !finite(uv)) {
        let found = format!("{:?}", uvs[index]);
        return Err(wrong(format!("uv {index}"), "finite numbers".into(), found));
    }
    let slots = mesh.material_slots.len().max(1);
    let slot = mesh
        .triangle_materials
        .iter()
        .position(|&slot| slot as usize >= slots);
    if let Some(triangle) = slot {
        let found = mesh.triangle_materials[triangle].to_string();
        return Err(wrong(
            format!("material of triangle {triangle}"),
            format!("below {slots}"),
            found,
        ));
    }
    Ok(())
}
