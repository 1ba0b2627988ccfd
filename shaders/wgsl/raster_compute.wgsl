// Small visible clusters to the visbuffer, a workgroup a cluster: vertices once into workgroup
// memory, then a thread a triangle. Coverage is decided in integers on the grid of `snap`, by the
// top-left rule, as the hardware decides it.
#import types
#import fetch_vertex
#import material
#import visbuffer

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> scene: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> instances: array<InstanceRecord>;
@group(0) @binding(3) var<storage, read> clusters: array<ClusterItem>;
@group(0) @binding(4) var<storage, read> args: IndirectArgs;
@group(0) @binding(5) var<storage, read> draw_lists: array<u32>;
@group(0) @binding(6) var<storage, read_write> visbuffer: array<VisbufferWord>;

const CLUSTER_THREADS: u32 = 64u;
const HALF_PIXEL: i32 = 128;

// Grid position, and depth as bits.
var<workgroup> corners: array<vec3<i32>, 256>;

// Twice the signed area of a, b and p; positive where they go clockwise on the screen.
fn edge(a: vec2<i32>, b: vec2<i32>, p: vec2<i32>) -> i32 {
    return (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
}

// 0 for left and top edges of a clockwise triangle, which own their border, else -1.
fn border_bias(a: vec2<i32>, b: vec2<i32>) -> i32 {
    return select(-1, 0, b.y < a.y || (b.y == a.y && b.x > a.x));
}

fn draw_triangle(corner_a: vec3<i32>, corner_b: vec3<i32>, corner_c: vec3<i32>, id: u32, one_sided: bool, mirrored: bool) {
    // Relative to the first corner's pixel, so that products stay small.
    let base = corner_a.xy & vec2<i32>(~255);
    let a = corner_a.xy - base;
    var b = corner_b.xy - base;
    var c = corner_c.xy - base;
    let area = edge(a, b, c);
    if area == 0 || (one_sided && (area < 0) == mirrored) {
        return;
    }
    var depth_b = bitcast<f32>(corner_b.z);
    var depth_c = bitcast<f32>(corner_c.z);
    if area < 0 {
        let kept = b;
        b = c;
        c = kept;
        let kept_depth = depth_b;
        depth_b = depth_c;
        depth_c = kept_depth;
    }
    let depth_a = bitcast<f32>(corner_a.z);
    // First centre at or after the smallest coordinate, last at or before the largest.
    let picture = vec2<i32>(view.size_px) - 1;
    let first_px = base >> vec2<u32>(8u);
    let low = max((min(a, min(b, c)) + HALF_PIXEL - 1) >> vec2<u32>(8u), -first_px);
    let high = min((max(a, max(b, c)) - HALF_PIXEL) >> vec2<u32>(8u), picture - first_px);
    if low.x > high.x || low.y > high.y {
        return;
    }
    let start = low * 256 + HALF_PIXEL;
    var row_a = edge(b, c, start) + border_bias(b, c);
    var row_b = edge(c, a, start) + border_bias(c, a);
    var row_c = edge(a, b, start) + border_bias(a, b);
    let step_a = (c - b) * 256;
    let step_b = (a - c) * 256;
    let step_c = (b - a) * 256;
    let bias_b = border_bias(c, a);
    let bias_c = border_bias(a, b);
    let scale = 1.0 / f32(abs(area));
    let slope_b = (depth_b - depth_a) * scale;
    let slope_c = (depth_c - depth_a) * scale;
    let least = min(depth_a, min(depth_b, depth_c));
    let most = max(depth_a, max(depth_b, depth_c));
    for (var y = low.y; y <= high.y; y++) {
        var in_a = row_a;
        var in_b = row_b;
        var in_c = row_c;
        for (var x = low.x; x <= high.x; x++) {
            if (in_a | in_b | in_c) >= 0 {
                let interpolated = depth_a + f32(in_b - bias_b) * slope_b + f32(in_c - bias_c) * slope_c;
                let depth = clamp(interpolated, least, most);
                let pixel = vec2<u32>(first_px + vec2<i32>(x, y));
                let index = pixel.y * view.size_px.x + pixel.x;
                store_visbuffer(index, bitcast<u32>(depth), id);
            }
            in_a -= step_a.y;
            in_b -= step_b.y;
            in_c -= step_c.y;
        }
        row_a += step_a.x;
        row_b += step_b.x;
        row_c += step_c.x;
    }
}

@compute @workgroup_size(64)
fn raster_compute(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let drawn_index = workgroup.y * MAX_WORKGROUPS_X + workgroup.x;
    if drawn_index >= args.compute_count {
        return;
    }
    let visible_index = draw_lists[args.first_compute + drawn_index];
    let item = visible_item(visible_index);
    let instance = instances[item.instance];
    let asset = load_asset(instance.asset);
    let cluster = load_cluster(item.page_word, item.cluster);
    let vertices = cluster_vertex_count(cluster);
    for (var vertex = local; vertex < vertices; vertex += CLUSTER_THREADS) {
        let position = cluster_position_local(cluster, vertex, asset.position_step);
        let clip = clip_from_local(instance, position);
        corners[vertex] = vec3<i32>(snap(clip), bitcast<i32>(clip.z / clip.w));
    }
    workgroupBarrier();
    let triangles = cluster_triangle_count(cluster);
    let has_sides = (view.flags & VIEW_FLAG_MASKED) != 0u;
    for (var triangle = local; triangle < triangles; triangle += CLUSTER_THREADS) {
        let vertex = cluster_triangle(cluster, triangle);
        var one_sided = false;
        if has_sides {
            let material = load_material(material_of(asset, cluster, triangle));
            one_sided = (material.flags & MATERIAL_DOUBLE_SIDED) == 0u;
        }
        draw_triangle(
            corners[vertex.x],
            corners[vertex.y],
            corners[vertex.z],
            (visible_index << TRIANGLE_BITS) | triangle,
            one_sided,
            instance.mirrored != 0u,
        );
    }
}
