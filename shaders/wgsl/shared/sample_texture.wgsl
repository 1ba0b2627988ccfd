// Trilinear sampling from the texel buffer by hand: sRGB is decoded before filtering. Reads `texels`.
#import types
#import material
#import srgb

// Linear RGBA at `uv`, whose changes over one pixel to the right and one pixel down are `uv_dx` and `uv_dy`.
fn sample_texture(
    record: TextureRecord,
    flags: u32,
    uv: vec2<f32>,
    uv_dx: vec2<f32>,
    uv_dy: vec2<f32>,
) -> vec4<f32> {
    let size = vec2<f32>(f32(record.width), f32(record.height));
    let across = uv_dx * size;
    let down = uv_dy * size;
    let footprint = max(dot(across, across), dot(down, down));
    let wrapped = wrap_uv(flags, uv);
    if !(footprint > 1.0) {
        if (flags & MATERIAL_NEAREST) != 0u {
            return load_texel(record.first_word, record.width, record.height, flags, vec2<i32>(floor(wrapped * size)));
        }
        return sample_mip(record, 0u, flags, wrapped);
    }
    let last = record.mip_count - 1u;
    let lod = min(0.5 * log2(footprint), f32(last));
    let mip = u32(lod);
    let fine = sample_mip(record, mip, flags, wrapped);
    let share = lod - f32(mip);
    if share == 0.0 {
        return fine;
    }
    return mix(fine, sample_mip(record, min(mip + 1u, last), flags, wrapped), share);
}

// Bilinear at `wrapped` (0..=1) in one mip.
fn sample_mip(record: TextureRecord, mip: u32, flags: u32, wrapped: vec2<f32>) -> vec4<f32> {
    var first_word = record.first_word;
    var width = record.width;
    var height = record.height;
    for (var finer = 0u; finer < mip; finer++) {
        first_word += width * height;
        width = max(width / 2u, 1u);
        height = max(height / 2u, 1u);
    }
    let place = wrapped * vec2<f32>(f32(width), f32(height)) - 0.5;
    let corner = floor(place);
    let share = place - corner;
    let at = vec2<i32>(corner);
    let top = mix(
        load_texel(first_word, width, height, flags, at),
        load_texel(first_word, width, height, flags, at + vec2<i32>(1, 0)),
        share.x,
    );
    let bottom = mix(
        load_texel(first_word, width, height, flags, at + vec2<i32>(0, 1)),
        load_texel(first_word, width, height, flags, at + vec2<i32>(1, 1)),
        share.x,
    );
    return mix(top, bottom, share.y);
}

// `at` lies at most one texel outside. A mirrored border repeats its texel, as clamping does.
fn load_texel(first_word: u32, width: u32, height: u32, flags: u32, at: vec2<i32>) -> vec4<f32> {
    let x = wrap_texel(at.x, i32(width), (flags & (MATERIAL_CLAMP_U | MATERIAL_MIRROR_U)) == 0u);
    let y = wrap_texel(at.y, i32(height), (flags & (MATERIAL_CLAMP_V | MATERIAL_MIRROR_V)) == 0u);
    let texel = unpack4x8unorm(texels[first_word + u32(y) * width + u32(x)]);
    return vec4<f32>(linear_from_srgb(texel.rgb), texel.a);
}

fn wrap_texel(at: i32, size: i32, repeats: bool) -> i32 {
    if repeats && at < 0 {
        return size - 1;
    }
    if repeats && at >= size {
        return 0;
    }
    return clamp(at, 0, size - 1);
}

fn wrap_uv(flags: u32, uv: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(
        wrap_coordinate(uv.x, (flags & MATERIAL_CLAMP_U) != 0u, (flags & MATERIAL_MIRROR_U) != 0u),
        wrap_coordinate(uv.y, (flags & MATERIAL_CLAMP_V) != 0u, (flags & MATERIAL_MIRROR_V) != 0u),
    );
}

// To 0..=1.
fn wrap_coordinate(value: f32, clamps: bool, mirrors: bool) -> f32 {
    if clamps {
        return min(max(value, 0.0), 1.0);
    }
    if mirrors {
        let period = value - 2.0 * floor(value * 0.5);
        return 1.0 - abs(1.0 - period);
    }
    return value - floor(value);
}
