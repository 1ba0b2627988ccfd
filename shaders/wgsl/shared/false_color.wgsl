// Colours of the diagnostic pictures, sRGB bytes in a word as `color` holds them. Integers, so that GPU and twin agree exactly.
#import hash

fn opaque(red: u32, green: u32, blue: u32) -> u32 {
    return red | (green << 8u) | (blue << 16u) | 0xff000000u;
}

// A saturated colour of any hue for a number.
fn hash_color(value: u32) -> u32 {
    let bits = hash(value);
    let hue = bits % 1536u;
    let rise = hue % 256u;
    let fall = 255u - rise;
    var rgb = vec3<u32>(255u, rise, 0u);
    switch hue / 256u {
        case 1u: { rgb = vec3<u32>(fall, 255u, 0u); }
        case 2u: { rgb = vec3<u32>(0u, 255u, rise); }
        case 3u: { rgb = vec3<u32>(0u, fall, 255u); }
        case 4u: { rgb = vec3<u32>(rise, 0u, 255u); }
        case 5u: { rgb = vec3<u32>(255u, 0u, fall); }
        default: {}
    }
    let low = 40u + ((bits >> 11u) & 63u);
    let span = 80u + ((bits >> 17u) & 63u);
    return opaque(low + rgb.x * span / 255u, low + rgb.y * span / 255u, low + rgb.z * span / 255u);
}

// Ramp through blue, cyan, green, yellow and red to white; `step` of `steps`.
fn ramp_color(step: u32, steps: u32) -> u32 {
    var stops = array<vec3<u32>, 7>(
        vec3<u32>(24u, 28u, 92u),
        vec3<u32>(40u, 96u, 216u),
        vec3<u32>(32u, 184u, 200u),
        vec3<u32>(72u, 192u, 64u),
        vec3<u32>(240u, 208u, 48u),
        vec3<u32>(224u, 64u, 40u),
        vec3<u32>(255u, 244u, 236u),
    );
    let place = min(step, steps) * 6u;
    let stop = min(place / steps, 5u);
    let share = place - stop * steps;
    let rgb = (stops[stop] * (steps - share) + stops[stop + 1u] * share) / steps;
    return opaque(rgb.x, rgb.y, rgb.z);
}

// Level 0, the source, is red; each coarser one a clearly other colour, in the order of the rainbow; twelve, then again.
fn level_color(level: u32) -> u32 {
    var colors = array<vec3<u32>, 12>(
        vec3<u32>(214u, 48u, 39u),
        vec3<u32>(244u, 124u, 48u),
        vec3<u32>(250u, 188u, 72u),
        vec3<u32>(226u, 226u, 90u),
        vec3<u32>(146u, 204u, 78u),
        vec3<u32>(44u, 162u, 84u),
        vec3<u32>(38u, 178u, 172u),
        vec3<u32>(70u, 150u, 222u),
        vec3<u32>(52u, 88u, 190u),
        vec3<u32>(104u, 64u, 180u),
        vec3<u32>(170u, 80u, 190u),
        vec3<u32>(222u, 110u, 168u),
    );
    let rgb = colors[level % 12u];
    return opaque(rgb.x, rgb.y, rgb.z);
}

// Pixels that nothing covers.
const EMPTY_COLOR: u32 = 0xff1c1818u;
// Drawn by the hardware rasterizer.
const HARDWARE_COLOR: u32 = 0xff3c8ce6u;
const COMPUTE_COLOR: u32 = 0xffb4783cu;
// Instances below a pixel.
const POINT_COLOR: u32 = 0xff9bd25au;
