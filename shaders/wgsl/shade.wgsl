// Visbuffer to colours, a thread a pixel: dispatch ceil(width / 8) x ceil(height / 8) workgroups.
//
// The id names the triangle; its attributes are fetched and interpolated here, with analytic
// derivatives for the texture. `color` gets sRGB bytes, RGBA from the low byte, alpha 255. In
// overdraw mode it holds the fragment counts before.
#import types
#import surface
#import srgb
#import light
#import false_color
#import raster_choice

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> scene: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> instances: array<InstanceRecord>;
@group(0) @binding(3) var<storage, read> clusters: array<ClusterItem>;
// x is the id, y the depth's bits.
@group(0) @binding(4) var<storage, read> visbuffer: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> texels: array<u32>;
@group(0) @binding(6) var<storage, read_write> color: array<u32>;
@group(0) @binding(7) var<storage, read_write> counters: Counters;

// Of `ClusterItem.page`, as in `proxy`.
const POINT_FLAG: u32 = 0x80000000u;

// ShadeMode of types.rs.
const MODE_SHADED: u32 = 0u;
const MODE_TRIANGLES: u32 = 1u;
const MODE_CLUSTERS: u32 = 2u;
const MODE_GROUPS: u32 = 3u;
const MODE_LEVELS: u32 = 4u;
const MODE_PAGES: u32 = 5u;
const MODE_DEPTH: u32 = 6u;
const MODE_NORMALS: u32 = 7u;
const MODE_OVERDRAW: u32 = 8u;
const MODE_RASTER: u32 = 9u;
const MODE_MATERIALS: u32 = 10u;
const MODE_INSTANCES: u32 = 11u;

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) pixel: vec3<u32>) {
    if pixel.x >= view.size_px.x || pixel.y >= view.size_px.y {
        return;
    }
    let index = pixel.y * view.size_px.x + pixel.x;
    note_rounding(visbuffer[index], pixel.xy);
    color[index] = pixel_color(index, pixel.xy);
}

// Half the diagonal of a cell of the position grid, in steps.
const ROUNDING_STEPS: f32 = 0.8660255;
// The same with a quarter for the place of the instance, which ingest rounds where there are many.
const MOVED_STEPS: f32 = 1.0825319;
const FEW_INSTANCES: u32 = 64u;

// The finest clusters show the rounding of the source. Where that is more than the pixel error, the
// picture's error is it. Coarser clusters count it in their own error, which is below.
fn note_rounding(word: vec2<u32>, pixel: vec2<u32>) {
    if word.y == 0u {
        return;
    }
    let item = visible_item(word.x >> TRIANGLE_BITS);
    if is_point(item) {
        return;
    }
    let instance = instances[item.instance];
    let steps = select(ROUNDING_STEPS, MOVED_STEPS, view.instance_count > FEW_INSTANCES);
    let moved = steps * load_asset(instance.asset).position_step * instance.max_scale;
    let depth = view.near_metres / bitcast<f32>(word.y);
    // Of the pixel's ray, as in `error_metric`.
    let size = vec2<f32>(view.size_px);
    let across = (vec2<f32>(pixel) + 0.5 - 0.5 * size) / view.pixels_at_one_metre;
    let secant = sqrt(1.0 + across.x * across.x + across.y * across.y);
    let px = moved * view.pixels_at_one_metre * secant / depth;
    if px > view.pixel_error_px {
        atomicMax(&counters.rounding_px_bits, bitcast<u32>(px));
    }
}

fn pixel_color(index: u32, pixel: vec2<u32>) -> u32 {
    let word = visbuffer[index];
    if view.shade_mode == MODE_OVERDRAW {
        return overdraw_color(color[index]);
    }
    if word.y == 0u {
        return background(pixel.y);
    }
    if view.shade_mode == MODE_DEPTH {
        return depth_color(bitcast<f32>(word.y));
    }
    let item = visible_item(word.x >> TRIANGLE_BITS);
    if is_point(item) {
        return point_color(item);
    }
    let surface = load_surface(word.x, pixel);
    switch view.shade_mode {
        case MODE_TRIANGLES: {
            return hash_color(hash(cluster_number(surface)) ^ surface.triangle);
        }
        case MODE_CLUSTERS: {
            return hash_color(cluster_number(surface));
        }
        case MODE_GROUPS: {
            let asset = load_asset(instances[surface.item.instance].asset);
            return hash_color(asset.group_base + surface.cluster.group);
        }
        case MODE_LEVELS: {
            return level_color(cluster_level(surface.cluster));
        }
        case MODE_PAGES: {
            return hash_color(surface.item.page);
        }
        case MODE_NORMALS: {
            return pack_color(surface.normal * 0.5 + 0.5);
        }
        case MODE_RASTER: {
            let instance = instances[surface.item.instance];
            let by_compute = draws_by_compute(instance, load_asset(instance.asset), surface.cluster);
            return select(HARDWARE_COLOR, COMPUTE_COLOR, by_compute);
        }
        case MODE_MATERIALS: {
            return hash_color(surface.material);
        }
        case MODE_INSTANCES: {
            return hash_color(surface.item.instance);
        }
        default: {
            return shaded_color(surface);
        }
    }
}

fn is_point(item: ClusterItem) -> bool {
    return (item.page & POINT_FLAG) != 0u;
}

fn point_color(item: ClusterItem) -> u32 {
    switch view.shade_mode {
        case MODE_SHADED: {
            return item.cluster;
        }
        case MODE_INSTANCES: {
            return hash_color(item.instance);
        }
        default: {
            return POINT_COLOR;
        }
    }
}

fn shaded_color(surface: Surface) -> u32 {
    let material = load_material(surface.material);
    if (material.flags & MATERIAL_UNLIT) != 0u {
        return pack_color(srgb_from_linear(min(surface.base_color, vec3<f32>(1.0))));
    }
    let lit = light_surface(
        surface.base_color,
        material.metallic,
        material.roughness,
        surface.normal,
        surface.to_eye,
    );
    return pack_color(srgb_from_linear(tone(lit + material.emissive)));
}

// A page holds at most 2^11 clusters.
fn cluster_number(surface: Surface) -> u32 {
    return (surface.item.page << 11u) | surface.item.cluster;
}

// A soft sky behind the picture, plain dark grey behind a diagnostic one.
fn background(row: u32) -> u32 {
    if view.shade_mode != MODE_SHADED {
        return EMPTY_COLOR;
    }
    let share = (f32(row) + 0.5) / f32(view.size_px.y);
    return pack_color(mix(SKY_TOP_SRGB, SKY_BOTTOM_SRGB, share));
}

// White at the near plane, black from 2^20 times its distance on, a grey step of 12.75 a doubling.
fn depth_color(depth: f32) -> u32 {
    let doublings = -log2(depth);
    return pack_color(vec3<f32>(1.0 - doublings / 20.0));
}

// Black, then a ramp over the logarithm: 1 is blue, 32 and more are white.
fn overdraw_color(fragments: u32) -> u32 {
    if fragments == 0u {
        return EMPTY_COLOR;
    }
    let doublings = firstLeadingBit(fragments);
    // Eighths between the doublings, in integers.
    let rest = ((fragments << 3u) >> doublings) & 7u;
    return ramp_color(min(doublings, 5u) * 8u + select(rest, 0u, doublings >= 5u), 40u);
}
