// `raster` for scenes in which a material can hide a fragment: masked ones below their alpha cutoff, single-sided ones
// from behind. The host records it instead of `raster` when any material has MASK or lacks DOUBLE_SIDED.
//
// The vertex stage looks the material up, once a corner; the fragment stage tests the side, then the alpha.
// Drawn like `raster`, front face counter-clockwise.
#import types
#import fetch_vertex
#import hardware_list
#import material
#import sample_texture
#import visbuffer

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> scene: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> instances: array<InstanceRecord>;
@group(0) @binding(3) var<storage, read> clusters: array<ClusterItem>;
@group(0) @binding(4) var<storage, read> args: IndirectArgs;
@group(0) @binding(5) var<storage, read> draw_lists: array<u32>;
@group(0) @binding(6) var<storage, read_write> visbuffer: array<VisbufferWord>;
@group(0) @binding(7) var<storage, read> texels: array<u32>;

// How far below the cutoff alpha may come out of f32 arithmetic, and of the eight bits of a vertex.
const ALPHA_SLACK: f32 = 0.000244140625;
const VERTEX_ALPHA_SLACK: f32 = 0.0019607844;

struct Fragment {
    @invariant @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat, either) id: u32,
    @location(1) @interpolate(flat, either) material: u32,
    @location(2) @interpolate(flat, either) mirrored: u32,
    @location(3) uv: vec2<f32>,
    @location(4) alpha: f32,
}

@vertex
fn raster_vertex(@builtin(vertex_index) vertex_index: u32, @builtin(instance_index) drawn_index: u32) -> Fragment {
    let visible_index = hardware_index(drawn_index);
    let corner = fetch_corner(visible_index, vertex_index);
    let instance = instances[visible_item(visible_index).instance];
    let asset = load_asset(instance.asset);
    var fragment = Fragment(corner.clip, corner.id, 0u, instance.mirrored, vec2<f32>(0.0), 1.0);
    if corner.drawn == 0u {
        return fragment;
    }
    fragment.material = material_of(asset, corner.cluster, corner.triangle);
    let material = load_material(fragment.material);
    if (material.flags & MATERIAL_MASK) != 0u {
        if cluster_has_uvs(corner.cluster) {
            let uv = cluster_uv(corner.cluster, corner.vertex, asset.uv_step);
            fragment.uv = transform_uv(material, vec3<f32>(uv, 1.0));
        }
        if cluster_has_colors(corner.cluster) {
            let alpha = cluster_color(corner.cluster, corner.vertex).a;
            fragment.alpha = select(0.0, min(alpha + VERTEX_ALPHA_SLACK, 1.0), alpha > 0.0);
        }
    }
    return fragment;
}

@fragment
fn raster_fragment(
    fragment: Fragment,
    @builtin(front_facing) front_facing: bool,
) -> @location(0) u32 {
    // Derivatives first: they need every lane of the quad.
    let uv_dx = dpdx(fragment.uv);
    let uv_dy = dpdy(fragment.uv);
    let material = load_material(fragment.material);
    let front = front_facing != (fragment.mirrored != 0u);
    var hidden = !front && (material.flags & MATERIAL_DOUBLE_SIDED) == 0u;
    if !hidden && (material.flags & MATERIAL_MASK) != 0u {
        var alpha = material.base_color.a * fragment.alpha;
        var cutoff = material.alpha_cutoff;
        if material.texture != NO_TEXTURE {
            let record = load_texture_record(material.texture);
            let lod = texture_lod(record, uv_dx, uv_dy);
            let cut = mask_cutoff(material, lod);
            cutoff = cut.x;
            alpha *= mask_alpha(record, material.flags, fragment.uv, uv_dx, uv_dy, lod, cut.y);
        }
        // A fragment whose alpha equals the cutoff is kept.
        hidden = alpha + ALPHA_SLACK < cutoff;
    }
    if hidden {
        discard;
    }
    let depth_bits = bitcast<u32>(fragment.position.z);
    store_visbuffer(pixel_index(fragment.position), depth_bits, fragment.id);
    return fragment.id;
}
