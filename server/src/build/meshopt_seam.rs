//! The call of meshoptimizer (Kapoulkine, <https://github.com/zeux/meshoptimizer>), behind a function that checks what its
//! safe binding does not: that the counts add up and that indices lie inside the arrays.

use meshopt::VertexDataAdapter;

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
