// Instances in the frustum to root nodes, a thread an instance.
#import view
#import scene

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> scene: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> instances: array<InstanceRecord>;
@group(0) @binding(3) var<storage, read_write> counters: Counters;
@group(0) @binding(4) var<storage, read_write> node_queues: array<NodeItem>;

@compute @workgroup_size(64)
fn cull_instances(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let index = thread_index(workgroup, local);
    if index >= view.instance_count {
        return;
    }
    let instance = instances[index];
    let asset = load_asset(instance.asset);
    if !is_reference(view) && !aabb_in_frustum(instance, view, asset.aabb_min, asset.aabb_max, NODE_SLACK) {
        return;
    }
    atomicAdd(&counters.instances_drawn, 1u);
    let place = atomicAdd(&counters.next_node_count, 1u);
    if place < view.node_capacity {
        node_queues[node_out(counters.node_half, place)] = NodeItem(index, 0u);
    }
}
