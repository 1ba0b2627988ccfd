//! Binary little-endian PLY: the world-space triangles of all instances, merged.

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
    write!(
        file,
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\n\
         property float x\nproperty float y\nproperty float z\n\
         element face {triangles}\nproperty list uchar uint vertex_indices\nend_header\n"
    )?;
    for instance in &scene.instances {
        let rows = &instance.world_from_object;
        for position in meshes[instance.asset as usize].positions() {
            for [x, y, z, translation] in rows {
                let world = DVec3::new(*x, *y, *z).dot(position.into()) + translation;
                file.write_all(&(world as f32).to_le_bytes())?;
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

fn is_mirrored(instance: &Instance) -> bool {
    let rows = instance.world_from_object.map(|[x, y, z, _]| [x, y, z]);
    DMat3::from_cols_array_2d(&rows).determinant() < 0.0
}
