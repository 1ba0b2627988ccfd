//! Masked materials: what equals the cutoff is kept, and a texture's share stays at any distance.

mod drawing;

use drawing::{Picture, SIZE_PX, UV_STEP, WHITE, camera};
use glam::{DVec3, Vec2};
use lodestream_format::cluster::{Attributes, Cluster};
use lodestream_shaders::cpu::build_textures;
use lodestream_shaders::cpu::sample_texture::sample_mask;
use lodestream_shaders::types::{MaterialRecord, material_flag};

const MASK: u32 = material_flag::DOUBLE_SIDED | material_flag::MASK;

/// A square two metres wide that faces +Z, with one colour where `alpha` is given.
fn square(alpha: Option<u8>) -> (Cluster, u32) {
    let attributes = match alpha {
        Some(_) => Attributes::UV | Attributes::COLOR,
        None => Attributes::UV,
    };
    let mut cluster = drawing::square(0.0, attributes);
    if let Some(alpha) = alpha {
        cluster.colors = vec![[255, 255, 255, alpha]; cluster.positions.len()];
    }
    (cluster, attributes)
}

/// Pixels that are drawn of the square, and of it without a mask.
fn drawn(
    vertex_alpha: Option<u8>,
    texel_alpha: Option<u8>,
    material: MaterialRecord,
) -> [usize; 2] {
    let (cluster, attributes) = square(vertex_alpha);
    let mut picture = Picture::new(&[cluster], attributes);
    // Askew, so that interpolation rounds.
    picture.view = camera(DVec3::new(1.3, 0.7, 2.9), DVec3::ZERO).view(0.01, 1.0);
    let rgba = [255, 255, 255, texel_alpha.unwrap_or(255)].repeat(64);
    picture.textures = build_textures(&[(8, 8, rgba)], 1000).expect("one texture");
    picture.arrays.materials[0] = MaterialRecord {
        texture: if texel_alpha.is_some() {
            0
        } else {
            WHITE.texture
        },
        flags: MASK,
        ..material
    };
    let textures = &mut picture.textures;
    textures.add_mask_cutoffs(&mut picture.arrays.materials);
    let count = |words: Vec<u64>| words.iter().filter(|&&word| word != 0).count();
    [count(picture.raster_masked()), count(picture.raster())]
}

#[test]
fn alpha_that_equals_the_cutoff_is_kept_and_a_step_less_is_not() {
    let with = |factor: f32, cutoff: f32| MaterialRecord {
        base_color: [0.8, 0.8, 0.8, factor],
        alpha_cutoff: cutoff,
        ..WHITE
    };
    let byte = |value: u8| value as f32 / 255.0;
    for (vertex, texel, material, kept) in [
        (None, None, with(0.5, 0.5), true),
        (None, None, with(0.498, 0.5), false),
        (None, Some(128), with(1.0, byte(128)), true),
        // As written with three digits.
        (None, Some(128), with(1.0, 0.502), true),
        (None, Some(127), with(1.0, byte(128)), false),
        (None, Some(128), with(0.5, 0.5 * byte(128)), true),
        (None, Some(255), with(0.3, 0.3), true),
        (Some(255), Some(255), with(0.7, 0.7), true),
        // 0.7 of full alpha is 178.5 steps, kept as 178 or 179.
        (Some(178), None, with(1.0, 0.7), true),
        (Some(177), None, with(1.0, 0.7), false),
        (Some(128), Some(128), with(1.0, byte(128) * byte(128)), true),
        (Some(0), None, with(1.0, 0.001), false),
        (None, Some(0), with(1.0, 0.0), true),
        (None, Some(255), with(1.0, 1.0), true),
        (None, Some(255), with(1.0, 1.01), false),
    ] {
        let [masked, whole] = drawn(vertex, texel, material);
        assert!(whole > 500, "{whole} pixels");
        let expected = if kept { whole } else { 0 };
        let cutoff = material.alpha_cutoff;
        let factor = material.base_color[3];
        assert_eq!(
            masked, expected,
            "vertex {vertex:?}, texel {texel:?}, factor {factor}, cutoff {cutoff}"
        );
    }
}

/// Blades that fill a share of a texture, of alpha that falls off over some texels at their edges.
fn foliage(side: u32, share: f32, soft: f32) -> Vec<u8> {
    let alpha = |x: u32, y: u32| {
        let at = Vec2::new(x as f32, y as f32) / side as f32;
        let wave = 0.5 + 0.5 * (at.y * 17.0 + 2.0 * (at.x * 9.0).sin()).sin();
        let blade = (at.x * 11.0 + 0.3 * wave).fract();
        let width = share * (0.6 + 0.8 * wave);
        let inside = (width - (blade - 0.5).abs() * 2.0) * side as f32 / 22.0;
        ((inside / soft + 0.5).clamp(0.0, 1.0) * 255.0).round() as u8
    };
    (0..side * side)
        .flat_map(|at| [60, 200, 60, alpha(at % side, at / side)])
        .collect()
}

/// Share of the samples that pass where a pixel covers `texels` of the texture.
fn cover(
    textures: &lodestream_shaders::cpu::Textures,
    material: &MaterialRecord,
    texels: f32,
) -> f64 {
    let side = textures.records[0].width as f32;
    let (dx, dy) = (Vec2::new(texels / side, 0.0), Vec2::new(0.0, texels / side));
    let passes = |at: u32| {
        let uv = Vec2::new((at % 200) as f32 + 0.31, (at / 200) as f32 + 0.77) / 200.0;
        let (alpha, cutoff) = sample_mask(textures, material, uv, dx, dy);
        material.base_color[3] * alpha >= cutoff
    };
    (0..40_000).filter(|&at| passes(at)).count() as f64 / 40_000.0
}

#[test]
fn foliage_keeps_its_cover_with_distance() {
    let side = 256;
    for (share, soft, cutoff, factor) in [
        (0.13, 1.0, 0.5, 1.0),
        (0.33, 1.0, 0.5, 1.0),
        (0.13, 8.0, 0.2, 1.0),
        (0.5, 4.0, 0.8, 0.9),
        (0.8, 2.0, 0.5, 1.0),
    ] {
        let rgba = foliage(side, share, soft);
        let own = rgba
            .chunks(4)
            .filter(|texel| texel[3] as f32 / 255.0 * factor >= cutoff)
            .count() as f64
            / (side * side) as f64;
        assert!((0.05..0.95).contains(&own), "{own}");
        let mut textures = build_textures(&[(side, side, rgba)], 1 << 20).expect("one texture");
        let mut materials = [MaterialRecord {
            base_color: [1.0, 1.0, 1.0, factor],
            texture: 0,
            flags: MASK,
            alpha_cutoff: cutoff,
            ..WHITE
        }];
        textures.add_mask_cutoffs(&mut materials);
        // Down to eight pixels a side, at mips and between them.
        for step in 0..20 {
            let texels = 2f32.powf(step as f32 * 0.25 + 0.25);
            let found = cover(&textures, &materials[0], texels);
            assert!(
                (found - own).abs() < 0.05 * own,
                "cover {found} of {own}, {texels} texels a pixel, cutoff {cutoff}"
            );
        }
        // Without the tables it does not.
        materials[0].mask_cutoffs = lodestream_shaders::types::NO_MASK_CUTOFFS;
        let plain = cover(&textures, &materials[0], 24.0);
        assert!((plain - own).abs() > 0.05 * own, "{plain} of {own}");
    }
}

/// Alpha of vertices is cut where the author wrote it, at any distance.
#[test]
fn opaque_textures_keep_the_written_cutoff() {
    let side = 64;
    let rgba = [255u8; 4].repeat((side * side) as usize);
    let mut textures = build_textures(&[(side, side, rgba)], 1 << 20).expect("one texture");
    let mut materials = [MaterialRecord {
        texture: 0,
        flags: MASK,
        alpha_cutoff: 0.5,
        ..WHITE
    }];
    textures.add_mask_cutoffs(&mut materials);
    for texels in [0.5f32, 1.3, 4.0, 9.0, 64.0] {
        let step = texels / side as f32;
        let (dx, dy) = (Vec2::new(step, 0.0), Vec2::new(0.0, step));
        let (alpha, cutoff) = sample_mask(&textures, &materials[0], Vec2::splat(0.4), dx, dy);
        assert_eq!((alpha, cutoff), (1.0, 0.5), "{texels} texels a pixel");
    }
}

/// A grate, a mesh of wires and soft dots: their mips become one alpha, of which a cutoff alone
/// shows all or nothing.
#[test]
fn regular_patterns_keep_their_cover_with_distance() {
    let side = 256u32;
    let patterns: [(&str, fn(u32, u32) -> u8); 3] = [
        ("grate", |x, _| if x % 16 < 4 { 255 } else { 0 }),
        (
            "wires",
            |x, y| if x % 32 < 3 || y % 32 < 3 { 255 } else { 0 },
        ),
        ("dots", |x, y| {
            let away = |at: u32| (at % 8) as f32 - 3.5;
            let distance = (away(x).powi(2) + away(y).powi(2)).sqrt();
            ((2.5 - distance).clamp(0.0, 1.0) * 255.0) as u8
        }),
    ];
    for (name, alpha) in patterns {
        let texel = |at: u32| [90, 90, 90, alpha(at % side, at / side)];
        let rgba: Vec<u8> = (0..side * side).flat_map(texel).collect();
        let passing = rgba.chunks(4).filter(|texel| texel[3] >= 128).count();
        let own = passing as f64 / (side * side) as f64;
        let mut textures = build_textures(&[(side, side, rgba)], 1 << 20).expect("one texture");
        let mut materials = [MaterialRecord {
            texture: 0,
            flags: MASK,
            alpha_cutoff: 0.5,
            ..WHITE
        }];
        textures.add_mask_cutoffs(&mut materials);
        for step in 0..20 {
            let texels = 2f32.powf(step as f32 * 0.25 + 0.25);
            let found = cover(&textures, &materials[0], texels);
            println!("{name} {texels:.1} texels a pixel: {found:.3} of {own:.3}");
            assert!(
                (found - own).abs() < 0.12 * own,
                "{name}: {found} of {own}, {texels} texels"
            );
        }
    }
}

/// One texture under an opaque material and two masked ones: each keeps its own cover.
#[test]
fn materials_of_different_cutoffs_share_a_texture() {
    let rgba = foliage(128, 0.6, 4.0);
    let own = |cutoff: f32| {
        let passes = |texel: &&[u8]| texel[3] as f32 / 255.0 >= cutoff;
        rgba.chunks(4).filter(passes).count() as f64 / (128.0 * 128.0)
    };
    let shares = [own(0.2), own(0.8)];
    assert!(shares[0] > 1.4 * shares[1], "{shares:?}");
    let mut textures = build_textures(&[(128, 128, rgba.clone())], 1 << 20).expect("one texture");
    let words = textures.words.len();
    let with = |flags, alpha_cutoff| MaterialRecord {
        texture: 0,
        flags,
        alpha_cutoff,
        ..WHITE
    };
    let mut materials = [
        with(material_flag::DOUBLE_SIDED, 0.0),
        with(MASK, 0.2),
        with(MASK, 0.8),
    ];
    let before = textures.words.clone();
    textures.add_mask_cutoffs(&mut materials);
    assert_eq!(textures.words[..words], before, "texels stay as they are");
    for (material, share) in materials[1..].iter().zip(shares) {
        for texels in [3.0, 8.0, 13.0] {
            let found = cover(&textures, material, texels);
            assert!((found - share).abs() < 0.05 * share, "{found} of {share}");
        }
    }
}

#[test]
fn the_picture_of_a_distant_card_shows_its_cover() {
    let (cluster, attributes) = square(None);
    let mut picture = Picture::new(&[cluster], attributes);
    let side = 256;
    let rgba = foliage(side, 0.33, 1.0);
    let passing = rgba.chunks(4).filter(|texel| texel[3] >= 128).count();
    let own = passing as f64 / (side * side) as f64;
    picture.textures = build_textures(&[(side, side, rgba)], 1 << 20).expect("one texture");
    picture.arrays.materials[0] = MaterialRecord {
        texture: 0,
        flags: MASK,
        alpha_cutoff: 0.5,
        ..WHITE
    };
    let textures = &mut picture.textures;
    textures.add_mask_cutoffs(&mut picture.arrays.materials);
    // Pictures from many places beside each other: one has too few pixels to count.
    for distance in [4.0, 6.0, 8.0, 12.0] {
        let (mut masked, mut whole) = (0, 0);
        for number in 0..24 {
            let aside = DVec3::new(0.013, 0.007, 0.0) * number as f64 * distance / 4.0;
            let target = aside + DVec3::new(0.0, 0.0, -1.0);
            let eye = aside + DVec3::new(0.0, 0.0, distance);
            picture.view = camera(eye, target).view(0.01, 1.0);
            let count = |words: Vec<u64>| words.iter().filter(|&&word| word != 0).count();
            masked += count(picture.raster_masked());
            whole += count(picture.raster());
        }
        let found = masked as f64 / whole as f64;
        assert!(
            (found - own).abs() < 0.05 * own,
            "cover {found} of {own} at {distance} m, {whole} pixels of {SIZE_PX:?}, {UV_STEP}"
        );
    }
}

/// Pixels that fall on texels in the same way all over a picture: the worst case for the share.
#[test]
fn cover_does_not_hang_on_how_pixels_fall_on_texels() {
    let side = 256;
    let rgba = foliage(side, 0.13, 1.0);
    let passing = rgba.chunks(4).filter(|texel| texel[3] >= 128).count();
    let own = passing as f64 / (side * side) as f64;
    let mut textures = build_textures(&[(side, side, rgba)], 1 << 20).expect("one texture");
    let mut materials = [MaterialRecord {
        texture: 0,
        flags: MASK,
        alpha_cutoff: 0.5,
        ..WHITE
    }];
    textures.add_mask_cutoffs(&mut materials);
    for pixels in [128u32, 64, 32] {
        let step = 1.0 / pixels as f32;
        let (dx, dy) = (Vec2::new(step, 0.0), Vec2::new(0.0, step));
        for phase in [0.0f32, 0.25, 0.5, 0.75] {
            let passes = |at: u32| {
                let place = Vec2::new((at % pixels) as f32 + phase, (at / pixels) as f32 + phase);
                let (alpha, cutoff) = sample_mask(&textures, &materials[0], place * step, dx, dy);
                alpha >= cutoff
            };
            let passing = (0..pixels * pixels).filter(|&at| passes(at)).count();
            let found = passing as f64 / (pixels * pixels) as f64;
            assert!(
                (found - own).abs() < 0.12 * own,
                "cover {found} of {own}, {pixels} pixels a side, phase {phase}"
            );
        }
    }
}

/// A texture without its top mips, since memory has no room for them, keeps the image's cover.
#[test]
fn reduced_textures_keep_the_cover_of_the_image() {
    let side = 256;
    let rgba = foliage(side, 0.13, 1.0);
    let passing = rgba.chunks(4).filter(|texel| texel[3] >= 128).count();
    let own = passing as f64 / (side * side) as f64;
    let mut textures = build_textures(&[(side, side, rgba)], 3000).expect("one texture");
    assert_eq!(textures.records[0].width, 32);
    let mut materials = [MaterialRecord {
        texture: 0,
        flags: MASK,
        alpha_cutoff: 0.5,
        ..WHITE
    }];
    textures.add_mask_cutoffs(&mut materials);
    for texels in [0.1, 1.0, 2.0] {
        let found = cover(&textures, &materials[0], texels);
        assert!(
            (found - own).abs() < 0.07 * own,
            "{found} of {own}, {texels} texels a pixel"
        );
    }
}
