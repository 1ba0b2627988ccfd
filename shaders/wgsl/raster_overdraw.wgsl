// Fragments a pixel, for the overdraw picture alone. Drawn like `raster`.
#import types
#import fetch_vertex

@group(0) @binding(0) var<storage, read> view: View;
@group(0) @binding(1) var<storage, read> instances: array<InstanceRecord>;
@group(0) @binding(2) var<storage, read> assets: array<AssetRecord>;
@group(0) @binding(3) var<storage, read> visible: array<ClusterItem>;
@group(0) @binding(4) var<storage, read_write> fragment_counts: array<atomic<u32>>;

@vertex
fn raster_vertex(
    @builtin(vertex_index) vertex_index: u32,
    @builtin(instance_index) visible_index: u32,
) -> @invariant @builtin(position) vec4<f32> {
    return fetch_corner(visible_index, vertex_index).clip;
}

@fragment
fn raster_fragment(@invariant @builtin(position) position: vec4<f32>) {
    atomicAdd(&fragment_counts[pixel_index(position)], 1u);
}
