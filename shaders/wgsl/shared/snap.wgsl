// The integer grid that both rasterizers draw on: 1/256 of a pixel. Needs the binding `view`.
//
// The hardware gets positions that lie on the grid already, so its own snap finds nothing to
// decide, and both rasterizers cover the same pixels.
#import view

const SUBPIXELS: f32 = 256.0;
// Pixels from the picture's middle past which f32 no longer holds the grid exactly.
const MOST_SNAPPED_PX: f32 = 8192.0;

// Grid position of a clip position in front of the eye, from the picture's top left.
fn snap(clip: vec4<f32>) -> vec2<i32> {
    let size = vec2<f32>(view.size_px);
    let px = vec2<f32>(0.5 + 0.5 * (clip.x / clip.w), 0.5 - 0.5 * (clip.y / clip.w)) * size;
    return vec2<i32>(round(px * SUBPIXELS));
}

// The clip position moved onto the grid, where it has a place on it.
fn snapped_clip(clip: vec4<f32>) -> vec4<f32> {
    let size = vec2<f32>(view.size_px);
    let far_px = max(abs(clip.x) * size.x, abs(clip.y) * size.y) * 0.5;
    if !(clip.w >= view.near_metres && far_px < MOST_SNAPPED_PX * clip.w) {
        return clip;
    }
    let px = vec2<f32>(snap(clip)) / SUBPIXELS;
    let ndc = vec2<f32>(px.x * 2.0 / size.x - 1.0, 1.0 - px.y * 2.0 / size.y);
    return vec4<f32>(ndc * clip.w, clip.z, clip.w);
}
