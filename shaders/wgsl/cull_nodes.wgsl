// One level of hierarchy nodes to the next level, to candidates and to streaming requests, a thread a child.
#import refine

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> scene: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> instances: array<InstanceRecord>;
@group(0) @binding(3) var<storage, read> page_table: array<u32>;
@group(0) @binding(4) var<storage, read_write> page_priority: array<atomic<u32>>;
@group(0) @binding(5) var<storage, read_write> counters: Counters;
@group(0) @binding(6) var<storage, read_write> node_queues: array<NodeItem>;
@group(0) @binding(7) var<storage, read_write> clusters: array<ClusterItem>;

const HIERARCHY_WIDTH: u32 = 8u;
const LEAF_FLAG: u32 = 0x80000000u;
const NO_CHILD: u32 = 0xffffffffu;

// Asks for every page of a group, installed or not: what is installed stays fresh. Two words a
// page: the largest error of any group, and the sum of all errors, over all instances.
//
// The sum saturates, and is the same in any order of the additions. One that wraps is followed by
// its own maximum. After the last of these no addition can come, since it would wrap; so the word
// ends at its maximum just where the true sum exceeds it. Where none wraps, the word is the true
// sum.
fn request_pages(group: Group, page_base: u32, error_bits: u32, units: u32) {
    for (var part = 0u; part < group.part_count; part++) {
        let word = 2u * (page_base + group.first_page + part);
        atomicMax(&page_priority[word], error_bits);
        if atomicAdd(&page_priority[word + 1u], units) > MOST_PRIORITY - units {
            atomicMax(&page_priority[word + 1u], MOST_PRIORITY);
        }
    }
}

fn append_candidates(group: Group, asset: AssetRecord, instance: u32) {
    var place = atomicAdd(&counters.candidate_count, group.cluster_count);
    for (var part = 0u; part < group.part_count; part++) {
        let page = asset.page_base + group.first_page + part;
        let page_word = page_table[page];
        let range = load_part(asset.part_base + group.first_part + part);
        for (var cluster = 0u; cluster < range.cluster_count; cluster++) {
            if place < view.cluster_capacity {
                clusters[place] = ClusterItem(instance, page, range.first_cluster + cluster, page_word);
            }
            place++;
        }
    }
}

fn visit_group(group: Group, asset: AssetRecord, instance_index: u32, instance: InstanceRecord) {
    let error = group.parent_error_metres;
    let exact_px = group_projected_px(group, instance, f32(group.level));
    if error_wanted(view, error, exact_px) {
        let units = priority_units(error, exact_px, view.size_px);
        request_pages(group, asset.page_base, request_bits(error, exact_px), units);
    }
    // `cull_clusters` decides for itself, about the group and about the one below by the same code, so that two compilations
    // of one formula cannot disagree; here a level's slack more lets nothing through too little.
    let loose_px = group_projected_px(group, instance, f32(group.level + 1u));
    if error_wanted(view, error, loose_px) && group_installed(group, asset.page_base) {
        append_candidates(group, asset, instance_index);
    }
}

@compute @workgroup_size(64)
fn cull_nodes(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let thread = thread_index(workgroup, local);
    let item_index = thread / HIERARCHY_WIDTH;
    if item_index >= atomicLoad(&counters.node_count) {
        return;
    }
    let item = node_queues[counters.node_half * view.node_capacity + item_index];
    let instance = instances[item.instance];
    let asset = load_asset(instance.asset);
    if thread % HIERARCHY_WIDTH == 0u {
        atomicAdd(&counters.nodes_visited, 1u);
    }
    let child = load_child(asset.node_base + item.node, thread % HIERARCHY_WIDTH);
    if child.reference == NO_CHILD {
        return;
    }
    let is_group = (child.reference & LEAF_FLAG) != 0u;
    let slack = select(NODE_SLACK, GROUP_SLACK, is_group);
    if !is_reference(view) && !aabb_in_frustum(instance, view, child.aabb_min, child.aabb_max, slack) {
        return;
    }
    if is_group {
        let group = load_group(asset.group_base + (child.reference & ~LEAF_FLAG));
        visit_group(group, asset, item.instance, instance);
        return;
    }
    let error = child.max_parent_error_metres;
    let projected_px = projected_error_px(view, instance, child.lod_center, child.lod_radius, error, NODE_LEVEL);
    if error_wanted(view, error, projected_px) {
        let place = atomicAdd(&counters.next_node_count, 1u);
        if place < view.node_capacity {
            node_queues[node_out(counters.node_half, place)] = NodeItem(item.instance, child.reference);
        }
    }
}
