// The test of a box against the depths that were drawn. Needs the bindings `occluder`, the view
// that drew them, and `hzb`.
//
// Nothing visible is ever hidden: the box's pixels and its nearest depth are bounded with the
// rounding of both, and the depths are the farthest of their pixels. The pyramid halves with sides
// rounded up, so texel i of level L covers just the pixels i << L to (i + 1) << L, whatever the
// size.
#import view

const VIEW_FLAG_OCCLUSION: u32 = 2u;
const VIEW_FLAG_LATE: u32 = 4u;

// Rounding of a corner's way to the screen, as a share of the largest term in it.
const PROJECTION_SLACK: f32 = 9.5367431640625e-7;
// The rasterizer snaps corners to this many pixels.
const SNAP_PX: f32 = 0.00390625;
// How far above its corners' depths the rasterizer may interpolate.
const DEPTH_SLACK: f32 = 1.0000152587890625;
// Texels an axis that one test reads at most.
const MOST_TEXELS: i32 = 4;
// Pixels past which a corner says nothing.
const MOST_PX: f32 = 1e9;

fn tests_occlusion() -> bool {
    return (occluder.flags & VIEW_FLAG_OCCLUSION) != 0u;
}

// Whether this pass decides: hidden here is hidden in this frame.
fn is_late() -> bool {
    return (occluder.flags & VIEW_FLAG_LATE) != 0u;
}

// Whether a local box is behind all depths of its pixels.
fn is_hidden(instance: InstanceRecord, aabb_min: vec3<f32>, aabb_max: vec3<f32>) -> bool {
    let origin = (instance.translation_high - occluder.eye_high) + (instance.translation_low - occluder.eye_low);
    let reach = max(abs(aabb_min), abs(aabb_max));
    let terms = abs(origin) + abs(instance.linear_x) * reach.x + abs(instance.linear_y) * reach.y
        + abs(instance.linear_z) * reach.z;
    let slack_metres = sum3(terms) * PROJECTION_SLACK;
    let half_px = vec2<f32>(occluder.size_px) * 0.5;
    var nearest = 3e38;
    var low_px = vec2<f32>(3e38);
    var high_px = vec2<f32>(-3e38);
    for (var corner = 0u; corner < 8u; corner++) {
        let local = vec3<f32>(
            select(aabb_min.x, aabb_max.x, (corner & 1u) != 0u),
            select(aabb_min.y, aabb_max.y, (corner & 2u) != 0u),
            select(aabb_min.z, aabb_max.z, (corner & 4u) != 0u),
        );
        let rel = origin + instance.linear_x * local.x + instance.linear_y * local.y
            + instance.linear_z * local.z;
        let clip = occluder.clip_from_rel * vec4<f32>(rel, 1.0);
        nearest = min(nearest, clip.w);
        // Pixels right of and below the picture's middle.
        let px = vec2<f32>(clip.x, -clip.y) / clip.w * half_px;
        low_px = min(low_px, px);
        high_px = max(high_px, px);
    }
    let depth = nearest - slack_metres;
    // Not-a-number compares false, so it counts as visible.
    if !(depth > occluder.near_metres) {
        return false;
    }
    let farthest_px = max(max(abs(low_px.x), abs(high_px.x)), max(abs(low_px.y), abs(high_px.y)));
    if !(farthest_px < MOST_PX) {
        return false;
    }
    let slack_px = SNAP_PX + (occluder.pixels_at_one_metre + farthest_px) * slack_metres / depth;
    let size = vec2<i32>(occluder.size_px);
    let low = vec2<i32>(floor(low_px + half_px - slack_px));
    let high = vec2<i32>(floor(high_px + half_px + slack_px));
    if high.x < 0 || high.y < 0 || low.x >= size.x || low.y >= size.y {
        return false;
    }
    let from_px = max(low, vec2<i32>(0));
    let to_px = min(high, size - 1);
    var level = 1u;
    while any((to_px >> vec2<u32>(level)) - (from_px >> vec2<u32>(level)) >= vec2<i32>(MOST_TEXELS)) {
        level++;
    }
    let nearest_bits = bitcast<u32>(occluder.near_metres / depth * DEPTH_SLACK);
    let first = hzb_level(occluder.size_px, level);
    let from_texel = vec2<u32>(from_px >> vec2<u32>(level));
    let to_texel = vec2<u32>(to_px >> vec2<u32>(level));
    for (var y = from_texel.y; y <= to_texel.y; y++) {
        for (var x = from_texel.x; x <= to_texel.x; x++) {
            if hzb[first.x + y * first.y + x] <= nearest_bits {
                return false;
            }
        }
    }
    return true;
}
