// One level of hierarchy nodes to the next level, to candidates and to streaming requests, a thread
// a child; and in the late pass, first, the rejects of the early pass.
#import visit

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> occluder: View;
@group(0) @binding(2) var<storage, read> scene: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> instances: array<InstanceRecord>;
@group(0) @binding(4) var<storage, read> page_table: array<u32>;
@group(0) @binding(5) var<storage, read> hzb: array<u32>;
@group(0) @binding(6) var<storage, read_write> page_priority: array<atomic<u32>>;
@group(0) @binding(7) var<storage, read_write> counters: Counters;
@group(0) @binding(8) var<storage, read_write> node_queues: array<NodeItem>;
@group(0) @binding(9) var<storage, read_write> clusters: array<ClusterItem>;

@compute @workgroup_size(64)
fn cull_nodes(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let thread = thread_index(workgroup, local);
    let index = thread / HIERARCHY_WIDTH;
    if index >= atomicLoad(&counters.node_count) {
        return;
    }
    let item = node_queues[counters.node_half * view.node_capacity + index];
    if thread % HIERARCHY_WIDTH == 0u {
        atomicAdd(&counters.nodes_visited, 1u);
    }
    let node = item.node & ~HIDDEN_FLAG;
    visit_child(item.instance, node * HIERARCHY_WIDTH + thread % HIERARCHY_WIDTH, item.node != node);
}

// Instances and children of nodes that the early pass rejected, tested once more, a thread an item.
@compute @workgroup_size(64)
fn cull_rejected(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let index = thread_index(workgroup, local);
    if index >= min(atomicLoad(&counters.rejected_nodes), view.node_capacity) {
        return;
    }
    let item = node_queues[2u * view.node_capacity + index];
    if item.node != WHOLE_INSTANCE {
        visit_child(item.instance, item.node, false);
        return;
    }
    let instance = instances[item.instance];
    let asset = load_asset(instance.asset);
    if is_hidden(instance, asset.aabb_min, asset.aabb_max) {
        atomicAdd(&counters.hidden_instances, 1u);
        append_node(NodeItem(item.instance, HIDDEN_FLAG));
        return;
    }
    atomicAdd(&counters.instances_drawn, 1u);
    append_node(NodeItem(item.instance, 0u));
}
