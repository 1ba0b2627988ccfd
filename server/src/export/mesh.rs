//! Clusters of a cut become one plain mesh: vertices that are equal in every attribute are one vertex.

use std::collections::HashMap;

use lodestream_format::cluster::{Attributes, NO_GROUP};
use lodestream_format::grid::Grid;
use lodestream_format::page_reader::PageReader;
use lodestream_format::{Cluster, cluster_view, octahedral};
use tokio::runtime::Handle;

use super::cut::SceneAssetCut;
use crate::library::{Library, LibraryError};

/// One asset's share of a cut. Attributes that the asset lacks are empty.
#[derive(Debug)]
pub(super) struct PlainMesh {
    attributes: Attributes,
    position_grid: Grid,
    uv_grid: Grid,
    center_q: [i64; 3],
    vertices: Vec<Vertex>,
    /// Triangles of each material slot.
    pub slots: Vec<Vec<[u32; 3]>>,
}

/// Quantized, so that equality is exact; attributes that are not there are zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Vertex {
    position: [i32; 3],
    normal: [u16; 2],
    uv: [i32; 2],
    color: [u8; 4],
}

/// Reads the clusters of the cut with `error_metres` and welds them.
pub(super) fn weld(
    runtime: &Handle,
    library: &Library,
    cut: &SceneAssetCut,
    error_metres: f64,
) -> Result<PlainMesh, LibraryError> {
    let asset = &cut.asset;
    let mut mesh = PlainMesh {
        attributes: asset.attributes,
        position_grid: asset.position_grid,
        uv_grid: asset.uv_grid,
        center_q: asset.center_q,
        vertices: vec![],
        slots: vec![vec![]; asset.material_slots as usize],
    };
    let mut known = HashMap::new();
    let mut reader = PageReader::new(asset);
    for page in cut.pages(error_metres) {
        let form = cut.page(runtime, library, page)?;
        let words = reader
            .read(&form)
            .map_err(|error| library.damaged(format!("asset {} page {page}", cut.hash), error))?;
        for cluster in cluster_view::clusters(words) {
            let child = cluster.child_group;
            let drawn = cut.refines(cluster.group, error_metres)
                && (child == NO_GROUP || !cut.refines(child, error_metres));
            if drawn {
                mesh.add(&cluster, &mut known).map_err(|slot| {
                    let slots = format!("a material slot below {}", asset.material_slots);
                    let error = lodestream_format::FormatError::new("cluster", slots, slot);
                    library.damaged(format!("asset {} page {page}", cut.hash), error)
                })?;
            }
        }
    }
    Ok(mesh)
}

impl PlainMesh {
    /// Adds a cluster; fails with a slot that the asset does not have.
    fn add(&mut self, cluster: &Cluster, known: &mut HashMap<Vertex, u32>) -> Result<(), u16> {
        let index_of: Vec<u32> = (0..cluster.positions.len())
            .map(|vertex| {
                let vertex = Vertex {
                    position: cluster.positions[vertex],
                    normal: cluster.normals.get(vertex).copied().unwrap_or_default(),
                    uv: cluster.uvs.get(vertex).copied().unwrap_or_default(),
                    color: cluster.colors.get(vertex).copied().unwrap_or_default(),
                };
                *known.entry(vertex).or_insert_with(|| {
                    self.vertices.push(vertex);
                    self.vertices.len() as u32 - 1
                })
            })
            .collect();
        let mut triangles = cluster.triangles.iter();
        for range in &cluster.materials {
            let slot = self.slots.get_mut(range.slot as usize).ok_or(range.slot)?;
            let run = triangles.by_ref().take(range.triangle_count as usize);
            slot.extend(run.map(|corners| corners.map(|corner| index_of[corner as usize])));
        }
        Ok(())
    }

    pub(super) fn triangle_count(&self) -> u64 {
        self.slots.iter().map(|slot| slot.len() as u64).sum()
    }

    pub(super) fn vertex_count(&self) -> usize {
        self.vertices.len()
    }

    /// Metres between the grid's points.
    pub(super) fn step_metres(&self) -> f64 {
        self.position_grid.step()
    }

    /// The point that f32 positions are relative to, so that none is rounded: the object's origin
    /// unless a vertex is more than 2^24 steps away from it.
    pub(super) fn origin(&self) -> [f64; 3] {
        const EXACT: u64 = 1 << f32::MANTISSA_DIGITS;
        let index =
            |vertex: &Vertex, axis: usize| self.center_q[axis] + vertex.position[axis] as i64;
        let is_near = |vertex: &Vertex| (0..3).all(|at| index(vertex, at).unsigned_abs() <= EXACT);
        match self.vertices.iter().all(is_near) {
            true => [0.0; 3],
            false => self
                .center_q
                .map(|index| self.position_grid.dequantize(index)),
        }
    }

    /// Object-space positions, metres; exact.
    pub(super) fn positions(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        self.vertices.iter().map(|vertex| {
            std::array::from_fn(|axis| {
                let index = self.center_q[axis] + vertex.position[axis] as i64;
                self.position_grid.dequantize(index)
            })
        })
    }

    /// Unit normals, if the asset has them.
    pub(super) fn normals(&self) -> Option<impl Iterator<Item = [f32; 3]> + '_> {
        let decoded = self.vertices.iter().map(|v| octahedral::decode(v.normal));
        self.attributes.has(Attributes::NORMAL).then_some(decoded)
    }

    /// Texture coordinates, if the asset has them.
    pub(super) fn uvs(&self) -> Option<impl Iterator<Item = [f32; 2]> + '_> {
        let grid = self.uv_grid;
        let decoded = self
            .vertices
            .iter()
            .map(move |v| v.uv.map(|index| grid.dequantize(index as i64) as f32));
        self.attributes.has(Attributes::UV).then_some(decoded)
    }

    /// Linear RGBA of eight bits, if the asset has them.
    pub(super) fn colors(&self) -> Option<impl Iterator<Item = [u8; 4]> + '_> {
        let colors = self.vertices.iter().map(|v| v.color);
        self.attributes.has(Attributes::COLOR).then_some(colors)
    }
}
