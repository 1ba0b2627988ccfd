//! Trilinear sampling from the texel buffer. Twin of `wgsl/shared/sample_texture.wgsl`.

use glam::{Vec2, Vec4};

use super::hash::hash;
use super::mask_cutoffs::{ENTRIES_A_MIP, MASK_NOISE, MASK_SPREAD_PX};
use super::srgb::linear_from_byte;
use super::texture::Textures;
use crate::types::{MaterialRecord, NO_MASK_CUTOFFS, TextureRecord, material_flag};

/// One mip in the texel words.
#[derive(Debug, Clone, Copy)]
struct Mip {
    first_word: u32,
    width: u32,
    height: u32,
}

/// Linear RGBA at `uv` (before the material's texture transform), whose changes over one pixel to the right and down are
/// `uv_dx` and `uv_dy`. White where the material has no texture.
pub fn sample_material(
    textures: &Textures,
    material: &MaterialRecord,
    uv: Vec2,
    uv_dx: Vec2,
    uv_dy: Vec2,
) -> Vec4 {
    let Some(record) = textures.records.get(material.texture as usize) else {
        return Vec4::ONE;
    };
    sample_texture(
        &textures.words,
        record,
        material.flags,
        transform_uv(material, uv, 1.0),
        transform_uv(material, uv_dx, 0.0),
        transform_uv(material, uv_dy, 0.0),
    )
}

/// Alpha of a masked material at `uv`, before its texture transform, and the alpha that it cuts at;
/// 1 for the first where it has no texture.
pub fn sample_mask(
    textures: &Textures,
    material: &MaterialRecord,
    uv: Vec2,
    uv_dx: Vec2,
    uv_dy: Vec2,
) -> (f32, f32) {
    let Some(record) = textures.records.get(material.texture as usize) else {
        return (1.0, material.alpha_cutoff);
    };
    let uv = transform_uv(material, uv, 1.0);
    let [dx, dy] = [uv_dx, uv_dy].map(|uv| transform_uv(material, uv, 0.0));
    let lod = texture_lod(record, dx, dy);
    let (cutoff, noise) = mask_cutoff(&textures.words, material, lod);
    let at = [uv, dx, dy];
    let alpha = mask_alpha(&textures.words, record, material.flags, at, lod, noise);
    (alpha, cutoff)
}

/// Alpha of a mask at the transformed coordinates, which come with their changes to the right and
/// down, with a share of noise; the WGSL says why it looks up four places.
pub fn mask_alpha(
    words: &[u32],
    record: &TextureRecord,
    flags: u32,
    [uv, uv_dx, uv_dy]: [Vec2; 3],
    lod: f32,
    noise: f32,
) -> f32 {
    if lod <= 0.0 {
        return sample_lod(words, record, flags, uv, 0.0).w;
    }
    let spread = MASK_SPREAD_PX * lod.min(1.0);
    let mut sum = 0.0;
    for tap in 0..4 {
        let side = if tap & 1 != 0 { spread } else { -spread };
        let other = if tap & 2 != 0 { spread } else { -spread };
        sum += sample_lod(words, record, flags, uv + uv_dx * side + uv_dy * other, lod).w;
    }
    sum * 0.25 * (1.0 + noise * mask_noise(record, uv, lod as u32))
}

/// Share by which a texel's alpha counts as more; the WGSL says why.
fn mask_noise(record: &TextureRecord, uv: Vec2, mip: u32) -> f32 {
    let size = [record.width, record.height].map(|side| (side >> mip).max(1) as f32);
    let texel = (uv * Vec2::from(size)).floor().as_ivec2();
    let bits = hash(texel.x as u32 ^ hash(texel.y as u32));
    MASK_NOISE * ((bits >> 8) as f32 / 16_777_216.0 - 0.5)
}

/// The alpha that a material cuts at, and the share of the noise in the alpha that it cuts.
fn mask_cutoff(words: &[u32], material: &MaterialRecord, lod: f32) -> (f32, f32) {
    if material.mask_cutoffs == NO_MASK_CUTOFFS {
        return (material.alpha_cutoff, 0.0);
    }
    let place = lod * ENTRIES_A_MIP as f32;
    let entry = |number: u32| {
        let word = words.get((material.mask_cutoffs + number) as usize);
        word.map_or(material.alpha_cutoff, |&bits| f32::from_bits(bits))
    };
    let parts = |entry: f32| (entry.abs(), if entry < 0.0 { 1.0 } else { 0.0 });
    let (finer, share) = (parts(entry(place as u32)), place.fract());
    if share == 0.0 {
        return finer;
    }
    let coarser = parts(entry(place as u32 + 1));
    let mix = |a: f32, b: f32| a * (1.0 - share) + b * share;
    (mix(finer.0, coarser.0), mix(finer.1, coarser.1))
}

/// `point` is 1 for a point, 0 for a derivative.
fn transform_uv(material: &MaterialRecord, uv: Vec2, point: f32) -> Vec2 {
    let row = |row: [f32; 3]| row[0] * uv.x + row[1] * uv.y + row[2] * point;
    Vec2::new(row(material.uv_row_u), row(material.uv_row_v))
}

/// Linear RGBA of the texture `record` in `words` at the transformed `uv`; `flags` are the material's.
pub fn sample_texture(
    words: &[u32],
    record: &TextureRecord,
    flags: u32,
    uv: Vec2,
    uv_dx: Vec2,
    uv_dy: Vec2,
) -> Vec4 {
    sample_lod(words, record, flags, uv, texture_lod(record, uv_dx, uv_dy))
}

/// Mip that a footprint asks for, with what lies between two; 0 where a texel covers more than a
/// pixel.
pub fn texture_lod(record: &TextureRecord, uv_dx: Vec2, uv_dy: Vec2) -> f32 {
    let size = Vec2::new(record.width as f32, record.height as f32);
    let (across, down) = (uv_dx * size, uv_dy * size);
    let footprint = across.dot(across).max(down.dot(down));
    if footprint.is_nan() || footprint <= 1.0 {
        return 0.0;
    }
    (0.5 * footprint.log2()).min((record.mip_count - 1) as f32)
}

/// Linear RGBA at the transformed `uv` in the mips around `lod`.
pub fn sample_lod(words: &[u32], record: &TextureRecord, flags: u32, uv: Vec2, lod: f32) -> Vec4 {
    let wrapped = wrap_uv(flags, uv);
    if lod <= 0.0 {
        let mip = mip_of(record, 0);
        if flags & material_flag::NEAREST != 0 {
            let at = (wrapped * Vec2::new(record.width as f32, record.height as f32)).floor();
            return load_texel(words, mip, flags, at.x as i32, at.y as i32);
        }
        return sample_mip(words, mip, flags, wrapped);
    }
    let last = record.mip_count - 1;
    let mip = lod as u32;
    let fine = sample_mip(words, mip_of(record, mip), flags, wrapped);
    let share = lod - mip as f32;
    if share == 0.0 {
        return fine;
    }
    let coarse = sample_mip(words, mip_of(record, (mip + 1).min(last)), flags, wrapped);
    mix(fine, coarse, share)
}

fn mix(a: Vec4, b: Vec4, share: f32) -> Vec4 {
    a * (1.0 - share) + b * share
}

fn mip_of(record: &TextureRecord, mip: u32) -> Mip {
    let finest = Mip {
        first_word: record.first_word,
        width: record.width,
        height: record.height,
    };
    (0..mip).fold(finest, |finer, _| Mip {
        first_word: finer.first_word + finer.width * finer.height,
        width: (finer.width / 2).max(1),
        height: (finer.height / 2).max(1),
    })
}

fn sample_mip(words: &[u32], mip: Mip, flags: u32, wrapped: Vec2) -> Vec4 {
    let place = wrapped * Vec2::new(mip.width as f32, mip.height as f32) - 0.5;
    let corner = place.floor();
    let share = place - corner;
    let (x, y) = (corner.x as i32, corner.y as i32);
    let load = |x: i32, y: i32| load_texel(words, mip, flags, x, y);
    let top = mix(load(x, y), load(x + 1, y), share.x);
    let bottom = mix(load(x, y + 1), load(x + 1, y + 1), share.x);
    mix(top, bottom, share.y)
}

fn load_texel(words: &[u32], mip: Mip, flags: u32, x: i32, y: i32) -> Vec4 {
    use material_flag::{CLAMP_U, CLAMP_V, MIRROR_U, MIRROR_V};
    let x = wrap_texel(x, mip.width as i32, flags & (CLAMP_U | MIRROR_U) == 0);
    let y = wrap_texel(y, mip.height as i32, flags & (CLAMP_V | MIRROR_V) == 0);
    let word = mip.first_word as usize + y as usize * mip.width as usize + x as usize;
    let [r, g, b, a] = words.get(word).copied().unwrap_or(0).to_le_bytes();
    let [r, g, b] = [r, g, b].map(linear_from_byte);
    Vec4::new(r, g, b, a as f32 / 255.0)
}

fn wrap_texel(at: i32, size: i32, repeats: bool) -> i32 {
    match () {
        () if repeats && at < 0 => size - 1,
        () if repeats && at >= size => 0,
        () => at.clamp(0, size - 1),
    }
}

fn wrap_uv(flags: u32, uv: Vec2) -> Vec2 {
    use material_flag::{CLAMP_U, CLAMP_V, MIRROR_U, MIRROR_V};
    Vec2::new(
        wrap_coordinate(uv.x, flags & CLAMP_U != 0, flags & MIRROR_U != 0),
        wrap_coordinate(uv.y, flags & CLAMP_V != 0, flags & MIRROR_V != 0),
    )
}

fn wrap_coordinate(value: f32, clamps: bool, mirrors: bool) -> f32 {
    if clamps {
        value.clamp(0.0, 1.0)
    } else if mirrors {
        let period = value - 2.0 * (value * 0.5).floor();
        1.0 - (1.0 - period).abs()
    } else {
        value - value.floor()
    }
}
