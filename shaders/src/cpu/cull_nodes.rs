//! Twin of `wgsl/cull_nodes.wgsl`.

use lodestream_format::hierarchy::{Child, Group, LEAF_FLAG, NO_CHILD};

use super::append;
use super::error_metric::{
    NODE_LEVEL, RequestWords, add_request, error_wanted, group_installed, group_projected_px,
    priority_units, projected_error_px, request_bits,
};
use super::view::{GROUP_SLACK, NODE_SLACK, aabb_in_frustum};
use crate::arrays::SceneArrays;
use crate::types::{ClusterItem, Counters, NodeItem, View};

/// What one level of nodes leaves behind.
#[derive(Debug)]
pub struct NodeOutput<'a> {
    /// The next level's nodes.
    pub node_queue_out: &'a mut Vec<NodeItem>,
    /// Clusters of the groups that may refine.
    pub candidates: &'a mut Vec<ClusterItem>,
    /// Requests for each page of the scene.
    pub page_priority: &'a mut [RequestWords],
    /// The frame's counters.
    pub counters: &'a mut Counters,
}

/// One level of hierarchy nodes to the next level, to candidates and to streaming requests.
pub fn cull_nodes(
    arrays: &SceneArrays,
    view: &View,
    page_table: &[u32],
    node_queue_in: &[NodeItem],
    output: &mut NodeOutput,
) {
    for item in node_queue_in {
        output.counters.nodes_visited += 1;
        let asset = &arrays.assets[arrays.instances[item.instance as usize].asset as usize];
        let node = &arrays.nodes[(asset.node_base + item.node) as usize];
        for child in &node.children {
            visit_child(arrays, view, page_table, item.instance, child, output);
        }
    }
}

fn visit_child(
    arrays: &SceneArrays,
    view: &View,
    page_table: &[u32],
    instance_index: u32,
    child: &Child,
    output: &mut NodeOutput,
) {
    if child.reference == NO_CHILD {
        return;
    }
    let instance = &arrays.instances[instance_index as usize];
    let is_group = child.reference & LEAF_FLAG != 0;
    let slack = if is_group { GROUP_SLACK } else { NODE_SLACK };
    if !view.is_reference()
        && !aabb_in_frustum(instance, view, child.aabb_min, child.aabb_max, slack)
    {
        return;
    }
    if is_group {
        let asset = &arrays.assets[instance.asset as usize];
        let number = asset.group_base + (child.reference & !LEAF_FLAG);
        let group = &arrays.groups[number as usize];
        visit_group(arrays, view, page_table, instance_index, group, output);
        return;
    }
    let error = child.max_parent_error_metres;
    let projected_px = projected_error_px(view, instance, child.lod_sphere(), error, NODE_LEVEL);
    if error_wanted(view, error, projected_px) {
        let item = NodeItem {
            instance: instance_index,
            node: child.reference,
        };
        append(
            output.node_queue_out,
            item,
            &mut output.counters.next_node_count,
            view.node_capacity,
        );
    }
}

fn visit_group(
    arrays: &SceneArrays,
    view: &View,
    page_table: &[u32],
    instance_index: u32,
    group: &Group,
    output: &mut NodeOutput,
) {
    let instance = &arrays.instances[instance_index as usize];
    let asset = &arrays.assets[instance.asset as usize];
    let error = group.parent_error_metres;
    let exact_px = group_projected_px(view, group, instance, group.level as f32);
    if error_wanted(view, error, exact_px) {
        let bits = request_bits(error, exact_px);
        let units = priority_units(error, exact_px, view.size_px);
        for page in group.pages() {
            let words = &mut output.page_priority[(asset.page_base + page) as usize];
            add_request(words, bits, units);
        }
    }
    let loose_px = group_projected_px(view, group, instance, (group.level + 1) as f32);
    if !error_wanted(view, error, loose_px) || !group_installed(page_table, group, asset.page_base)
    {
        return;
    }
    for (part, page) in group.pages().enumerate() {
        let page = asset.page_base + page;
        let range = arrays.parts[(asset.part_base + group.first_part) as usize + part];
        for cluster in 0..range.cluster_count {
            let item = ClusterItem {
                instance: instance_index,
                page,
                cluster: range.first_cluster + cluster,
                page_word: page_table[page as usize],
            };
            append(
                output.candidates,
                item,
                &mut output.counters.candidate_count,
                view.cluster_capacity,
            );
        }
    }
}
