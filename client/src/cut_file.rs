//! The chosen cut as a PLY file: the triangles of the visible clusters, in world space.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use glam::DVec3;
use lodestream_format::cluster_view::ClusterView;
use lodestream_shaders::SceneArrays;
use lodestream_shaders::types::ClusterItem;

use crate::picture::FileError;

/// Triangles of a cut, corner after corner.
#[derive(Debug, Clone, Default)]
pub struct CutTriangles {
    /// Corners in world space, metres; each cluster's vertices are its own.
    pub vertices: Vec<DVec3>,
    /// Three vertices each.
    pub triangles: Vec<[u32; 3]>,
}

/// Unpacks `visible` from the pool's words.
pub fn triangles(arrays: &SceneArrays, visible: &[ClusterItem], pool: &[u32]) -> CutTriangles {
    let mut cut = CutTriangles::default();
    for item in visible {
        let page = pool.get(item.page_word as usize..).unwrap_or(&[]);
        let (Some(cluster), Some(instance)) = (
            ClusterView::new(page, item.cluster),
            arrays.instances.get(item.instance as usize),
        ) else {
            continue;
        };
        let step = arrays.assets[instance.asset as usize].position_step as f64;
        let first = cut.vertices.len() as u32;
        let world = |vertex| {
            let local = cluster.position_q(vertex).map(|q| q as f64 * step);
            instance.world_from_local(local.into())
        };
        cut.vertices
            .extend((0..cluster.header.vertex_count()).map(world));
        let numbered = |triangle| cluster.triangle(triangle).map(|vertex| first + vertex);
        cut.triangles
            .extend((0..cluster.header.triangle_count()).map(numbered));
    }
    cut
}

/// Writes a binary little-endian PLY with f64 coordinates: world space may be far from its origin.
pub fn write_ply(file: &Path, cut: &CutTriangles) -> Result<(), FileError> {
    let failed = |error: std::io::Error| FileError::new(file, error);
    let mut writer = BufWriter::new(File::create(file).map_err(failed)?);
    write!(
        writer,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
         property double z\nelement face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        cut.vertices.len(),
        cut.triangles.len()
    )
    .map_err(failed)?;
    for vertex in &cut.vertices {
        writer
            .write_all(bytemuck::bytes_of(&vertex.to_array()))
            .map_err(failed)?;
    }
    for triangle in &cut.triangles {
        writer.write_all(&[3]).map_err(failed)?;
        writer
            .write_all(bytemuck::bytes_of(triangle))
            .map_err(failed)?;
    }
    writer.flush().map_err(failed)
}
