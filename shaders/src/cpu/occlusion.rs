//! Twin of `wgsl/shared/occlusion.wgsl`: the test of a box against drawn depths.

use glam::{Vec2, Vec3, Vec4};

use super::hzb::Hzb;
use super::view::sum3;
use crate::types::{InstanceRecord, View};

/// Rounding of a corner's way to the screen, as a share of the largest term in it.
pub const PROJECTION_SLACK: f32 = 1.0 / (1 << 20) as f32;
/// The rasterizer snaps corners to this many pixels.
pub const SNAP_PX: f32 = 1.0 / 256.0;
/// How far above its corners' depths the rasterizer may interpolate.
pub const DEPTH_SLACK: f32 = 1.0 + 1.0 / (1 << 16) as f32;
/// Texels an axis that one test reads at most.
pub const MOST_TEXELS: i32 = 4;
/// Pixels past which a corner says nothing.
pub const MOST_PX: f32 = 1e9;

/// The depths that a pass tests against.
#[derive(Debug, Clone, Copy)]
pub struct Occluder<'a> {
    /// The view that drew them.
    pub view: &'a View,
    /// The depths.
    pub hzb: &'a Hzb,
    /// Whether they are this frame's: then hidden is hidden.
    pub late: bool,
}

impl Occluder<'_> {
    /// Whether a local box is behind all depths of its pixels.
    pub fn hides(&self, instance: &InstanceRecord, aabb_min: [f32; 3], aabb_max: [f32; 3]) -> bool {
        let view = self.view;
        let (aabb_min, aabb_max) = (Vec3::from(aabb_min), Vec3::from(aabb_max));
        let columns = [instance.linear_x, instance.linear_y, instance.linear_z].map(Vec3::from);
        let origin = (Vec3::from(instance.translation_high) - Vec3::from(view.eye_high))
            + (Vec3::from(instance.translation_low) - Vec3::from(view.eye_low));
        let reach = aabb_min.abs().max(aabb_max.abs());
        let terms = origin.abs()
            + columns[0].abs() * reach.x
            + columns[1].abs() * reach.y
            + columns[2].abs() * reach.z;
        let slack_metres = sum3(terms) * PROJECTION_SLACK;
        let size = view.size_px.map(|size| size as f32);
        let half_px = Vec2::from(size) * 0.5;
        let mut nearest = 3e38f32;
        let mut low_px = Vec2::splat(3e38);
        let mut high_px = Vec2::splat(-3e38);
        for corner in 0..8 {
            let pick = |bit: u32, low: f32, high: f32| if corner & bit == 0 { low } else { high };
            let local = Vec3::new(
                pick(1, aabb_min.x, aabb_max.x),
                pick(2, aabb_min.y, aabb_max.y),
                pick(4, aabb_min.z, aabb_max.z),
            );
            let rel = origin + columns[0] * local.x + columns[1] * local.y + columns[2] * local.z;
            let column = |index: usize| Vec4::from(view.clip_from_rel[index]);
            let clip = column(0) * rel.x + column(1) * rel.y + column(2) * rel.z + column(3);
            nearest = nearest.min(clip.w);
            let px = Vec2::new(clip.x, -clip.y) / clip.w * half_px;
            low_px = low_px.min(px);
            high_px = high_px.max(px);
        }
        let depth = nearest - slack_metres;
        let farthest_px = low_px.abs().max(high_px.abs()).max_element();
        // Not-a-number compares false, so it counts as visible.
        let is_bounded = depth > view.near_metres && farthest_px < MOST_PX;
        if !is_bounded {
            return false;
        }
        let slack_px = SNAP_PX + (view.pixels_at_one_metre + farthest_px) * slack_metres / depth;
        let low = (low_px + half_px - slack_px).floor().as_ivec2();
        let high = (high_px + half_px + slack_px).floor().as_ivec2();
        let last = glam::IVec2::from(view.size_px.map(|size| size as i32 - 1));
        if high.min_element() < 0 || low.cmpgt(last).any() {
            return false;
        }
        let (from_px, to_px) = (low.max(glam::IVec2::ZERO), high.min(last));
        let mut level = 1i32;
        while ((to_px >> level) - (from_px >> level)).max_element() >= MOST_TEXELS {
            level += 1;
        }
        let nearest_bits = (view.near_metres / depth * DEPTH_SLACK).to_bits();
        let (from, to) = (from_px >> level, to_px >> level);
        let mut texels = (from.y..=to.y).flat_map(|y| (from.x..=to.x).map(move |x| (x, y)));
        texels.all(|(x, y)| self.hzb.texel(level as u32, x as u32, y as u32) > nearest_bits)
    }
}
