//! Twin of `wgsl/cull_nodes.wgsl`.

use lodestream_format::limits::HIERARCHY_WIDTH;

use super::visit::{CullInput, CullOutput, HIDDEN_FLAG, visit_child};
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
