// Instances in the frustum to root nodes, or to points where they are too small, a thread an
// instance.
#import view
#import scene
#import node_queues
#import occlusion
#import hzb
#import proxy

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> occluder: View;
@group(0) @binding(2) var<storage, read> scene: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> instances: array<InstanceRecord>;
@group(0) @binding(4) var<storage, read> hzb: array<u32>;
@group(0) @binding(5) var<storage, read_write> counters: Counters;
@group(0) @binding(6) var<storage, read_write> node_queues: array<NodeItem>;
@group(0) @binding(7) var<storage, read_write> clusters: array<ClusterItem>;

// Of `InstanceRecord.asset`: nothing is here, or it is hidden.
const NO_ASSET: u32 = 0xffffffffu;

// Points lie at the end of the visible items, last first.
fn append_point(item: ClusterItem) {
    let place = atomicAdd(&counters.point_count, 1u);
    if place < view.cluster_capacity {
        clusters[2u * view.cluster_capacity - 1u - place] = item;
    }
}

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
    if instance.asset == NO_ASSET {
        return;
    }
    let asset = load_asset(instance.asset);
    if !is_reference(view) && !aabb_in_frustum(instance, view, asset.aabb_min, asset.aabb_max, NODE_SLACK) {
        return;
    }
    if draws_as_point(instance, asset) {
        let point = point_of(index, instance, asset);
        if point.drawn {
            append_point(point.item);
        }
        return;
    }
    var root = NodeItem(index, 0u);
    if tests_occlusion() && is_hidden(instance, asset.aabb_min, asset.aabb_max) {
        if is_late() {
            atomicAdd(&counters.hidden_instances, 1u);
            root.node = HIDDEN_FLAG;
        } else if reject_node(NodeItem(index, WHOLE_INSTANCE)) {
            return;
        }
    }
    if root.node == 0u {
        atomicAdd(&counters.instances_drawn, 1u);
    }
    append_node(root);
}
