//! The same triangles without levels and pages: level 0 as one mesh, by meshoptimizer's vertex and index codecs and zstd.

use std::collections::HashMap;

use lodestream_format::cluster::{Attributes, NO_GROUP};
use lodestream_format::{Cluster, FormatError};
use lodestream_server::build::{BuiltAsset, unpack_pages};

use super::has;

/// A vertex on the asset's grids: position, octahedral normal, texture coordinates, colour; zeros for what it lacks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
#[repr(C)]
struct Vertex {
    position: [i32; 3],
    uv: [i32; 2],
    normal: [u16; 2],
    color: [u8; 4],
}

/// Level of zstd.
const ZSTD_LEVEL: i32 = 9;

/// Bytes of level 0 of an asset as one mesh.
pub(super) fn bytes(built: &BuiltAsset) -> Result<u64, FormatError> {
    let mut vertices: Vec<Vertex> = Vec::new();
    let mut number: HashMap<Vertex, u32> = HashMap::new();
    let mut indices: Vec<u32> = Vec::new();
    let clusters = unpack_pages(built)?.into_iter().flatten();
    for cluster in clusters.filter(|cluster| cluster.child_group == NO_GROUP) {
        for &vertex in cluster.triangles.iter().flatten() {
            let vertex = vertex_of(&cluster, vertex as usize);
            indices.push(*number.entry(vertex).or_insert_with(|| {
                vertices.push(vertex);
                vertices.len() as u32 - 1
            }));
        }
    }
    let indices = meshopt::optimize_vertex_cache(&indices, vertices.len());
    let mut indices = indices;
    let vertices = meshopt::optimize_vertex_fetch(&mut indices, &vertices);
    let failed =
        |error| FormatError::new("meshoptimizer's codec", "to encode", format!("{error:?}"));
    let coded_indices = meshopt::encode_index_buffer(&indices, vertices.len()).map_err(failed)?;
    let mut bytes = compressed(&coded_indices)?;
    // Attributes that the asset lacks cost nothing: each goes by itself.
    let mut add = |present: bool, coded: meshopt::Result<Vec<u8>>| {
        if present {
            bytes += compressed(&coded.map_err(failed)?)?;
        }
        Ok::<(), FormatError>(())
    };
    let positions: Vec<[i32; 3]> = vertices.iter().map(|it| it.position).collect();
    add(true, meshopt::encode_vertex_buffer(&positions))?;
    let normals: Vec<[u16; 2]> = vertices.iter().map(|it| it.normal).collect();
    let normals = meshopt::encode_vertex_buffer(&normals);
    add(has(built, Attributes::NORMAL), normals)?;
    let uvs: Vec<[i32; 2]> = vertices.iter().map(|it| it.uv).collect();
    add(
        has(built, Attributes::UV),
        meshopt::encode_vertex_buffer(&uvs),
    )?;
    let colors: Vec<[u8; 4]> = vertices.iter().map(|it| it.color).collect();
    add(
        has(built, Attributes::COLOR),
        meshopt::encode_vertex_buffer(&colors),
    )?;
    Ok(bytes)
}

fn vertex_of(cluster: &Cluster, vertex: usize) -> Vertex {
    Vertex {
        position: cluster.positions[vertex],
        uv: cluster.uvs.get(vertex).copied().unwrap_or_default(),
        normal: cluster.normals.get(vertex).copied().unwrap_or_default(),
        color: cluster.colors.get(vertex).copied().unwrap_or_default(),
    }
}

fn compressed(bytes: &[u8]) -> Result<u64, FormatError> {
    let packed = zstd::bulk::compress(bytes, ZSTD_LEVEL);
    let packed = packed.map_err(|error| FormatError::new("zstd", "to compress", error))?;
    Ok(packed.len() as u64)
}
