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

/// Arguments of `cull_rejected`.
pub fn prepare_rejected(view: &View, counters: &Counters, args: &mut IndirectArgs) {
    let count = counters.rejected_nodes.min(view.node_capacity);
    args.nodes = workgroups(count, WORKGROUP_THREADS);
}

/// Arguments of `cull_clusters`: the candidates since the last call. Where the early pass rejected
/// some, all of them: the others are marked as decided.
pub fn prepare_clusters(view: &View, counters: &mut Counters, args: &mut IndirectArgs) {
    counters.first_candidate = match counters.rejected_clusters {
        0 => counters.last_candidate,
        _ => 0,
    };
    counters.last_candidate = counters.candidate_count.min(view.cluster_capacity);
    let count = counters.last_candidate - counters.first_candidate;
    args.clusters = workgroups(count, WORKGROUP_THREADS);
}

/// Arguments of `raster` and `raster_compute`: the visible clusters since the last call.
pub fn prepare_raster(view: &View, counters: &mut Counters, args: &mut IndirectArgs) {
    counters.drawn_count = visible_room(view, counters).min(counters.visible_count);
    if counters.draws == 0 {
        counters.early_count = counters.drawn_count;
    }
    counters.draws += 1;
    args.first_hardware = std::mem::replace(&mut counters.hardware_drawn, counters.hardware_count);
    let hardware = counters.hardware_drawn - args.first_hardware;
    args.raster = [RASTER_VERTICES, hardware, 0, 0];
    args.first_compute = std::mem::replace(&mut counters.compute_drawn, counters.compute_count);
    args.compute_count = counters.compute_drawn - args.first_compute;
    args.compute = workgroups(args.compute_count, 1);
}

/// Visible clusters that fit before the points.
pub fn visible_room(view: &View, counters: &Counters) -> u32 {
    view.cluster_capacity - counters.point_count.min(view.cluster_capacity)
}
