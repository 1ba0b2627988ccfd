// Instances below a pixel: a point with the mean look of the asset from its six sides. Needs the
// bindings `view` and `scene`.
//
// A pixel's sample meets an instance with the probability of the area that it covers. So a point
// is drawn in the pixel of the instance's middle with that probability, by a hash of the
// instance: the same in every frame, and a crowd of them has its mean coverage and colour.
#import error_metric
#import scene
#import light
#import srgb
#import hash

// Of `ClusterItem.page`: the item is a point, the rest is its pixel; `cluster` is its colour,
// `page_word` the bits of its depth.
const POINT_FLAG: u32 = 0x80000000u;
const PROXY_ROWS: u32 = 7u;
const MOST_EMISSIVE: f32 = 16.0;

struct Point {
    item: ClusterItem,
    drawn: bool,
}

fn proxy_center(asset: AssetRecord) -> vec3<f32> {
    return asset.aabb_min + (asset.aabb_max - asset.aabb_min) * 0.5;
}

// Whether an instance is at most a pixel error wide, and at most a pixel.
fn draws_as_point(instance: InstanceRecord, asset: AssetRecord) -> bool {
    if is_reference(view) || view.instance_count < 2u {
        return false;
    }
    let half_size = (asset.aabb_max - asset.aabb_min) * 0.5;
    let radius = sqrt(dot3(half_size, half_size));
    let width_px = projected_error_px(view, instance, proxy_center(asset), radius, 2.0 * radius, 0.0);
    return width_px <= min(view.pixel_error_px, 1.0);
}

fn point_of(index: u32, instance: InstanceRecord, asset: AssetRecord) -> Point {
    var point: Point;
    let rel = rel_from_local(instance, view, proxy_center(asset));
    let clip = view.clip_from_rel * vec4<f32>(rel, 1.0);
    if !(clip.w > view.near_metres) {
        return point;
    }
    let size = vec2<f32>(view.size_px);
    let px = vec2<f32>(0.5 + 0.5 * (clip.x / clip.w), 0.5 - 0.5 * (clip.y / clip.w)) * size;
    if !(px.x >= 0.0 && px.y >= 0.0 && px.x < size.x && px.y < size.y) {
        return point;
    }
    let distance = sqrt(dot3(rel, rel));
    let to_eye = safe_normalize(-rel, -view.forward);
    // Columns of the cofactor matrix: they map normals and areas.
    let sign = select(1.0, -1.0, instance.mirrored != 0u);
    let face_x = cross(instance.linear_y, instance.linear_z) * sign;
    let face_y = cross(instance.linear_z, instance.linear_x) * sign;
    let face_z = cross(instance.linear_x, instance.linear_y) * sign;
    let toward = vec3<f32>(dot(face_x, to_eye), dot(face_y, to_eye), dot(face_z, to_eye));
    let row = view.proxy_row + instance.proxy * PROXY_ROWS;
    let first = bitcast<vec4<f32>>(scene[row]);
    let areas = first.xyz * abs(toward);
    let sum = sum3(areas);
    let root = sqrt(dot3(areas, areas));
    let area_m2 = root * (1.0 - first.w) + sum * first.w;
    let px_a_metre = view.pixels_at_one_metre / clip.w;
    let area_px = area_m2 * px_a_metre * px_a_metre * (distance / clip.w);
    if f32(hash(index) >> 8u) / 16777216.0 >= area_px {
        return point;
    }
    var color = vec3<f32>(0.0);
    for (var axis = 0u; axis < 3u; axis++) {
        let side = scene[row + 1u + 2u * axis + select(0u, 1u, toward[axis] < 0.0)];
        let local = proxy_normal(side.w);
        let normal = safe_normalize(face_x * local.x + face_y * local.y + face_z * local.z, to_eye);
        let green_blue = unpack2x16unorm(side.z);
        let blue_red = unpack2x16unorm(side.y);
        let base_color = vec3<f32>(unpack2x16unorm(side.x), blue_red.x);
        let emissive = vec3<f32>(blue_red.y, green_blue) * MOST_EMISSIVE;
        let metallic = f32((side.w >> 24u) & 15u) / 15.0;
        let roughness = f32(side.w >> 28u) / 15.0;
        let lit = light_surface(base_color, metallic, roughness, normal, to_eye);
        color += (lit + emissive) * (areas[axis] / sum);
    }
    let pixel = u32(px.y) * view.size_px.x + u32(px.x);
    let srgb = pack_color(srgb_from_linear(tone(color)));
    point.item = ClusterItem(index, POINT_FLAG | pixel, srgb, bitcast<u32>(clip.z / clip.w));
    point.drawn = true;
    return point;
}

// Mean normal of a side, local.
fn proxy_normal(word: u32) -> vec3<f32> {
    let parts = (vec3<u32>(word) >> vec3<u32>(0u, 8u, 16u)) & vec3<u32>(255u);
    return vec3<f32>(parts) / 127.0 - 1.0;
}
