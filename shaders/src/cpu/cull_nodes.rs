//! Twin of `wgsl/cull_nodes.wgsl`: a level of nodes, and the rejects of the early pass.

use lodestream_format::limits::HIERARCHY_WIDTH;

use super::occlusion::Occluder;
use super::visit::{CullInput, CullOutput, HIDDEN_FLAG, WHOLE_INSTANCE, visit_child};
use crate::types::NodeItem;

/// One level of hierarchy nodes to the next level, to candidates and to streaming requests.
pub fn cull_nodes(input: &CullInput<'_>, node_queue_in: &[NodeItem], output: &mut CullOutput) {
    for item in node_queue_in {
        output.counters.nodes_visited += 1;
        let node = item.node & !HIDDEN_FLAG;
        let first = node * HIERARCHY_WIDTH as u32;
        for code in first..first + HIERARCHY_WIDTH as u32 {
            visit_child(input, item.instance, code, item.node != node, output);
        }
    }
}

/// Tests the rejects of the early pass against the depths of this frame.
pub fn cull_rejected(
    input: &CullInput<'_>,
    occluder: &Occluder<'_>,
    rejected: &[NodeItem],
    output: &mut CullOutput,
) {
    for item in rejected {
        if item.node != WHOLE_INSTANCE {
            visit_child(input, item.instance, item.node, false, output);
            continue;
        }
        let instance = &input.arrays.instances[item.instance as usize];
        let asset = &input.arrays.assets[instance.asset as usize];
        let hidden = occluder.hides(instance, asset.aabb_min, asset.aabb_max);
        let count = match hidden {
            true => &mut output.counters.hidden_instances,
            false => &mut output.counters.instances_drawn,
        };
        *count += 1;
        let node = if hidden { HIDDEN_FLAG } else { 0 };
        let item = NodeItem { node, ..*item };
        output.append_node(input.view, item);
    }
}
