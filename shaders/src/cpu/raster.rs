//! A scalar rasterizer with Vulkan's rules: twin of `wgsl/raster.wgsl`, `raster_masked.wgsl` and `raster_overdraw.wgsl`
//! with the fixed functions between their stages.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::barycentric::Barycentric;
use super::fetch_vertex::{VisibleCluster, visbuffer_word};
use super::mask_cutoffs::{ALPHA_SLACK, VERTEX_ALPHA_SLACK};
use super::sample_texture::sample_mask;
use super::scan::{Fragment, scan_triangle};
use super::texture::Textures;
use crate::SceneArrays;
use crate::types::{ClusterItem, MaterialRecord, View, material_flag};

/// Visible clusters to the visbuffer, a word a pixel in rows from the top; both sides of every triangle.
pub fn raster(
    visible: &[ClusterItem],
    arrays: &SceneArrays,
    pool: &[u32],
    view: &View,
) -> Vec<u64> {
    let visbuffer = pixels(view, AtomicU64::default);
    for_each_triangle(visible, arrays, pool, |visible_index, cluster, triangle| {
        let corners = cluster.triangle_clip(view, triangle);
        scan_triangle(corners, view.size_px, |fragment| {
            let word = visbuffer_word(fragment.depth, visible_index, triangle);
            visbuffer[fragment.index(view)].fetch_max(word, Ordering::Relaxed);
        });
    });
    visbuffer.into_iter().map(AtomicU64::into_inner).collect()
}

/// [`raster`] without back faces of single-sided materials and without what masked ones hide.
pub fn raster_masked(
    visible: &[ClusterItem],
    arrays: &SceneArrays,
    pool: &[u32],
    view: &View,
    textures: &Textures,
) -> Vec<u64> {
    let visbuffer = pixels(view, AtomicU64::default);
    for_each_triangle(visible, arrays, pool, |visible_index, cluster, triangle| {
        let Some(material) = arrays
            .materials
            .get(cluster.material(arrays, triangle) as usize)
        else {
            return;
        };
        let corners = cluster.triangle_clip(view, triangle);
        scan_triangle(corners, view.size_px, |fragment| {
            let front = fragment.front != (cluster.instance.mirrored != 0);
            let one_sided = material.flags & material_flag::DOUBLE_SIDED == 0;
            let masked = material.flags & material_flag::MASK != 0;
            if (one_sided && !front)
                || (masked
                    && is_cut(
                        cluster, triangle, material, textures, corners, view, &fragment,
                    ))
            {
                return;
            }
            let word = visbuffer_word(fragment.depth, visible_index, triangle);
            visbuffer[fragment.index(view)].fetch_max(word, Ordering::Relaxed);
        });
    });
    visbuffer.into_iter().map(AtomicU64::into_inner).collect()
}

/// Fragments a pixel, both sides of every triangle.
pub fn raster_overdraw(
    visible: &[ClusterItem],
    arrays: &SceneArrays,
    pool: &[u32],
    view: &View,
) -> Vec<u32> {
    let fragment_counts = pixels(view, AtomicU32::default);
    for_each_triangle(visible, arrays, pool, |_, cluster, triangle| {
        scan_triangle(
            cluster.triangle_clip(view, triangle),
            view.size_px,
            |fragment| {
                fragment_counts[fragment.index(view)].fetch_add(1, Ordering::Relaxed);
            },
        );
    });
    fragment_counts
        .into_iter()
        .map(AtomicU32::into_inner)
        .collect()
}

/// Whether the host has to record `raster_masked` instead of `raster`: some material can hide a fragment.
pub fn needs_masked(materials: &[MaterialRecord]) -> bool {
    materials.iter().any(|material| {
        material.flags & (material_flag::MASK | material_flag::DOUBLE_SIDED)
            != material_flag::DOUBLE_SIDED
    })
}

fn pixels<T>(view: &View, empty: impl Fn() -> T) -> Vec<T> {
    let count = view.size_px[0] as usize * view.size_px[1] as usize;
    std::iter::repeat_with(empty).take(count).collect()
}

/// Clusters in parallel: maxima and sums come out the same in any order.
fn for_each_triangle(
    visible: &[ClusterItem],
    arrays: &SceneArrays,
    pool: &[u32],
    draw: impl Fn(u32, &VisibleCluster<'_>, u32) + Sync,
) {
    visible.par_iter().enumerate().for_each(|(index, item)| {
        let Some(cluster) = VisibleCluster::new(*item, arrays, pool) else {
            return;
        };
        for triangle in 0..cluster.cluster.header.triangle_count() {
            draw(index as u32, &cluster, triangle);
        }
    });
}

/// Whether a masked material hides a fragment. The GPU takes the texture's footprint from
/// neighbouring fragments, this from the analytic derivatives; they agree but for the rounding of
/// the mip.
fn is_cut(
    cluster: &VisibleCluster<'_>,
    triangle: u32,
    material: &MaterialRecord,
    textures: &Textures,
    corners: [Vec4; 3],
    view: &View,
    fragment: &Fragment,
) -> bool {
    let (ndc, pixel_in_ndc) = pixel_center_in_ndc(view, fragment.x, fragment.y);
    let place = Barycentric::at(corners, ndc, pixel_in_ndc);
    let vertices = cluster.cluster.triangle(triangle);
    let mut alpha = material.base_color[3];
    if let [Some(a), Some(b), Some(c)] = vertices.map(|vertex| cluster.cluster.color(vertex)) {
        let of = |color: [u8; 4]| match color[3] {
            0 => 0.0,
            alpha => (alpha as f32 / 255.0 + VERTEX_ALPHA_SLACK).min(1.0),
        };
        alpha *= Vec3::from([a, b, c].map(of)).dot(place.weights);
    }
    let uv = vertices.map(|vertex| cluster.cluster.uv(vertex).unwrap_or([0; 2]));
    let uv = uv.map(|uv| Vec2::from(uv.map(|value| value as f32)) * cluster.asset.uv_step);
    let at = |weights: Vec3| uv[0] * weights.x + uv[1] * weights.y + uv[2] * weights.z;
    let (dx, dy) = (at(place.weights_dx), at(place.weights_dy));
    let (sampled, cutoff) = sample_mask(textures, material, at(place.weights), dx, dy);
    alpha * sampled + ALPHA_SLACK < cutoff
}

/// The centre of a pixel, and the step to the next to the right and down.
pub(crate) fn pixel_center_in_ndc(view: &View, x: u32, y: u32) -> (Vec2, Vec2) {
    let size = Vec2::new(view.size_px[0] as f32, view.size_px[1] as f32);
    let pixel_in_ndc = Vec2::new(2.0, -2.0) / size;
    let ndc = Vec2::new(-1.0, 1.0) + (Vec2::new(x as f32, y as f32) + 0.5) * pixel_in_ndc;
    (ndc, pixel_in_ndc)
}

impl Fragment {
    fn index(&self, view: &View) -> usize {
        self.y as usize * view.size_px[0] as usize + self.x as usize
    }
}
