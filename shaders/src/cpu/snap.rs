//! Twin of `wgsl/shared/snap.wgsl`: the integer grid that both rasterizers draw on.

use glam::{IVec2, Vec2, Vec4};

use crate::types::View;

/// Steps of the grid a pixel.
pub const SUBPIXELS: f32 = 256.0;
/// Pixels from the picture's middle past which f32 no longer holds the grid exactly.
pub const MOST_SNAPPED_PX: f32 = 8192.0;

/// Grid position of a clip position in front of the eye, from the picture's top left.
pub fn snap(view: &View, clip: Vec4) -> IVec2 {
    let size = Vec2::from(view.size_px.map(|size| size as f32));
    let ndc = Vec2::new(0.5 + 0.5 * (clip.x / clip.w), 0.5 - 0.5 * (clip.y / clip.w));
    let steps = ndc * size * SUBPIXELS;
    IVec2::new(
        steps.x.round_ties_even() as i32,
        steps.y.round_ties_even() as i32,
    )
}

/// The clip position moved onto the grid, where it has a place on it.
pub fn snapped_clip(view: &View, clip: Vec4) -> Vec4 {
    let size = Vec2::from(view.size_px.map(|size| size as f32));
    let far_px = (clip.x.abs() * size.x).max(clip.y.abs() * size.y) * 0.5;
    let has_place = clip.w >= view.near_metres && far_px < MOST_SNAPPED_PX * clip.w;
    if !has_place {
        return clip;
    }
    let px = snap(view, clip).as_vec2() / SUBPIXELS;
    let ndc = Vec2::new(px.x * 2.0 / size.x - 1.0, 1.0 - px.y * 2.0 / size.y);
    (ndc * clip.w).extend(clip.z).extend(clip.w)
}
