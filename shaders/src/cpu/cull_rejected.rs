//! Twin of `wgsl/cull_rejected.wgsl`.

use super::occlusion::Occluder;
use super::visit::{CullInput, CullOutput, HIDDEN_FLAG, WHOLE_INSTANCE, visit_child};
use crate::types::NodeItem;

/// Tests once more what the early pass rejected, against the depths of this frame.
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
