//! Every call of meshoptimizer (Kapoulkine, <https://github.com/zeux/meshoptimizer>), behind functions that check what
//! its safe bindings do not: the lengths of attribute and lock arrays, and that indices lie inside them.

use lodestream_format::limits::{MAX_CLUSTER_TRIANGLES, MAX_CLUSTER_VERTICES};
use meshopt::{SimplifyOptions, SimplifyVertex, VertexDataAdapter};

/// Clusters of fewer triangles are made only where the vertex limit or loose parts force them.
const MIN_CLUSTER_TRIANGLES: usize = 32;
/// Trades surface area of a cluster for fullness; meshoptimizer's advice.
const CLUSTER_FILL_WEIGHT: f32 = 0.5;

/// Per-vertex rule of [`simplify`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum VertexRule {
    /// May move freely.
    Free,
    /// Stays where it is.
    Lock,
    /// Moves only along the seam it lies on.
    KeepSeam,
}

/// What [`simplify`] reads: arrays over the same vertices.
pub(super) struct SimplifyInput<'a> {
    pub positions: &'a [[f32; 3]],
    /// `weights.len()` numbers a vertex.
    pub attributes: &'a [f32],
    /// Lengths that a unit of each attribute stands for, relative to the extent of the positions.
    pub weights: &'a [f32],
    pub rules: &'a [VertexRule],
    pub triangles: &'a [[u32; 3]],
}

/// Edge collapses down to `target_triangles`, or as far as the rules allow. Gives triangles over the same vertices and
/// the error in units of the positions, attributes weighed in. `prune` also drops small loose parts.
pub(super) fn simplify(
    input: &SimplifyInput,
    target_triangles: usize,
    prune: bool,
) -> (Vec<[u32; 3]>, f64) {
    let vertices = input.positions.len();
    assert_eq!(
        input.attributes.len(),
        vertices * input.weights.len(),
        "attributes of every vertex"
    );
    assert_eq!(input.rules.len(), vertices, "a rule for every vertex");
    assert_inside(input.triangles, vertices);
    let locks: Vec<SimplifyVertex> = input
        .rules
        .iter()
        .map(|rule| match rule {
            VertexRule::Free => SimplifyVertex::None,
            VertexRule::Lock => SimplifyVertex::Lock,
            VertexRule::KeepSeam => SimplifyVertex::Protect,
        })
        .collect();
    let mut options = SimplifyOptions::ErrorAbsolute
        | SimplifyOptions::ErrorClamped
        | SimplifyOptions::Permissive;
    if prune {
        options |= SimplifyOptions::Prune;
    }
    let mut error = 0.0;
    let indices = meshopt::simplify_with_attributes_and_locks(
        input.triangles.as_flattened(),
        &adapter(input.positions),
        input.attributes,
        input.weights,
        size_of_val(input.weights),
        &locks,
        3 * target_triangles.min(input.triangles.len()),
        f32::MAX,
        options,
        Some(&mut error),
    );
    (triples(&indices), error as f64)
}

/// Splits triangles into clusters of at most 128 triangles and 256 vertices by surface area.
pub(super) fn clusterize(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<Vec<[u32; 3]>> {
    assert_inside(triangles, positions.len());
    let meshlets = meshopt::build_meshlets_spatial(
        triangles.as_flattened(),
        &adapter(positions),
        MAX_CLUSTER_VERTICES,
        MIN_CLUSTER_TRIANGLES,
        MAX_CLUSTER_TRIANGLES,
        CLUSTER_FILL_WEIGHT,
    );
    meshlets
        .iter()
        .map(|meshlet| {
            meshlet
                .triangles
                .chunks_exact(3)
                .map(|corners| {
                    std::array::from_fn(|corner| meshlet.vertices[corners[corner] as usize])
                })
                .collect()
        })
        .collect()
}

/// Assigns a partition to every cluster, about `target` clusters each and at most a third more: clusters that share
/// many vertices first, then near ones. `indices` holds the vertices of cluster after cluster, `counts` how many each has.
pub(super) fn partition(
    indices: &[u32],
    counts: &[u32],
    positions: &[[f32; 3]],
    target: usize,
) -> Vec<u32> {
    let total: usize = counts.iter().map(|&count| count as usize).sum();
    assert_eq!(indices.len(), total, "indices of every cluster");
    assert!(counts.iter().all(|&count| count > 0), "no empty cluster");
    assert!(
        indices
            .iter()
            .all(|&index| (index as usize) < positions.len()),
        "indices inside the positions"
    );
    let mut partitions = vec![0; counts.len()];
    meshopt::partition_clusters_with_positions(
        &mut partitions,
        indices,
        counts,
        &adapter(positions),
        target,
    );
    partitions
}

fn adapter(positions: &[[f32; 3]]) -> VertexDataAdapter<'_> {
    VertexDataAdapter::new(bytemuck::cast_slice(positions), size_of::<[f32; 3]>(), 0)
        .expect("twelve bytes a position")
}

fn assert_inside(triangles: &[[u32; 3]], vertices: usize) {
    let largest = triangles.as_flattened().iter().max();
    assert!(
        largest.is_none_or(|&index| (index as usize) < vertices),
        "triangle indices inside the vertices"
    );
}

fn triples(indices: &[u32]) -> Vec<[u32; 3]> {
    indices.as_chunks::<3>().0.to_vec()
}
