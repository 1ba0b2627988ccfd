// Visible clusters to the visbuffer, by the hardware rasterizer: both sides of every triangle, whatever its material.
//
// Draw: `draw_indirect` with 384 vertices, an instance a visible cluster, no culling.
// The result is the id: kept by the target with attachments, masked out for the others.
// Depth is position.z, which the hardware interpolates linearly in screen space, also for clipped triangles.
#import types
#import fetch_vertex
#import hardware_list
#import visbuffer

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> scene: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> instances: array<InstanceRecord>;
@group(0) @binding(3) var<storage, read> clusters: array<ClusterItem>;
@group(0) @binding(4) var<storage, read> args: IndirectArgs;
@group(0) @binding(5) var<storage, read> draw_lists: array<u32>;
@group(0) @binding(6) var<storage, read_write> visbuffer: array<VisbufferWord>;

struct Fragment {
    @invariant @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat, either) id: u32,
}

@vertex
fn raster_vertex(@builtin(vertex_index) vertex_index: u32, @builtin(instance_index) drawn_index: u32) -> Fragment {
    let visible_index = hardware_index(drawn_index);
    let corner = fetch_corner(visible_index, vertex_index);
    return Fragment(corner.clip, corner.id);
}

@fragment
fn raster_fragment(fragment: Fragment) -> @location(0) u32 {
    let depth_bits = bitcast<u32>(fragment.position.z);
    store_visbuffer(pixel_index(fragment.position), depth_bits, fragment.id);
    return fragment.id;
}
