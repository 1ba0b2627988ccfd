//! `--memory-limit`: what a run will need, estimated before it needs it.

use std::path::PathBuf;

use super::IngestError;
use super::assets::KeyedMesh;
use super::merge::MergedImage;
use crate::import::Mesh;

/// Bytes that a build takes at its peak for each source triangle, beside the mesh. Measured: 170 (positions only, closed) to
/// 390 (foliage with texture coordinates).
const BUILD_BYTES_A_TRIANGLE: u64 = 500;
/// Bytes of memory for a byte of an input file while it is imported: the file, its decoded arrays, and their merge.
const IMPORT_BYTES_A_BYTE: u64 = 4;
/// Meshes of more triangles are built alone where the limit does not ask for less.
const LARGE_TRIANGLES: u64 = 200_000;

/// Refuses inputs whose import alone would not fit.
pub(super) fn check_inputs(inputs: &[PathBuf], limit: Option<u64>) -> Result<(), IngestError> {
    let mut bytes = 0;
    for input in inputs {
        let metadata = input.metadata().map_err(|cause| IngestError::Input {
            file: input.clone(),
            cause,
        })?;
        bytes += metadata.len();
    }
    let first = inputs.first().map(|input| input.display().to_string());
    fits(
        &format!("importing {}", first.unwrap_or_default()),
        bytes.saturating_mul(IMPORT_BYTES_A_BYTE),
        limit,
    )
}

/// Refuses where the largest of `meshes` would not fit beside what is held; gives the triangles above which a mesh is to be
/// built alone.
pub(super) fn check_build(
    meshes: &[KeyedMesh],
    images: &[MergedImage],
    limit: Option<u64>,
) -> Result<u64, IngestError> {
    let held = meshes.iter().map(|keyed| mesh_bytes(&keyed.mesh.mesh));
    let images = images.iter().map(|image| image.bytes.len() as u64);
    let held = held.sum::<u64>() + images.sum::<u64>();
    let Some(largest) = meshes.iter().max_by_key(|keyed| keyed.mesh.triangles) else {
        return Ok(LARGE_TRIANGLES);
    };
    let largest = &largest.mesh;
    let largest_bytes = largest.triangles * BUILD_BYTES_A_TRIANGLE;
    let what = format!("{}: mesh {:?}", largest.file.display(), largest.mesh.name);
    fits(&what, held + largest_bytes, limit)?;
    let threads = rayon::current_num_threads() as u64;
    let spare = limit.map_or(u64::MAX, |limit| limit - held);
    Ok(LARGE_TRIANGLES.min(spare / threads / BUILD_BYTES_A_TRIANGLE))
}

fn fits(what: &str, need_bytes: u64, limit: Option<u64>) -> Result<(), IngestError> {
    match limit {
        Some(limit_bytes) if need_bytes > limit_bytes => Err(IngestError::Memory {
            what: what.to_owned(),
            limit_bytes,
            need_bytes,
        }),
        _ => Ok(()),
    }
}

fn mesh_bytes(mesh: &Mesh) -> u64 {
    let vertex = 12
        + mesh.normals.as_ref().map_or(0, |_| 12)
        + mesh.uvs.as_ref().map_or(0, |_| 8)
        + mesh.colors.as_ref().map_or(0, |_| 4);
    (mesh.positions.len() * vertex + mesh.triangles.len() * 14) as u64
}
