//! Spheres and errors that only grow toward the root, so that one predicate picks exactly one cut.

use lodestream_format::Sphere;
use lodestream_format::bounds::round_up;
use lodestream_format::hierarchy::ROOT_ERROR;

use super::dag::Cluster;
use super::quantize::{QuantizedMesh, Triangle};
use super::simplify::Simplified;

/// Sphere around triangles, local metres.
pub(super) fn around(mesh: &QuantizedMesh, triangles: &[Triangle]) -> Sphere {
    let mut vertices: Vec<u32> = triangles
        .iter()
        .flat_map(|triangle| triangle.vertices)
        .collect();
    vertices.sort_unstable();
    vertices.dedup();
    Sphere::around(vertices.iter().map(|&vertex| mesh.local_metres(vertex)))
}

/// The lod sphere of a group: around the lod spheres that its clusters were born with, which hold their geometry.
pub(super) fn lod_sphere<'a>(members: impl Iterator<Item = &'a Cluster>) -> Sphere {
    let mut spheres: Vec<Sphere> = members.map(|cluster| cluster.lod_sphere).collect();
    // Clusters of one finer group were born with one sphere.
    spheres.sort_unstable_by_key(key);
    spheres.dedup();
    Sphere::enclosing(&spheres)
}

fn key(sphere: &Sphere) -> [u32; 4] {
    let [x, y, z] = sphere.center.map(f32::to_bits);
    [x, y, z, sphere.radius.to_bits()]
}

/// Largest error of a group's clusters, metres.
pub(super) fn largest_error<'a>(members: impl Iterator<Item = &'a Cluster>) -> f32 {
    members
        .map(|cluster| cluster.error_metres)
        .fold(0.0, f32::max)
}

/// Error of a group's replacement, metres. By the triangle inequality the distance to the source is at most the members'
/// own distance plus that of this step; the simplifier's error, which weighs attributes in, may be larger still. Nothing
/// is farther off than the lod sphere is wide, which holds both surfaces and only grows toward the root.
pub(super) fn parent_error(
    members_error: f32,
    simplified: &Simplified,
    lod_sphere: &Sphere,
) -> f32 {
    let surface = members_error as f64 + simplified.distance_metres;
    let error = surface.max(simplified.weighed_error_metres);
    // Below the root's, whatever the size of the mesh.
    round_up(error.min(2.0 * lod_sphere.radius as f64)).min(ROOT_ERROR / 2.0)
}
