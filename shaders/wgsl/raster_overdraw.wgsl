// Fragments a pixel, for the overdraw picture alone: `shade` turns the counts into colours in
// place. Drawn like `raster`.
#import types
#import fetch_vertex
#import hardware_list

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> scene: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> instances: array<InstanceRecord>;
@group(0) @binding(3) var<storage, read> clusters: array<ClusterItem>;
@group(0) @binding(4) var<storage, read> args: IndirectArgs;
@group(0) @binding(5) var<storage, read> draw_lists: array<u32>;
@group(0) @binding(6) var<storage, read_write> color: array<atomic<u32>>;

@vertex
fn raster_vertex(
    @builtin(vertex_index) vertex_index: u32,
    @builtin(instance_index) drawn_index: u32,
) -> @invariant @builtin(position) vec4<f32> {
    return fetch_corner(hardware_index(drawn_index), vertex_index).clip;
}

@fragment
fn raster_fragment(@invariant @builtin(position) position: vec4<f32>) {
    atomicAdd(&color[pixel_index(position)], 1u);
}
