//! Plain scene: one mesh, which is all that `.obj`, `.ply` and `.stl` hold, told from a point near
//! it where it lies far from the origin.
//!
//! These formats name neither a unit nor an up axis: coordinates are taken as they stand, in metres
//! and +Y up. A mesh has the surface that its program shows for want of another: white and rough,
//! not glTF's metal. No side of a triangle is the outer one: both are drawn.

use super::error::{Read, malformed};
use super::opened::{OpenedMesh, OpenedScene};
use super::origin::Origin;
use super::scene::{Image, Instance, Material, Mesh};
use super::warnings::Warnings;
use super::{complete, normals};

/// The surface of a mesh without one.
pub(super) fn material() -> Material {
    Material {
        metallic: 0.0,
        double_sided: true,
        ..Material::default()
    }
}

/// The scene of `mesh`, of nothing where it is `None`. Its `material_slots` are indices into `materials`.
pub(super) fn scene(
    name: &str,
    mesh: Option<(OpenedMesh, Origin)>,
    materials: Vec<Material>,
    images: Vec<Image>,
    source_triangles: u64,
    mut warnings: Warnings,
) -> OpenedScene {
    let Some((mesh, origin)) = mesh else {
        warnings.add("meshes without triangles left out", 1, "file");
        return OpenedScene {
            name: name.to_owned(),
            source_triangles,
            warnings: warnings.into_lines(),
            ..OpenedScene::default()
        };
    };
    OpenedScene {
        name: name.to_owned(),
        meshes: vec![mesh],
        instances: vec![Instance {
            mesh: 0,
            world_from_object: origin.placement(),
        }],
        materials,
        images,
        warnings: warnings.into_lines(),
        source_triangles,
    }
}

/// Makes the normals of a mesh without any, or mends those of no length.
pub(super) fn complete_normals(mesh: &mut Mesh, warnings: &mut Warnings) {
    let all = 0..mesh.triangles.len();
    match mesh.normals.take() {
        Some(given) => complete::complete(mesh, given, &[], "file", warnings),
        None => complete::complete(mesh, vec![], &[all], "file", warnings),
    }
}

/// Drops triangles that repeat an index, as many as are said.
pub(super) fn drop_repeated(triangles: &mut Vec<[u32; 3]>, place: &str, warnings: &mut Warnings) {
    let listed = triangles.len();
    triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    let repeated = (listed - triangles.len()) as u64;
    warnings.add("triangles with a repeated index left out", repeated, place);
}

/// Corners of a loaded mesh are counted in 32 bits.
pub(super) fn check_triangle_count(count: u64, place: &str) -> Read<()> {
    const MOST: u64 = u32::MAX as u64 / 3;
    match count <= MOST {
        true => Ok(()),
        false => {
            let expected = format!("{MOST} triangles at most in a mesh");
            Err(malformed(place, expected, count))
        }
    }
}

/// Triangles or lines between two looks at the memory that they take.
pub(super) const BETWEEN_LOOKS: usize = 1 << 12;

/// Bytes that a mesh of a text takes while it is completed, beside what was read of it: its arrays,
/// the faces around each position, and normals (measured: `server/tests/import_bombs.rs`).
pub(super) fn completing_bytes(vertices: u64, triangles: u64) -> u64 {
    const VERTEX_BYTES: u64 = 96;
    const TRIANGLE_BYTES: u64 = 112;
    let vertices = vertices.saturating_mul(VERTEX_BYTES);
    vertices.saturating_add(triangles.saturating_mul(TRIANGLE_BYTES))
}

/// Bytes of a hash table from positions or corners to numbers.
pub(super) fn table_bytes(capacity: usize) -> u64 {
    const ENTRY_BYTES: u64 = 17;
    // One place in eight stays free.
    capacity as u64 * ENTRY_BYTES * 8 / 7
}

/// Drops vertices that no triangle uses, where there are any; the others keep their order.
pub(super) fn drop_unused(mesh: &mut Mesh) {
    let mut in_use = vec![false; mesh.positions.len()];
    for &corner in mesh.triangles.iter().flatten() {
        in_use[corner as usize] = true;
    }
    if in_use.iter().all(|&it| it) {
        return;
    }
    let mut number = vec![0; in_use.len()];
    let mut sources = Vec::new();
    for vertex in (0..in_use.len()).filter(|&vertex| in_use[vertex]) {
        number[vertex] = sources.len() as u32;
        sources.push(vertex as u32);
    }
    normals::gather(mesh, &sources);
    mesh.normals = mesh
        .normals
        .take()
        .map(|normals| sources.iter().map(|&at| normals[at as usize]).collect());
    for corner in mesh.triangles.iter_mut().flatten() {
        *corner = number[*corner as usize];
    }
}
