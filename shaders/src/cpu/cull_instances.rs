//! Twin of `wgsl/cull_instances.wgsl`.

use super::append;
use super::proxy::{draws_as_point, point_of};
use super::view::{NODE_SLACK, aabb_in_frustum};
use super::visit::{CullInput, CullOutput, HIDDEN_FLAG, WHOLE_INSTANCE};
use crate::types::NodeItem;

/// Appends the root node of every instance in the frustum, or its point where it is too small; the
/// early pass rejects hidden ones.
pub fn cull_instances(input: &CullInput<'_>, output: &mut CullOutput) {
    let (arrays, view) = (input.arrays, input.view);
    let proxies = arrays.proxy_records(&arrays.materials);
    for (index, instance) in (0..).zip(&arrays.instances) {
        let Some(asset) = arrays.assets.get(instance.asset as usize) else {
            // `NO_ASSET`: nothing is here, or it is hidden.
            continue;
        };
        let (low, high) = (asset.aabb_min, asset.aabb_max);
        if !view.is_reference() && !aabb_in_frustum(instance, view, low, high, NODE_SLACK) {
            continue;
        }
        if draws_as_point(view, instance, asset) {
            let proxy = proxies.get(instance.proxy as usize).copied();
            let proxy = proxy.unwrap_or_default();
            if let Some(point) = point_of(view, index, instance, asset, &proxy) {
                let count = &mut output.counters.point_count;
                append(&mut output.points, point, count, view.cluster_capacity);
            }
            continue;
        }
        let item = |node| NodeItem {
            instance: index,
            node,
        };
        let mut root = item(0);
        if let Some(occluder) = &input.occluder
            && occluder.hides(instance, low, high)
        {
            if occluder.late {
                output.counters.hidden_instances += 1;
                root = item(HIDDEN_FLAG);
            } else if output.reject_node(view, item(WHOLE_INSTANCE)) {
                continue;
            }
        }
        if root.node == 0 {
            output.counters.instances_drawn += 1;
        }
        output.append_node(view, root);
    }
}
