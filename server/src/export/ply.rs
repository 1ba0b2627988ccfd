//! Binary little-endian PLY: the world-space triangles of all instances, merged. Coordinates are
//! floats, doubles where floats would lose.

use std::io::{self, Write};
use std::path::Path;

use glam::{DMat3, DVec3};
use lodestream_format::Scene;
use lodestream_format::scene::Instance;

use super::ExportError;
use super::mesh::PlainMesh;

/// Writes the whole file.
pub(super) fn write(
    file: &mut impl Write,
    out: &Path,
    scene: &Scene,
    meshes: &[PlainMesh],
) -> Result<(), ExportError> {
    let used = |instance: &Instance| &meshes[instance.asset as usize];
    let vertices: u64 = scene
        .instances
        .iter()
        .map(|instance| used(instance).vertex_count() as u64)
        .sum();
    let triangles: u64 = scene
        .instances
        .iter()
        .map(|instance| used(instance).triangle_count())
        .sum();
    if vertices > u32::MAX as u64 {
        return Err(ExportError::TooLarge {
            file: out.to_owned(),
            expected: format!("at most {} vertices", u32::MAX),
            found: vertices.to_string(),
        });
    }
    write_all(file, scene, meshes, vertices, triangles).map_err(|cause| ExportError::File {
        file: out.to_owned(),
        cause,
    })
}

fn write_all(
    file: &mut impl Write,
    scene: &Scene,
    meshes: &[PlainMesh],
    vertices: u64,
    triangles: u64,
) -> io::Result<()> {
    let doubles = floats_lose(scene, meshes);
    let kind = if doubles { "double" } else { "float" };
    write!(
        file,
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\n\
         property {kind} x\nproperty {kind} y\nproperty {kind} z\n\
         element face {triangles}\nproperty list uchar uint vertex_indices\nend_header\n"
    )?;
    for instance in &scene.instances {
        let rows = &instance.world_from_object;
        for position in meshes[instance.asset as usize].positions() {
            for [x, y, z, translation] in rows {
                let world = DVec3::new(*x, *y, *z).dot(position.into()) + translation;
                match doubles {
                    true => file.write_all(&world.to_le_bytes())?,
                    false => file.write_all(&(world as f32).to_le_bytes())?,
                }
            }
        }
    }
    let mut first = 0;
    for instance in &scene.instances {
        let mesh = &meshes[instance.asset as usize];
        let mirrored = is_mirrored(instance);
        for [a, b, c] in mesh.slots.iter().flatten() {
            // A mirror turns the winding; it is turned back, so that outside stays outside.
            let corners = if mirrored { [a, c, b] } else { [a, b, c] };
            file.write_all(&[3])?;
            for corner in corners {
                file.write_all(&(first + corner).to_le_bytes())?;
            }
        }
        first += mesh.vertex_count() as u32;
    }
    Ok(())
}

/// Whether f32 would round a coordinate by more than a sixteenth of what the mesh's grid does.
fn floats_lose(scene: &Scene, meshes: &[PlainMesh]) -> bool {
    /// Half of the distance between two floats, of the larger ones.
    const ROUNDING: f64 = 1.0 / (1 << f32::MANTISSA_DIGITS) as f64;
    const SHARE: f64 = 1.0 / 16.0;
    let bounds = |mesh: &PlainMesh| {
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        mesh.positions().fold(none, |(least, most), position| {
            let position = DVec3::from(position);
            (least.min(position), most.max(position))
        })
    };
    let bounds: Vec<(DVec3, DVec3)> = meshes.iter().map(bounds).collect();
    scene.instances.iter().any(|instance| {
        let mesh = instance.asset as usize;
        let (least, most) = bounds[mesh];
        let (center, half) = ((least + most) / 2.0, (most - least) / 2.0);
        let mut rows = instance.world_from_object.iter();
        rows.any(|&[x, y, z, translation]| {
            let row = DVec3::new(x, y, z);
            let farthest = (row.dot(center) + translation).abs() + row.abs().dot(half);
            let step = meshes[mesh].step_metres() * row.abs().max_element();
            farthest * ROUNDING > step * SHARE
        })
    })
}

fn is_mirrored(instance: &Instance) -> bool {
    let rows = instance.world_from_object.map(|[x, y, z, _]| [x, y, z]);
    DMat3::from_cols_array_2d(&rows).determinant() < 0.0
}
