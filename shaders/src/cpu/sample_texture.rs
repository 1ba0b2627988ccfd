//! Trilinear sampling from the texel buffer. Twin of `wgsl/shared/sample_texture.wgsl`.

use glam::{Vec2, Vec4};

use super::srgb::linear_from_byte;
use super::texture::Textures;
use crate::types::{MaterialRecord, TextureRecord, material_flag};

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
    let size = Vec2::new(record.width as f32, record.height as f32);
    let (across, down) = (uv_dx * size, uv_dy * size);
    let footprint = across.dot(across).max(down.dot(down));
    let wrapped = wrap_uv(flags, uv);
    if footprint.is_nan() || footprint <= 1.0 {
        let mip = mip_of(record, 0);
        if flags & material_flag::NEAREST != 0 {
            let at = (wrapped * size).floor();
            return load_texel(words, mip, flags, at.x as i32, at.y as i32);
        }
        return sample_mip(words, mip, flags, wrapped);
    }
    let last = record.mip_count - 1;
    let lod = (0.5 * footprint.log2()).min(last as f32);
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
