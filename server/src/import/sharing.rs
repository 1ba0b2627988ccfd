//! Sharing: what the counts of accessors come to, told before any element is read. Each reference
//! to an accessor copies it, so a small file may unfold to a huge one.

use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::Document;
use super::allowance::Allowance;
use super::attributes::Present;
use super::error::{Read, malformed};
use super::nodes::Placed;
use super::opened::array_bytes;
use super::plain;

/// Corners that accessors may give beyond their own bytes by being shared: each reference copies
/// them.
const MOST_CORNERS_PER_BYTE: u64 = 64;
const CORNERS_ALWAYS: u64 = 1 << 24;

/// Refuses a small file that unfolds to a huge one by naming one accessor from very many
/// primitives.
pub(super) fn check(document: &Document, placed: &Placed, allowance: &Allowance) -> Read<()> {
    let bytes = document.buffers.total_bytes();
    let most = (bytes.saturating_mul(MOST_CORNERS_PER_BYTE)).max(CORNERS_ALWAYS);
    let (mut corners, mut sparse) = (0u64, 0u64);
    let meshes = document.root.meshes.iter().enumerate();
    for (at, mesh) in meshes.filter(|&(at, _)| placed.mesh_used[at]) {
        for primitive in &mesh.primitives {
            let of_primitive = Counts::of(document, primitive);
            corners = corners.saturating_add(of_primitive.corners);
            sparse = sparse.saturating_add(of_primitive.sparse);
        }
        if corners.saturating_add(sparse) > most {
            let expected = format!("{most} corners at most from {bytes} bytes of buffers");
            let found = corners.saturating_add(sparse);
            return Err(malformed(format!("meshes[{at}]"), expected, found));
        }
    }
    // Sparse elements are held in memory wherever they are named.
    allowance.take(sparse.saturating_mul(SPARSE_BYTES), "accessors, sparse")
}

/// Memory of a sparse element, its index and four floats.
const SPARSE_BYTES: u64 = 20;

/// Counts that the accessors of a primitive claim.
struct Counts {
    corners: u64,
    vertices: u64,
    /// Sparse elements of all of them.
    sparse: u64,
}

impl Counts {
    fn of(document: &Document, primitive: &Primitive) -> Self {
        let accessor = |index: usize| document.root.accessors.get(index);
        let count = |index: usize| accessor(index).map_or(0, |it| it.count.0);
        let sparse = |index: usize| {
            let sparse = accessor(index).and_then(|it| it.sparse.as_ref());
            sparse.map_or(0, |it| it.count.0)
        };
        let attributes = || primitive.attributes.values().map(|index| index.value());
        let indices = primitive.indices.map(|index| index.value());
        let vertices = attributes().next().map_or(0, count);
        let named = attributes().chain(indices);
        Self {
            corners: indices.map_or(vertices, count),
            vertices,
            sparse: named.map(sparse).fold(0, u64::saturating_add),
        }
    }
}

/// Memory that a mesh takes at most where it is loaded.
#[derive(Clone, Copy, Default)]
pub(super) struct Need {
    /// Of its arrays, with all attributes.
    pub(super) array_bytes: u64,
    /// Of the making of its normals, beside them.
    pub(super) making_bytes: u64,
}

impl Need {
    /// Of `meshes[index]`.
    pub(super) fn of(document: &Document, index: usize) -> Self {
        let present = Present {
            normals: true,
            uvs: true,
            colors: true,
        };
        let mut all = Self::default();
        for primitive in &document.root.meshes[index].primitives {
            let counts = Counts::of(document, primitive);
            let is_list = primitive.mode == Checked::Valid(Mode::Triangles);
            let triangles = counts.corners / if is_list { 3 } else { 1 };
            let vertices = counts.vertices.min(counts.corners);
            let has_normals = primitive
                .attributes
                .contains_key(&Checked::Valid(Semantic::Normals));
            let making = match has_normals {
                // Those of no length are made anew.
                true => plain::completing_bytes(vertices, 0),
                false => plain::completing_bytes(vertices, triangles),
            };
            let arrays = array_bytes(vertices, triangles, present);
            all.array_bytes = all.array_bytes.saturating_add(arrays);
            all.making_bytes = all.making_bytes.saturating_add(making);
        }
        all
    }
}
