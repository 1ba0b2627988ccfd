//! Sharing: what the counts of accessors come to, told before any element is read. Each reference
//! to an accessor copies it, so a small file may unfold to a huge one.

use super::Document;
use super::allowance::Allowance;
use super::attributes::{Present, Shading};
use super::document::{Primitive, Tolerant};
use super::error::{Read, malformed};
use super::nodes::Placed;
use super::opened::array_bytes;
use super::plain;
use super::pose::{Pose, PoseSource};
use super::primitive::Mode;

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
    for shape in &placed.shapes {
        let at = shape.mesh;
        for primitive in &document.root.meshes[at].primitives {
            let of_primitive = Counts::of(document, primitive, shape.pose.as_deref());
            // One more: primitives without corners take time in each pose of their mesh.
            corners = corners.saturating_add(of_primitive.corners.saturating_add(1));
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
    /// Once for the primitive, once for each accessor that deforms it.
    corners: u64,
    vertices: u64,
    /// Sparse elements of all of them.
    sparse: u64,
}

impl Counts {
    fn of(document: &Document, primitive: &Primitive, pose: Option<&Pose>) -> Self {
        let accessors = &document.root.accessors;
        let accessor = |index: usize| accessors.get(index).and_then(Tolerant::read);
        let count = |index: usize| accessor(index).map_or(0, |it| it.claimed_count());
        let sparse = |index: usize| accessor(index).map_or(0, |it| it.claimed_sparse_count());
        let attributes = primitive.attributes.0.values().map(|index| index.value());
        let indices = primitive.indices.map(|index| index.value());
        let vertices = primitive.attributes.find("POSITION").map_or(0, count);
        let deforming = pose.map(|pose| PoseSource::accessors(primitive, pose));
        let deforming = deforming.unwrap_or_default();
        let times = 1 + deforming.len() as u64;
        let named = attributes.chain(indices).chain(deforming);
        Self {
            corners: indices.map_or(vertices, count).saturating_mul(times),
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
            let counts = Counts::of(document, primitive, None);
            let is_list = Mode::of(primitive) == Some(Ok(Mode::Triangles));
            let triangles = counts.corners / if is_list { 3 } else { 1 };
            let vertices = counts.vertices.min(counts.corners);
            let normals = primitive.attributes.find("NORMAL");
            let has_normals =
                normals.is_some_and(|it| Shading::Normal.open(document, it, "").is_ok());
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
