// Trilinear sampling from the texel buffer by hand: sRGB is decoded before filtering; and the
// cutoffs of masked materials, whose tables lie behind the texels. Reads `texels`.
#import types
#import material
#import srgb
#import hash

const CUTOFFS_A_MIP: f32 = 4.0;
// Pixels from a pixel's middle, along both axes, to the four places where a mask looks its alpha
// up.
const MASK_SPREAD_PX: f32 = 0.35;
// Share of its alpha by which a texel of a mip may count as more or less, twice.
const MASK_NOISE: f32 = 0.25;

// Linear RGBA at `uv`, whose changes over one pixel to the right and one pixel down are `uv_dx` and `uv_dy`.
fn sample_texture(
    record: TextureRecord,
    flags: u32,
    uv: vec2<f32>,
    uv_dx: vec2<f32>,
    uv_dy: vec2<f32>,
) -> vec4<f32> {
    return sample_lod(record, flags, uv, texture_lod(record, uv_dx, uv_dy));
}

// Mip that a footprint asks for, with what lies between two; 0 where a texel covers more than a
// pixel.
fn texture_lod(record: TextureRecord, uv_dx: vec2<f32>, uv_dy: vec2<f32>) -> f32 {
    let size = vec2<f32>(f32(record.width), f32(record.height));
    let across = uv_dx * size;
    let down = uv_dy * size;
    let footprint = max(dot(across, across), dot(down, down));
    if !(footprint > 1.0) {
        return 0.0;
    }
    return min(0.5 * log2(footprint), f32(record.mip_count - 1u));
}

// Linear RGBA at `uv` in the mips around `lod`.
fn sample_lod(record: TextureRecord, flags: u32, uv: vec2<f32>, lod: f32) -> vec4<f32> {
    let wrapped = wrap_uv(flags, uv);
    if !(lod > 0.0) {
        if (flags & MATERIAL_NEAREST) != 0u {
            let at = floor(wrapped * vec2<f32>(f32(record.width), f32(record.height)));
            return load_texel(record.first_word, record.width, record.height, flags, vec2<i32>(at));
        }
        return sample_mip(record, 0u, flags, wrapped);
    }
    let last = record.mip_count - 1u;
    let mip = u32(lod);
    let fine = sample_mip(record, mip, flags, wrapped);
    let share = lod - f32(mip);
    if share == 0.0 {
        return fine;
    }
    return mix(fine, sample_mip(record, min(mip + 1u, last), flags, wrapped), share);
}

// Alpha of a mask. Where a texel is as large as a pixel, one bilinear sample has the contrast of
// the texels at their middles and half of it between: the cover of a picture would hang on how
// pixels fall on texels. The mean of four has the same contrast everywhere.
fn mask_alpha(
    record: TextureRecord,
    flags: u32,
    uv: vec2<f32>,
    uv_dx: vec2<f32>,
    uv_dy: vec2<f32>,
    lod: f32,
    noise: f32,
) -> f32 {
    if !(lod > 0.0) {
        return sample_lod(record, flags, uv, 0.0).a;
    }
    let spread = MASK_SPREAD_PX * min(lod, 1.0);
    var sum = 0.0;
    for (var tap = 0u; tap < 4u; tap++) {
        let side = select(-spread, spread, (tap & 1u) != 0u);
        let other = select(-spread, spread, (tap & 2u) != 0u);
        sum += sample_lod(record, flags, uv + uv_dx * side + uv_dy * other, lod).a;
    }
    return sum * 0.25 * (1.0 + noise * mask_noise(record, uv, u32(lod)));
}

// Where the mips of a regular pattern (a grate, a mesh of wires) become one alpha, a cutoff lets
// all of it pass or nothing. So each texel counts as a little more or less, and a share of them
// passes.
// Alpha zero stays zero.
fn mask_noise(record: TextureRecord, uv: vec2<f32>, mip: u32) -> f32 {
    let size = vec2<u32>(max(record.width >> mip, 1u), max(record.height >> mip, 1u));
    let texel = vec2<i32>(floor(uv * vec2<f32>(size)));
    let bits = hash(u32(texel.x) ^ hash(u32(texel.y)));
    return MASK_NOISE * (f32(bits >> 8u) / 16777216.0 - 0.5);
}

// Alpha that a masked material cuts at where its texture is looked up at `lod`, and the share of
// the noise in the alpha that it cuts. A negative entry is a cutoff for alpha with noise.
fn mask_cutoff(material: MaterialRecord, lod: f32) -> vec2<f32> {
    if material.mask_cutoffs == NO_MASK_CUTOFFS {
        return vec2<f32>(material.alpha_cutoff, 0.0);
    }
    // A lod is at most the last mip, whose cutoff is the table's last.
    let place = lod * CUTOFFS_A_MIP;
    let word = material.mask_cutoffs + u32(place);
    let share = place - floor(place);
    let finer = mask_entry(texels[word]);
    if share == 0.0 {
        return finer;
    }
    return mix(finer, mask_entry(texels[word + 1u]), share);
}

fn mask_entry(word: u32) -> vec2<f32> {
    let entry = bitcast<f32>(word);
    return vec2<f32>(abs(entry), select(0.0, 1.0, entry < 0.0));
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
