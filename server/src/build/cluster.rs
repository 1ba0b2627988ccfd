//! A cluster between the stages: everything in one run of words, so that it lies in memory or on disk alike.

use bytemuck::{Pod, Zeroable};
use lodestream_format::cluster::MaterialRange;
use lodestream_format::{Aabb, Sphere};

use super::vertex::{Grids, Vertex};

/// A point of the source surface that the simplification has left behind, and the triangle of this cluster nearest to
/// it: what the error of the next level is measured with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Witness {
    pub position: [i32; 3],
    pub triangle: u32,
}

/// Counts of the arrays that follow, in their order.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
struct Counts {
    vertices: u32,
    triangles: u32,
    border: u32,
    materials: u32,
    witnesses: u32,
}

/// Arrays of a cluster.
pub(super) const TABLES: usize = size_of::<Counts>() / 4;
const VERTEX_WORDS: usize = size_of::<Vertex>() / 4;
const WITNESS_WORDS: usize = size_of::<Witness>() / 4;
/// Words of an entry of each array.
pub(super) const RECORD_WORDS: [usize; TABLES] = [VERTEX_WORDS, 1, 1, 1, WITNESS_WORDS];

/// What is left of the run of words that a cluster was written to.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClusterView<'a> {
    pub vertices: &'a [Vertex],
    /// Vertices of each triangle; the fourth byte is 0. Triangles of one material follow each other.
    pub triangles: &'a [[u8; 4]],
    /// Directed edges with a triangle of this cluster on one side only, as two vertices; two bytes are 0.
    pub border: &'a [[u8; 4]],
    /// Slot and number of triangles of each run.
    pub materials: &'a [[u16; 2]],
    pub witnesses: &'a [Witness],
}

impl<'a> ClusterView<'a> {
    /// Reads what [`write`] wrote.
    pub fn new(words: &'a [u32]) -> Self {
        let (counts, words) = words.split_at(TABLES);
        let counts: &Counts = &bytemuck::cast_slice(counts)[0];
        let (vertices, words) = words.split_at(counts.vertices as usize * VERTEX_WORDS);
        let (triangles, words) = words.split_at(counts.triangles as usize);
        let (border, words) = words.split_at(counts.border as usize);
        let (materials, words) = words.split_at(counts.materials as usize);
        let (witnesses, _) = words.split_at(counts.witnesses as usize * WITNESS_WORDS);
        Self {
            vertices: bytemuck::cast_slice(vertices),
            triangles: bytemuck::cast_slice(triangles),
            border: bytemuck::cast_slice(border),
            materials: bytemuck::cast_slice(materials),
            witnesses: bytemuck::cast_slice(witnesses),
        }
    }

    /// Material slot of each triangle.
    pub fn slots(&self) -> impl Iterator<Item = u16> + '_ {
        self.materials
            .iter()
            .flat_map(|&[slot, count]| std::iter::repeat_n(slot, count as usize))
    }

    /// Runs of one material, as the format names them.
    pub fn material_ranges(&self) -> Vec<MaterialRange> {
        self.materials
            .iter()
            .map(|&[slot, triangle_count]| MaterialRange {
                slot,
                triangle_count,
            })
            .collect()
    }
}

/// Appends a cluster to `words`.
pub(super) fn write(view: &ClusterView, words: &mut Vec<u32>) {
    let counts = Counts {
        vertices: view.vertices.len() as u32,
        triangles: view.triangles.len() as u32,
        border: view.border.len() as u32,
        materials: view.materials.len() as u32,
        witnesses: view.witnesses.len() as u32,
    };
    words.extend_from_slice(bytemuck::cast_slice(&[counts]));
    words.extend_from_slice(bytemuck::cast_slice(view.vertices));
    words.extend(
        view.triangles
            .iter()
            .map(|&bytes| u32::from_ne_bytes(bytes)),
    );
    words.extend(view.border.iter().map(|&bytes| u32::from_ne_bytes(bytes)));
    words.extend(
        view.materials
            .iter()
            .map(|run| bytemuck::cast::<_, u32>(*run)),
    );
    words.extend_from_slice(bytemuck::cast_slice(view.witnesses));
}

/// What stays in memory of every cluster.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ClusterInfo {
    /// Run of words in the store.
    pub blob: u32,
    pub first_word: u32,
    pub words: u32,
    pub triangle_count: u8,
    /// 0 for source triangles, else one more than that of the group that it replaces.
    pub level: u8,
    /// Group whose simplification made it, or `NO_GROUP`.
    pub child_group: u32,
    /// Smallest and largest grid index.
    pub low: [i32; 3],
    pub high: [i32; 3],
}

impl ClusterInfo {
    /// Bounding box, local metres; exact.
    pub fn aabb(&self, grids: &Grids) -> Aabb {
        Aabb {
            min: grids.local_metres(self.low),
            max: grids.local_metres(self.high),
        }
    }

    /// Twice the middle of the bounds, grid indices.
    pub fn middle(&self) -> [f32; 3] {
        std::array::from_fn(|axis| (self.low[axis] + self.high[axis]) as f32)
    }
}

/// What every cluster of one group was born with.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Birth {
    /// Error of the group's replacement, metres; 0 for source triangles.
    pub error_metres: f32,
    /// Distance of the replacement from the source at most, metres; 0 for source triangles.
    pub surface_metres: f32,
    /// Lod sphere of that group.
    pub lod_sphere: Sphere,
}
