// Counts to arguments of the next indirect command; one thread each.
#import view

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read_write> counters: Counters;
@group(0) @binding(2) var<storage, read_write> args: IndirectArgs;

// Threads that `cull_nodes` gives an item: one a child.
const NODE_THREADS: u32 = 8u;
// Vertices that `raster` draws an instance of: three a triangle of the largest cluster.
const RASTER_VERTICES: u32 = 384u;

// Workgroups along x and y for `items`, where a workgroup takes `items_a_workgroup`.
fn workgroups(items: u32, items_a_workgroup: u32) -> vec2<u32> {
    let count = items / items_a_workgroup + select(0u, 1u, items % items_a_workgroup != 0u);
    let x = min(count, MAX_WORKGROUPS_X);
    let y = count / MAX_WORKGROUPS_X + select(0u, 1u, count % MAX_WORKGROUPS_X != 0u);
    return vec2<u32>(x, y);
}

@compute @workgroup_size(1)
fn prepare_nodes() {
    let appended = atomicExchange(&counters.next_node_count, 0u);
    let count = min(appended, view.node_capacity);
    counters.node_half = 1u - counters.node_half;
    atomicStore(&counters.node_count, count);
    atomicMax(&counters.node_count_max, appended);
    let size = workgroups(count, WORKGROUP_THREADS / NODE_THREADS);
    args.nodes_x = size.x;
    args.nodes_y = size.y;
    args.nodes_z = 1u;
}

@compute @workgroup_size(1)
fn prepare_rejected() {
    let count = min(atomicLoad(&counters.rejected_nodes), view.node_capacity);
    let size = workgroups(count, WORKGROUP_THREADS);
    args.nodes_x = size.x;
    args.nodes_y = size.y;
    args.nodes_z = 1u;
}

// The candidates since the last call. Where the early pass rejected some, all of them: the others
// are marked as decided.
@compute @workgroup_size(1)
fn prepare_clusters() {
    let has_rejected = atomicLoad(&counters.rejected_clusters) != 0u;
    counters.first_candidate = select(counters.last_candidate, 0u, has_rejected);
    counters.last_candidate = min(atomicLoad(&counters.candidate_count), view.cluster_capacity);
    let size = workgroups(counters.last_candidate - counters.first_candidate, WORKGROUP_THREADS);
    args.clusters_x = size.x;
    args.clusters_y = size.y;
    args.clusters_z = 1u;
}

// The visible clusters since the last call.
@compute @workgroup_size(1)
fn prepare_raster() {
    let points = min(atomicLoad(&counters.point_count), view.cluster_capacity);
    counters.drawn_count = min(atomicLoad(&counters.visible_count), view.cluster_capacity - points);
    if counters.draws == 0u {
        counters.early_count = counters.drawn_count;
    }
    counters.draws += 1u;
    args.first_hardware = counters.hardware_drawn;
    counters.hardware_drawn = atomicLoad(&counters.hardware_count);
    args.raster_vertices = RASTER_VERTICES;
    args.raster_instances = counters.hardware_drawn - args.first_hardware;
    args.raster_first_vertex = 0u;
    args.raster_first_instance = 0u;
    args.first_compute = counters.compute_drawn;
    counters.compute_drawn = atomicLoad(&counters.compute_count);
    args.compute_count = counters.compute_drawn - args.first_compute;
    let size = workgroups(args.compute_count, 1u);
    args.compute_x = size.x;
    args.compute_y = size.y;
    args.compute_z = 1u;
}
