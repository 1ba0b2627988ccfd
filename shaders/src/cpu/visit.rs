//! Twin of `wgsl/shared/visit.wgsl` and `wgsl/shared/node_queues.wgsl`: a child of a node with the
//! tests that decide about it.

use lodestream_format::hierarchy::{Group, LEAF_FLAG, NO_CHILD};
use lodestream_format::limits::HIERARCHY_WIDTH;

use super::append;
use super::error_metric::{
    NODE_LEVEL, RequestWords, add_hidden_request, add_request, error_wanted, group_installed,
    group_projected_px, priority_units, projected_error_px, request_bits,
};
use super::occlusion::Occluder;
use super::view::{GROUP_SLACK, NODE_SLACK, aabb_in_frustum};
use crate::arrays::SceneArrays;
use crate::types::{ClusterItem, Counters, NodeItem, View};

/// Of a queued node: it is hidden, and so is all below it.
pub const HIDDEN_FLAG: u32 = 1 << 31;
/// A rejected item whose instance was rejected whole; others name node * 8 + child.
pub const WHOLE_INSTANCE: u32 = u32::MAX;
/// Words of a page in `page_priority`.
pub const REQUEST_WORDS: usize = size_of::<RequestWords>() / 4;

/// The inputs of culling that stay the same through a pass.
#[derive(Debug, Clone, Copy)]
pub struct CullInput<'a> {
    /// The scene.
    pub arrays: &'a SceneArrays,
    /// The camera and the capacities.
    pub view: &'a View,
    /// A word a page: where its memory form begins in the pool, or `NOT_INSTALLED`.
    pub page_table: &'a [u32],
    /// The depths to test against, if any.
    pub occluder: Option<Occluder<'a>>,
}

/// The lists that culling appends to.
#[derive(Debug, Default)]
pub struct CullOutput {
    /// The next level's nodes.
    pub node_queue_out: Vec<NodeItem>,
    /// Instances and children that the early pass rejected.
    pub rejected_nodes: Vec<NodeItem>,
    /// Instances below a pixel.
    pub points: Vec<ClusterItem>,
    /// Clusters of the groups that may refine.
    pub candidates: Vec<ClusterItem>,
    /// Requests for each page of the scene.
    pub page_priority: Vec<RequestWords>,
    /// The frame's counters.
    pub counters: Counters,
}

impl CullOutput {
    /// Puts an item on the list of rejected ones; false where it is full.
    pub(super) fn reject_node(&mut self, view: &View, item: NodeItem) -> bool {
        let count = &mut self.counters.rejected_nodes;
        let fits = *count < view.node_capacity;
        append(&mut self.rejected_nodes, item, count, view.node_capacity);
        fits
    }

    /// Puts an item on the next level's queue.
    pub(super) fn append_node(&mut self, view: &View, item: NodeItem) {
        let count = &mut self.counters.next_node_count;
        append(&mut self.node_queue_out, item, count, view.node_capacity);
    }
}

/// Tests a child; `code` names it as a rejected item does.
pub fn visit_child(
    input: &CullInput<'_>,
    instance_index: u32,
    code: u32,
    parent_hidden: bool,
    output: &mut CullOutput,
) {
    let (arrays, view) = (input.arrays, input.view);
    let instance = &arrays.instances[instance_index as usize];
    let asset = &arrays.assets[instance.asset as usize];
    let width = HIERARCHY_WIDTH as u32;
    let node = &arrays.nodes[(asset.node_base + code / width) as usize];
    let child = &node.children[(code % width) as usize];
    if child.reference == NO_CHILD {
        return;
    }
    let is_group = child.reference & LEAF_FLAG != 0;
    let slack = if is_group { GROUP_SLACK } else { NODE_SLACK };
    if !view.is_reference()
        && !aabb_in_frustum(instance, view, child.aabb_min, child.aabb_max, slack)
    {
        return;
    }
    let error = child.max_parent_error_metres;
    if !is_group {
        let sphere = child.lod_sphere();
        let projected_px = projected_error_px(view, instance, sphere, error, NODE_LEVEL);
        if !error_wanted(view, error, projected_px) {
            return;
        }
    }
    let mut hidden = parent_hidden;
    if let Some(occluder) = &input.occluder
        && !hidden
        && occluder.hides(instance, child.aabb_min, child.aabb_max)
    {
        let item = NodeItem {
            instance: instance_index,
            node: code,
        };
        if occluder.late {
            output.counters.hidden_nodes += 1;
            hidden = true;
        } else if output.reject_node(view, item) {
            return;
        }
    }
    if is_group {
        let group = &arrays.groups[(asset.group_base + (child.reference & !LEAF_FLAG)) as usize];
        visit_group(input, instance_index, group, hidden, output);
        return;
    }
    let item = NodeItem {
        instance: instance_index,
        node: child.reference | if hidden { HIDDEN_FLAG } else { 0 },
    };
    output.append_node(view, item);
}

fn visit_group(
    input: &CullInput<'_>,
    instance_index: u32,
    group: &Group,
    hidden: bool,
    output: &mut CullOutput,
) {
    let (arrays, view, page_table) = (input.arrays, input.view, input.page_table);
    let instance = &arrays.instances[instance_index as usize];
    let asset = &arrays.assets[instance.asset as usize];
    let error = group.parent_error_metres;
    let exact_px = group_projected_px(view, group, instance, group.level as f32);
    if error_wanted(view, error, exact_px) {
        let bits = request_bits(error, exact_px);
        let units = priority_units(error, exact_px, view.size_px);
        for page in group.pages() {
            let words = &mut output.page_priority[(asset.page_base + page) as usize];
            if hidden {
                add_hidden_request(words, bits);
            } else {
                add_request(words, bits, units);
            }
        }
    }
    let loose_px = group_projected_px(view, group, instance, (group.level + 1) as f32);
    if hidden
        || !error_wanted(view, error, loose_px)
        || !group_installed(page_table, group, asset.page_base)
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
            let count = &mut output.counters.candidate_count;
            append(&mut output.candidates, item, count, view.cluster_capacity);
        }
    }
}
