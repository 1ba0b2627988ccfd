// Colours to the window's surface, one triangle over everything: draw 3 vertices. The surface's format must not be an sRGB
// one, because `color` is encoded already.
#import types

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> color: array<u32>;

@vertex
fn present_vertex(@builtin(vertex_index) vertex_index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32(vertex_index & 1u), f32(vertex_index >> 1u));
    return vec4<f32>(corner * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn present_fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    // The surface may be a frame ahead of a resize.
    let pixel = min(vec2<u32>(position.xy), view.size_px - 1u);
    return unpack4x8unorm(color[pixel.y * view.size_px.x + pixel.x]);
}
