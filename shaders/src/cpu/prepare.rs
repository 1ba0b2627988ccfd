//! Twin of `wgsl/prepare.wgsl`.

use lodestream_format::limits::{HIERARCHY_WIDTH, MAX_CLUSTER_TRIANGLES};

use super::view::{WORKGROUP_THREADS, workgroups};
use crate::types::{Counters, IndirectArgs, View};

/// Threads that `cull_nodes` gives an item: one a child.
pub const NODE_THREADS: u32 = HIERARCHY_WIDTH as u32;
/// Vertices that `raster` draws an instance of: three a triangle of the largest cluster.
pub const RASTER_VERTICES: u32 = 3 * MAX_CLUSTER_TRIANGLES as u32;

/// The next level's count becomes this level's.
pub fn prepare_nodes(view: &View, counters: &mut Counters, args: &mut IndirectArgs) {
    let appended = std::mem::take(&mut counters.next_node_count);
    counters.node_half = 1 - counters.node_half;
    counters.node_count = appended.min(view.node_capacity);
    counters.node_count_max = counters.node_count_max.max(appended);
    args.nodes = workgroups(counters.node_count, WORKGROUP_THREADS / NODE_THREADS);
}

/// Arguments of `cull_clusters`.
pub fn prepare_clusters(view: &View, counters: &Counters, args: &mut IndirectArgs) {
    let count = counters.candidate_count.min(view.cluster_capacity);
    args.clusters = workgroups(count, WORKGROUP_THREADS);
}

/// Arguments of `raster`.
pub fn prepare_raster(view: &View, counters: &Counters, args: &mut IndirectArgs) {
    let count = counters.visible_count.min(view.cluster_capacity);
    args.raster = [RASTER_VERTICES, count, 0, 0];
}
