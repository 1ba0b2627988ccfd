//! Twin of `wgsl/cull_instances.wgsl`.

use super::append;
use super::view::{NODE_SLACK, aabb_in_frustum};
use crate::arrays::SceneArrays;
use crate::types::{Counters, NodeItem, View};

/// Appends the root node of every instance in the frustum.
pub fn cull_instances(
    arrays: &SceneArrays,
    view: &View,
    counters: &mut Counters,
    node_queue_out: &mut Vec<NodeItem>,
) {
    for (index, instance) in arrays.instances.iter().enumerate() {
        let asset = &arrays.assets[instance.asset as usize];
        let seen = view.is_reference()
            || aabb_in_frustum(instance, view, asset.aabb_min, asset.aabb_max, NODE_SLACK);
        if seen {
            counters.instances_drawn += 1;
            let item = NodeItem {
                instance: index as u32,
                node: 0,
            };
            append(
                node_queue_out,
                item,
                &mut counters.next_node_count,
                view.node_capacity,
            );
        }
    }
}
