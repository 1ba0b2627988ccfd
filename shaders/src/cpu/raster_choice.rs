//! Twin of `wgsl/shared/raster_choice.wgsl`: which rasterizer draws a cluster.

use glam::{Vec2, Vec3, Vec4};
use lodestream_format::memory_form::{MATERIAL_TABLE_FLAG, cluster_word};

use super::fetch_vertex::VisibleCluster;
use super::snap::MOST_SNAPPED_PX;
use super::view::rel_from_local;
use crate::SceneArrays;
use crate::types::{View, material_flag, view_flag};

/// Longest side of a cluster on the screen for the compute rasterizer, pixels.
pub const MOST_COMPUTE_PX: f32 = 64.0;
/// Nearest depth for it, in near planes: it does not clip.
pub const LEAST_COMPUTE_NEARS: f32 = 2.0;

/// Whether the compute rasterizer draws the cluster: small, in front of the near plane, not masked.
pub fn draws_by_compute(view: &View, arrays: &SceneArrays, cluster: &VisibleCluster<'_>) -> bool {
    if view.flags & view_flag::HARDWARE != 0 {
        return false;
    }
    let header = &cluster.cluster.header;
    let (origin, extent) = (header.origin(), header.extent());
    let step = cluster.asset.position_step;
    let low = Vec3::from(origin.map(|q| q as f32)) * step;
    let last = std::array::from_fn(|axis| (origin[axis] + extent[axis] as i32) as f32);
    let half_size = (Vec3::from(last) * step - low) * 0.5;
    let instance = cluster.instance;
    let column = |index: usize| Vec4::from(view.clip_from_rel[index]);
    let clip = |rel: Vec3, w: f32| {
        column(0) * rel.x + column(1) * rel.y + column(2) * rel.z + column(3) * w
    };
    let center = clip(rel_from_local(instance, view, low + half_size), 1.0);
    let edge = |linear: [f32; 3], half: f32| clip(Vec3::from(linear) * half, 0.0).abs();
    let reach = edge(instance.linear_x, half_size.x)
        + edge(instance.linear_y, half_size.y)
        + edge(instance.linear_z, half_size.z);
    let nearest = center.w - reach.w;
    let is_in_front = nearest > LEAST_COMPUTE_NEARS * view.near_metres;
    if !is_in_front {
        return false;
    }
    let size = Vec2::from(view.size_px.map(|size| size as f32));
    let ndc = Vec2::new(center.x, center.y) / center.w;
    let apart_px = (Vec2::new(reach.x, reach.y) + ndc.abs() * reach.w) / nearest * size;
    let far_px = ndc.abs() * size * 0.5;
    apart_px.max_element() < MOST_COMPUTE_PX
        && far_px.max_element() < MOST_SNAPPED_PX - MOST_COMPUTE_PX
        && !may_be_masked(view, arrays, cluster)
}

/// Whether a material of the cluster may be masked. One with a table of materials counts as masked.
fn may_be_masked(view: &View, arrays: &SceneArrays, cluster: &VisibleCluster<'_>) -> bool {
    let header = &cluster.cluster.header;
    if view.flags & view_flag::MASKED == 0 {
        return false;
    }
    if header.0[cluster_word::COUNTS] & MATERIAL_TABLE_FLAG != 0 {
        return true;
    }
    let packed = header.0[cluster_word::MATERIALS];
    (0..3).any(|place| {
        let slot = cluster.asset.material_base + (packed >> (6 * place) & 0x3f);
        let material = arrays.material_slots.get(slot as usize);
        let record = material.and_then(|&index| arrays.materials.get(index as usize));
        record.is_some_and(|record| record.flags & material_flag::MASK != 0)
    })
}
