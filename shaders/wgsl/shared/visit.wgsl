// A child of a hierarchy node, with the tests that decide about it: frustum, occlusion, pixel
// error. Needs the bindings of `cull_nodes`.
#import refine
#import node_queues
#import occlusion
#import hzb

const HIERARCHY_WIDTH: u32 = 8u;
const LEAF_FLAG: u32 = 0x80000000u;
const NO_CHILD: u32 = 0xffffffffu;
// Words of a page in `page_priority`.
const REQUEST_WORDS: u32 = 3u;

// Asks for every page of a group, installed or not: what is installed stays fresh. Three words a
// page: the largest error of any visible group, the sum of all their errors, over all instances,
// and the largest error of any hidden group.
//
// The sum saturates, and is the same in any order of the additions. One that wraps is followed by
// its own maximum. After the last of these no addition can come, since it would wrap; so the word
// ends at its maximum just where the true sum exceeds it. Where none wraps, the word is the true
// sum.
fn request_pages(group: Group, page_base: u32, error_bits: u32, units: u32, hidden: bool) {
    for (var part = 0u; part < group.part_count; part++) {
        let word = REQUEST_WORDS * (page_base + group.first_page + part);
        if hidden {
            atomicMax(&page_priority[word + 2u], error_bits);
            continue;
        }
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

fn visit_group(group: Group, asset: AssetRecord, instance_index: u32, instance: InstanceRecord, hidden: bool) {
    let error = group.parent_error_metres;
    let exact_px = group_projected_px(group, instance, f32(group.level));
    if error_wanted(view, error, exact_px) {
        let units = priority_units(error, exact_px, view.size_px);
        request_pages(group, asset.page_base, request_bits(error, exact_px), units, hidden);
    }
    // `cull_clusters` decides for itself, about the group and about the one below by the same code,
    // so that two compilations of one formula cannot disagree; here a level's slack more lets
    // nothing through too little.
    let loose_px = group_projected_px(group, instance, f32(group.level + 1u));
    if !hidden && error_wanted(view, error, loose_px) && group_installed(group, asset.page_base) {
        append_candidates(group, asset, instance_index);
    }
}

// `code` names the child as a rejected item does.
fn visit_child(instance_index: u32, code: u32, parent_hidden: bool) {
    let instance = instances[instance_index];
    let asset = load_asset(instance.asset);
    let child = load_child(asset.node_base + code / HIERARCHY_WIDTH, code % HIERARCHY_WIDTH);
    if child.reference == NO_CHILD {
        return;
    }
    let is_group = (child.reference & LEAF_FLAG) != 0u;
    let slack = select(NODE_SLACK, GROUP_SLACK, is_group);
    if !is_reference(view) && !aabb_in_frustum(instance, view, child.aabb_min, child.aabb_max, slack) {
        return;
    }
    let error = child.max_parent_error_metres;
    if !is_group {
        let projected_px = projected_error_px(view, instance, child.lod_center, child.lod_radius, error, NODE_LEVEL);
        if !error_wanted(view, error, projected_px) {
            return;
        }
    }
    var hidden = parent_hidden;
    if !hidden && tests_occlusion() && is_hidden(instance, child.aabb_min, child.aabb_max) {
        if is_late() {
            atomicAdd(&counters.hidden_nodes, 1u);
            hidden = true;
        } else if reject_node(NodeItem(instance_index, code)) {
            return;
        }
    }
    if is_group {
        let group = load_group(asset.group_base + (child.reference & ~LEAF_FLAG));
        visit_group(group, asset, instance_index, instance, hidden);
        return;
    }
    append_node(NodeItem(instance_index, child.reference | select(0u, HIDDEN_FLAG, hidden)));
}
