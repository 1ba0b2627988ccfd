//! Visbuffer to colours. Twin of `wgsl/shade.wgsl`.

use glam::Vec3;
use rayon::prelude::*;

use super::false_color::{
    COMPUTE_COLOR, EMPTY_COLOR, HARDWARE_COLOR, POINT_COLOR, hash_color, level_color, ramp_color,
};
use super::fetch_vertex::VisibleCluster;
use super::hash::hash;
use super::light::{SKY_BOTTOM_SRGB, SKY_TOP_SRGB, light_surface, mix, tone};
use super::raster_choice::draws_by_compute;
use super::srgb::{pack_color, srgb_from_linear};
use super::surface::Surface;
use super::texture::Textures;
use crate::SceneArrays;
use crate::types::{ClusterItem, POINT_FLAG, ShadeMode, TRIANGLE_BITS, View, material_flag};

/// A colour a pixel: sRGB bytes, RGBA from the low byte. `view.shade_mode` chooses the picture; `fragment_counts` is read
/// in the overdraw picture alone and may be empty in others.
pub fn shade(
    visbuffer: &[u64],
    visible: &[ClusterItem],
    arrays: &SceneArrays,
    pool: &[u32],
    view: &View,
    textures: &Textures,
    fragment_counts: &[u32],
) -> Vec<u32> {
    let width = view.size_px[0] as usize;
    visbuffer
        .par_iter()
        .enumerate()
        .with_min_len(width)
        .map(|(index, &word)| {
            if view.shade_mode == ShadeMode::Overdraw as u32 {
                return overdraw_color(fragment_counts.get(index).copied().unwrap_or(0));
            }
            let row = (index / width) as u32;
            let depth_bits = (word >> 32) as u32;
            if depth_bits == 0 {
                return background(view, row);
            }
            if view.shade_mode == ShadeMode::Depth as u32 {
                return depth_color(f32::from_bits(depth_bits));
            }
            let (id, pixel) = (word as u32, [(index % width) as u32, row]);
            let item = visible.get((id >> TRIANGLE_BITS) as usize);
            if let Some(point) = item.filter(|item| is_point(item)) {
                return point_color(view, point);
            }
            let surface = item
                .and_then(|&item| VisibleCluster::new(item, arrays, pool))
                .and_then(|visible| {
                    let triangle = id & ((1 << TRIANGLE_BITS) - 1);
                    Surface::new(visible, triangle, pixel, arrays, view, textures)
                });
            // An id that names nothing comes from a foreign visbuffer.
            surface.map_or(EMPTY_COLOR, |surface| surface_color(arrays, view, &surface))
        })
        .collect()
}

/// Half the diagonal of a cell of the position grid, in steps.
const ROUNDING_STEPS: f32 = 0.866_025_5;
/// The same with a quarter for the place of the instance, which ingest rounds where there are many.
const MOVED_STEPS: f32 = 1.082_531_9;
/// Instances up to which ingest rounds none.
const FEW_INSTANCES: u32 = 64;

/// The most pixels that the rounding of a visible surface to its grid may show, where they are more
/// than the pixel error; else zero. Its bits are [`Counters::rounding_px_bits`].
///
/// [`Counters::rounding_px_bits`]: crate::types::Counters::rounding_px_bits
pub fn rounding_px(
    visbuffer: &[u64],
    visible: &[ClusterItem],
    arrays: &SceneArrays,
    view: &View,
) -> f32 {
    let [width, height] = view.size_px.map(|side| side as f32);
    let rounding_of = |(index, &word): (usize, &u64)| {
        let depth_bits = (word >> 32) as u32;
        let item = visible.get((word as u32 >> TRIANGLE_BITS) as usize)?;
        if depth_bits == 0 || is_point(item) {
            return None;
        }
        let instance = &arrays.instances[item.instance as usize];
        let step_metres = arrays.assets[instance.asset as usize].position_step;
        let steps = match view.instance_count > FEW_INSTANCES {
            true => MOVED_STEPS,
            false => ROUNDING_STEPS,
        };
        let moved = steps * step_metres * instance.max_scale;
        let depth = view.near_metres / f32::from_bits(depth_bits);
        let row_length = view.size_px[0] as usize;
        let [x, y] = [index % row_length, index / row_length].map(|place| place as f32 + 0.5);
        let [x, y] = [x - 0.5 * width, y - 0.5 * height].map(|at| at / view.pixels_at_one_metre);
        let secant = (1.0 + x * x + y * y).sqrt();
        let px = moved * view.pixels_at_one_metre * secant / depth;
        (px > view.pixel_error_px).then_some(px)
    };
    visbuffer
        .iter()
        .enumerate()
        .filter_map(rounding_of)
        .fold(0.0, f32::max)
}

fn surface_color(arrays: &SceneArrays, view: &View, surface: &Surface<'_>) -> u32 {
    const TRIANGLES: u32 = ShadeMode::Triangles as u32;
    const CLUSTERS: u32 = ShadeMode::Clusters as u32;
    const GROUPS: u32 = ShadeMode::Groups as u32;
    const LEVELS: u32 = ShadeMode::Levels as u32;
    const PAGES: u32 = ShadeMode::Pages as u32;
    const NORMALS: u32 = ShadeMode::Normals as u32;
    const RASTER: u32 = ShadeMode::Raster as u32;
    const MATERIALS: u32 = ShadeMode::Materials as u32;
    const INSTANCES: u32 = ShadeMode::Instances as u32;
    let header = &surface.visible.cluster.header;
    match view.shade_mode {
        TRIANGLES => hash_color(hash(cluster_number(surface)) ^ surface.triangle),
        CLUSTERS => hash_color(cluster_number(surface)),
        GROUPS => hash_color(
            surface
                .visible
                .asset
                .group_base
                .wrapping_add(header.group()),
        ),
        LEVELS => level_color(header.level()),
        PAGES => hash_color(surface.visible.item.page),
        NORMALS => pack_color(surface.normal * 0.5 + 0.5),
        RASTER if draws_by_compute(view, arrays, &surface.visible) => COMPUTE_COLOR,
        RASTER => HARDWARE_COLOR,
        MATERIALS => hash_color(surface.material_index),
        INSTANCES => hash_color(surface.visible.item.instance),
        _ => shaded_color(surface),
    }
}

fn is_point(item: &ClusterItem) -> bool {
    item.page & POINT_FLAG != 0
}

fn point_color(view: &View, point: &ClusterItem) -> u32 {
    const SHADED: u32 = ShadeMode::Shaded as u32;
    const INSTANCES: u32 = ShadeMode::Instances as u32;
    match view.shade_mode {
        SHADED => point.cluster,
        INSTANCES => hash_color(point.instance),
        _ => POINT_COLOR,
    }
}

fn shaded_color(surface: &Surface<'_>) -> u32 {
    let material = surface.material;
    let encode = |linear: Vec3| pack_color(Vec3::from(linear.to_array().map(srgb_from_linear)));
    if material.flags & material_flag::UNLIT != 0 {
        return encode(surface.base_color.min(Vec3::ONE));
    }
    let lit = light_surface(
        surface.base_color,
        material.metallic,
        material.roughness,
        surface.normal,
        surface.to_eye,
    );
    encode(tone(lit + Vec3::from(material.emissive)))
}

fn cluster_number(surface: &Surface<'_>) -> u32 {
    surface.visible.item.page << 11 | surface.visible.item.cluster
}

fn background(view: &View, row: u32) -> u32 {
    if view.shade_mode != ShadeMode::Shaded as u32 {
        return EMPTY_COLOR;
    }
    let share = (row as f32 + 0.5) / view.size_px[1] as f32;
    pack_color(mix(SKY_TOP_SRGB, SKY_BOTTOM_SRGB, share))
}

fn depth_color(depth: f32) -> u32 {
    let doublings = -depth.log2();
    pack_color(Vec3::splat(1.0 - doublings / 20.0))
}

fn overdraw_color(fragments: u32) -> u32 {
    if fragments == 0 {
        return EMPTY_COLOR;
    }
    let doublings = fragments.ilog2();
    let rest = (fragments << 3 >> doublings) & 7;
    let step = doublings.min(5) * 8 + if doublings >= 5 { 0 } else { rest };
    ramp_color(step, 40)
}
