//! Twin of `wgsl/cull_clusters.wgsl`.

use lodestream_format::cluster::NO_GROUP;
use lodestream_format::cluster_view::ClusterView;
use lodestream_format::memory_form::ClusterHeader;

use super::append;
use super::error_metric::refine;
use super::view::{CLUSTER_SLACK, aabb_in_frustum};
use crate::arrays::SceneArrays;
use crate::types::{AssetRecord, ClusterItem, Counters, InstanceRecord, View};

/// Candidates to visible clusters. A candidate whose page is not in `pool` is dropped.
pub fn cull_clusters(
    arrays: &SceneArrays,
    view: &View,
    page_table: &[u32],
    pool: &[u32],
    candidates: &[ClusterItem],
    counters: &mut Counters,
    visible: &mut Vec<ClusterItem>,
) {
    for item in candidates {
        let page = pool.get(item.page_word as usize..).unwrap_or(&[]);
        let Some(cluster) = ClusterView::new(page, item.cluster) else {
            continue;
        };
        let header = &cluster.header;
        if in_cut(arrays, view, page_table, item.instance, header)
            && cluster_in_frustum(arrays, view, item.instance, header)
        {
            counters.triangles_drawn = counters
                .triangles_drawn
                .wrapping_add(header.triangle_count());
            append(
                visible,
                *item,
                &mut counters.visible_count,
                view.cluster_capacity,
            );
        }
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
    let (origin, extent) = (header.origin(), header.extent());
    let aabb_min = origin.map(|q| q as f32 * asset.position_step);
    let aabb_max = std::array::from_fn(|axis| {
        (origin[axis] + extent[axis] as i32) as f32 * asset.position_step
    });
    view.is_reference() || aabb_in_frustum(instance, view, aabb_min, aabb_max, CLUSTER_SLACK)
}

fn instance_and_asset(arrays: &SceneArrays, instance: u32) -> (&InstanceRecord, &AssetRecord) {
    let instance = &arrays.instances[instance as usize];
    (instance, &arrays.assets[instance.asset as usize])
}
