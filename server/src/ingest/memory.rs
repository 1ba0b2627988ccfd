//! `--memory-limit`: what is kept in memory, what goes through the disk, and what would not fit either way.

use std::path::PathBuf;

use super::IngestError;
use super::assets::KeyedMesh;
use super::merge::{MergedImage, MergedMesh};
use crate::import::{Mesh, OpenedMesh};

/// Bytes that a build in memory takes at its peak for each source triangle, beside the mesh (measured: see the table of
/// `lodestream-loadtests build`).
const BUILD_BYTES_A_TRIANGLE: u64 = 120;
/// Bytes that a build through the disk keeps in memory for each source triangle: what names its clusters, groups and pages.
const SCRATCH_BYTES_A_TRIANGLE: u64 = 5;
/// Bytes that a thread works in, whatever the mesh: pieces, buckets, a chunk of clusters, pages.
const WORK_BYTES_A_THREAD: u64 = 96 << 20;
/// Bytes of memory for a byte of a text file while it is imported; text cannot be read in pieces.
const TEXT_BYTES_A_BYTE: u64 = 4;
/// A mesh whose arrays take more than this share of the limit is read piece by piece.
const MESH_SHARE: u64 = 8;
/// Meshes of more triangles are built alone where the limit does not ask for less.
const LARGE_TRIANGLES: u64 = 200_000;

/// How meshes are built with the memory there is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Room {
    /// Meshes of more triangles are built alone.
    pub alone_above: u64,
    /// Meshes of more triangles are built through the disk.
    pub disk_above: u64,
}

/// Bytes of the largest mesh that is loaded whole.
pub(super) fn most_mesh_bytes(limit: Option<u64>) -> u64 {
    limit.map_or(u64::MAX, |limit| limit / MESH_SHARE)
}

/// The limit whose [`most_mesh_bytes`] these are: which meshes are loaded hangs on it.
pub(super) fn limit_of(mesh_bytes: u64) -> Option<u64> {
    (mesh_bytes < u64::MAX).then(|| mesh_bytes.saturating_mul(MESH_SHARE))
}

/// Refuses text files whose import alone would not fit.
pub(super) fn check_inputs(inputs: &[PathBuf], limit: Option<u64>) -> Result<(), IngestError> {
    for input in inputs {
        let metadata = input.metadata().map_err(|cause| IngestError::Input {
            file: input.clone(),
            cause,
        })?;
        let text = input
            .extension()
            .is_some_and(|extension| extension.eq_ignore_ascii_case("obj"));
        if text {
            let need = metadata.len().saturating_mul(TEXT_BYTES_A_BYTE);
            fits(&format!("importing {}", input.display()), need, limit)?;
        }
    }
    Ok(())
}

/// Refuses where the largest of `meshes` would not fit beside what is held, not even through the disk.
pub(super) fn check_build(
    meshes: &[KeyedMesh],
    images: &[MergedImage],
    limit: Option<u64>,
) -> Result<Room, IngestError> {
    let held = meshes.iter().map(|keyed| held_bytes(&keyed.mesh.mesh));
    let images = images.iter().map(|image| image.bytes.len() as u64);
    let held = held.sum::<u64>() + images.sum::<u64>();
    let threads = rayon::current_num_threads() as u64;
    let Some(limit) = limit else {
        return Ok(Room {
            alone_above: LARGE_TRIANGLES,
            disk_above: u64::MAX,
        });
    };
    let work = held + threads * WORK_BYTES_A_THREAD;
    let largest: Option<&MergedMesh> = meshes
        .iter()
        .map(|keyed| &keyed.mesh)
        .max_by_key(|mesh| mesh.triangles);
    if let Some(largest) = largest {
        let what = format!(
            "{}: a mesh of {} triangles",
            largest.file.display(),
            largest.triangles
        );
        let least = BUILD_BYTES_A_TRIANGLE * largest.triangles;
        let disk = SCRATCH_BYTES_A_TRIANGLE * largest.triangles;
        fits(&what, work + disk.min(least), Some(limit))?;
    }
    let spare = limit.saturating_sub(work);
    Ok(Room {
        alone_above: LARGE_TRIANGLES.min(spare / threads / BUILD_BYTES_A_TRIANGLE),
        disk_above: spare / BUILD_BYTES_A_TRIANGLE,
    })
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

fn held_bytes(mesh: &OpenedMesh) -> u64 {
    match mesh {
        OpenedMesh::Loaded(mesh) => mesh_bytes(mesh),
        OpenedMesh::Streamed(_) => 0,
    }
}

fn mesh_bytes(mesh: &Mesh) -> u64 {
    let vertex = 12
        + mesh.normals.as_ref().map_or(0, |_| 12)
        + mesh.uvs.as_ref().map_or(0, |_| 8)
        + mesh.colors.as_ref().map_or(0, |_| 4);
    (mesh.positions.len() * vertex + mesh.triangles.len() * 14) as u64
}
