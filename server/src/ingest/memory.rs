//! `--memory-limit`: what a run will need, estimated before it needs it.

use std::path::PathBuf;

use super::IngestError;
use super::merge::Merged;
use crate::import::Mesh;

/// Bytes that a build takes at its peak for each source triangle, beside the mesh. Measured: 170 (positions only, closed) to
/// 390 (foliage with texture coordinates).
const BUILD_BYTES_A_TRIANGLE: u64 = 500;
/// Bytes of memory for a byte of an input file while it is imported: the file, its decoded arrays, and their merge.
const IMPORT_BYTES_A_BYTE: u64 = 4;
/// Meshes of more triangles are built alone where the limit does not ask for less.
const LARGE_TRIANGLES: usize = 200_000;

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

/// Refuses scenes whose largest mesh would not fit; gives the triangles above which a mesh is to be built alone.
pub(super) fn check_build(merged: &Merged, limit: Option<u64>) -> Result<usize, IngestError> {
    let held: u64 = merged
        .meshes
        .iter()
        .map(|mesh| mesh_bytes(&mesh.mesh))
        .sum();
    let images: u64 = merged
        .images
        .iter()
        .map(|image| image.bytes.len() as u64)
        .sum();
    let held = held + images;
    let Some(largest) = merged
        .meshes
        .iter()
        .max_by_key(|mesh| mesh.mesh.triangles.len())
    else {
        return Ok(LARGE_TRIANGLES);
    };
    let largest_bytes = largest.mesh.triangles.len() as u64 * BUILD_BYTES_A_TRIANGLE;
    let what = format!("{}: mesh {:?}", largest.file.display(), largest.mesh.name);
    fits(&what, held + largest_bytes, limit)?;
    let threads = rayon::current_num_threads() as u64;
    let spare = limit.map_or(u64::MAX, |limit| limit - held);
    let side_by_side = spare / threads / BUILD_BYTES_A_TRIANGLE;
    Ok(LARGE_TRIANGLES.min(side_by_side as usize))
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
