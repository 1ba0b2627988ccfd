//! Twin of `wgsl/cull_clusters.wgsl`.

use lodestream_format::cluster::NO_GROUP;
use lodestream_format::cluster_view::ClusterView;
use lodestream_format::memory_form::ClusterHeader;

use super::append;
use super::error_metric::refine;
use super::prepare::visible_room;
use super::view::{CLUSTER_SLACK, aabb_in_frustum};
use super::visit::CullInput;
use crate::arrays::SceneArrays;
use crate::types::{AssetRecord, ClusterItem, Counters, InstanceRecord, NOT_INSTALLED, View};

/// Candidates to visible clusters. The early pass marks all but the hidden ones, for the late one.
/// A candidate whose page is not in `pool` is dropped.
pub fn cull_clusters(
    input: &CullInput<'_>,
    pool: &[u32],
    candidates: &mut [ClusterItem],
    counters: &mut Counters,
    visible: &mut Vec<ClusterItem>,
) {
    let CullInput {
        arrays,
        view,
        page_table,
        occluder,
    } = *input;
    let is_early = occluder.is_some_and(|occluder| !occluder.late);
    for candidate in candidates {
        let item = *candidate;
        if item.page_word == NOT_INSTALLED {
            continue;
        }
        if is_early {
            candidate.page_word = NOT_INSTALLED;
        }
        let page = pool.get(item.page_word as usize..).unwrap_or(&[]);
        let Some(cluster) = ClusterView::new(page, item.cluster) else {
            continue;
        };
        let header = &cluster.header;
        if !in_cut(arrays, view, page_table, item.instance, header)
            || !cluster_in_frustum(arrays, view, item.instance, header)
        {
            continue;
        }
        let (instance, asset) = instance_and_asset(arrays, item.instance);
        let [low, high] = cluster_box(header, asset);
        if let Some(occluder) = occluder
            && occluder.hides(instance, low, high)
        {
            if is_early {
                counters.rejected_clusters += 1;
                *candidate = item;
            } else {
                counters.hidden_clusters += 1;
            }
            continue;
        }
        counters.triangles_drawn = counters
            .triangles_drawn
            .wrapping_add(header.triangle_count());
        let room = visible_room(view, counters);
        append(visible, item, &mut counters.visible_count, room);
    }
}

/// Whether a cluster of an instance is in the cut: its own group refines, the one below does not.
pub fn in_cut(
    arrays: &SceneArrays,
    view: &View,
    page_table: &[u32],
    instance: u32,
    header: &ClusterHeader,
) -> bool {
    let (instance, asset) = instance_and_asset(arrays, instance);
    let refines = |number: u32| {
        number != NO_GROUP && {
            let group = &arrays.groups[(asset.group_base + number) as usize];
            refine(view, page_table, group, instance, asset.page_base)
        }
    };
    refines(header.group()) && !refines(header.child_group())
}

/// Whether a cluster's box touches the frustum.
pub fn cluster_in_frustum(
    arrays: &SceneArrays,
    view: &View,
    instance: u32,
    header: &ClusterHeader,
) -> bool {
    let (instance, asset) = instance_and_asset(arrays, instance);
    let [low, high] = cluster_box(header, asset);
    view.is_reference() || aabb_in_frustum(instance, view, low, high, CLUSTER_SLACK)
}

/// Smallest and largest corner, local metres, exact.
fn cluster_box(header: &ClusterHeader, asset: &AssetRecord) -> [[f32; 3]; 2] {
    let (origin, extent) = (header.origin(), header.extent());
    let corner = |reach: [i32; 3]| {
        std::array::from_fn(|axis| (origin[axis] + reach[axis]) as f32 * asset.position_step)
    };
    [corner([0; 3]), corner(extent.map(|side| side as i32))]
}

fn instance_and_asset(arrays: &SceneArrays, instance: u32) -> (&InstanceRecord, &AssetRecord) {
    let instance = &arrays.instances[instance as usize];
    (instance, &arrays.assets[instance.asset as usize])
}
