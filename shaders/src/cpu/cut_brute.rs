//! The cut by definition: every cluster of every installed group, every group's request, without the hierarchy's nodes.

use lodestream_format::Aabb;
use lodestream_format::cluster_view::ClusterView;
use lodestream_format::hierarchy::Group;

use super::cull_clusters::{cluster_in_frustum, in_cut};
use super::error_metric::{
    add_request, error_wanted, group_installed, group_projected_px, priority_units, request_bits,
};
use super::proxy::draws_as_point;
use super::view::{GROUP_SLACK, aabb_in_frustum};
use crate::arrays::SceneArrays;
use crate::types::{ClusterItem, RequestRecord, View};

/// Visible clusters of a frame, instance by instance in the order of groups.
pub fn cut_brute(
    arrays: &SceneArrays,
    view: &View,
    page_table: &[u32],
    pool: &[u32],
) -> Vec<ClusterItem> {
    let mut visible = Vec::new();
    for (index, instance) in arrays.instances.iter().enumerate() {
        let asset = &arrays.assets[instance.asset as usize];
        if draws_as_point(view, instance, asset) {
            continue;
        }
        for group in groups_of(arrays, instance.asset) {
            if !group_installed(page_table, group, asset.page_base) {
                continue;
            }
            for (part, page) in group.pages().enumerate() {
                let page = asset.page_base + page;
                let page_word = page_table[page as usize];
                let range = arrays.parts[(asset.part_base + group.first_part) as usize + part];
                for cluster in range.first_cluster..range.first_cluster + range.cluster_count {
                    let words = pool.get(page_word as usize..).unwrap_or(&[]);
                    let Some(found) = ClusterView::new(words, cluster) else {
                        continue;
                    };
                    let drawn = in_cut(arrays, view, page_table, index as u32, &found.header)
                        && cluster_in_frustum(arrays, view, index as u32, &found.header);
                    if drawn {
                        visible.push(ClusterItem {
                            instance: index as u32,
                            page,
                            cluster,
                            page_word,
                        });
                    }
                }
            }
        }
    }
    visible
}

/// Streaming requests of a frame by page number. `group_aabbs` bounds the clusters of each group of the scene, local metres.
pub fn requests_brute(
    arrays: &SceneArrays,
    view: &View,
    group_aabbs: &[Aabb],
) -> Vec<RequestRecord> {
    let mut priorities = vec![[0u32; 3]; arrays.page_count as usize];
    for instance in &arrays.instances {
        let asset = &arrays.assets[instance.asset as usize];
        if draws_as_point(view, instance, asset) {
            continue;
        }
        for (number, group) in groups_of(arrays, instance.asset).iter().enumerate() {
            let aabb = &group_aabbs[asset.group_base as usize + number];
            let seen = view.is_reference()
                || aabb_in_frustum(instance, view, aabb.min, aabb.max, GROUP_SLACK);
            let error = group.parent_error_metres;
            let px = group_projected_px(view, group, instance, group.level as f32);
            if seen && error_wanted(view, error, px) {
                let units = priority_units(error, px, view.size_px);
                for page in group.pages() {
                    let words = &mut priorities[(asset.page_base + page) as usize];
                    add_request(words, request_bits(error, px), units);
                }
            }
        }
    }
    let wanted = priorities
        .iter()
        .enumerate()
        .filter(|&(_, &[error_bits, ..])| error_bits != 0);
    wanted
        .map(|(page, &[error_bits, priority, _])| RequestRecord {
            page: page as u32,
            error_px: f32::from_bits(error_bits),
            priority,
        })
        .collect()
}

fn groups_of(arrays: &SceneArrays, asset: u32) -> &[Group] {
    let base = |asset: usize| {
        arrays
            .assets
            .get(asset)
            .map(|asset| asset.group_base as usize)
    };
    let first = base(asset as usize).unwrap_or(0);
    let end = base(asset as usize + 1).unwrap_or(arrays.groups.len());
    &arrays.groups[first..end]
}
