//! Interpolation against finite differences in f64, sampling against values by hand, shading against what the light must do.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod drawing;

use drawing::{Picture, SIZE_PX, WHITE, camera, center, instance, pixel, sphere, square};
use glam::{DMat3, DVec2, DVec3, Mat3, Vec2, Vec3, Vec4};
use lodestream_format::cluster::Attributes;
use lodestream_shaders::cpu::barycentric::Barycentric;
use lodestream_shaders::cpu::false_color::{COMPUTE_COLOR, EMPTY_COLOR, HARDWARE_COLOR};
use lodestream_shaders::cpu::sample_texture::sample_texture;
use lodestream_shaders::cpu::srgb::{byte_from_unit, linear_from_byte, srgb_from_linear};
use lodestream_shaders::cpu::{Textures, build_textures};
use lodestream_shaders::passes::{PoolBindings, SHADE};
use lodestream_shaders::types::{MaterialRecord, NO_TEXTURE, ShadeMode, material_flag, view_flag};
use proptest::prelude::*;
use std::collections::HashSet;

const PIXEL_IN_NDC: Vec2 = Vec2::new(2.0 / 96.0, -2.0 / 64.0);

/// Weights by solving `corners * weights ~ (ndc, 1)` in f64.
fn weights_by_solving(corners: [Vec4; 3], ndc: DVec2) -> DVec3 {
    let column = |corner: Vec4| DVec3::new(corner.x as f64, corner.y as f64, corner.w as f64);
    let solved = DMat3::from_cols(column(corners[0]), column(corners[1]), column(corners[2]))
        .inverse()
        * DVec3::new(ndc.x, ndc.y, 1.0);
    solved / (solved.x + solved.y + solved.z)
}

fn assert_interpolates(corners: [Vec4; 3], weights: Vec3, allowed: f64) {
    let point = corners[0] * weights.x + corners[1] * weights.y + corners[2] * weights.z;
    let ndc = Vec2::new(point.x, point.y) / point.w;
    let found = Barycentric::at(corners, ndc, PIXEL_IN_NDC);
    let at = |dx: f64, dy: f64| {
        weights_by_solving(
            corners,
            ndc.as_dvec2() + PIXEL_IN_NDC.as_dvec2() * DVec2::new(dx, dy),
        )
    };
    assert!(
        (found.weights.as_dvec3() - at(0.0, 0.0)).length() < allowed,
        "{found:?} {}",
        at(0.0, 0.0)
    );
    let step = 1e-4;
    for (found, dx, dy) in [(found.weights_dx, step, 0.0), (found.weights_dy, 0.0, step)] {
        let difference = (at(dx, dy) - at(-dx, -dy)) / (2.0 * step);
        let error = (found.as_dvec3() - difference).length();
        assert!(
            error < allowed * difference.length().max(1.0),
            "{found} {difference}"
        );
    }
}

proptest! {
    #[test]
    fn weights_and_derivatives_match_finite_differences(
        corners in prop::array::uniform3((-4f32..4.0, -4f32..4.0, -1f32..6.0)),
        a in 0.05f32..1.0, b in 0.05f32..1.0, c in 0.05f32..1.0,
        scale in prop::sample::select(vec![1e-15f32, 1.0, 1e15]),
    ) {
        let corners = corners.map(|(x, y, w)| Vec4::new(x, y, 0.01, w) * scale);
        let weights = Vec3::new(a, b, c) / (a + b + c);
        let w = (corners[0].w * weights.x + corners[1].w * weights.y + corners[2].w * weights.z) / scale;
        let column = |corner: Vec4| DVec3::new(corner.x as f64, corner.y as f64, corner.w as f64) / scale as f64;
        let volume = DMat3::from_cols(column(corners[0]), column(corners[1]), column(corners[2])).determinant();
        // In front of the eye and not seen from the edge.
        prop_assume!(w > 0.3 && volume.abs() > 1.0);
        assert_interpolates(corners, weights, 2e-3);
    }
}

#[test]
fn weights_hold_for_a_hundredth_of_a_pixel() {
    let at =
        |x: f32, y: f32, w: f32| Vec4::new((0.7 + x * 1e-4) * w, (-0.4 + y * 1e-4) * w, 0.01, w);
    assert_interpolates(
        [at(0.0, 0.0, 5.0), at(2.0, 0.3, 5.001), at(0.4, 1.7, 4.999)],
        Vec3::new(0.3, 0.3, 0.4),
        // Corners are rounded to about 1e-7 of the screen, a thousandth of this triangle.
        5e-2,
    );
}

#[test]
fn degenerate_triangles_weigh_evenly() {
    for corner in [Vec4::ZERO, Vec4::ONE, Vec4::new(f32::NAN, 0.0, 0.0, 1.0)] {
        let found = Barycentric::at([corner; 3], Vec2::ZERO, PIXEL_IN_NDC);
        assert_eq!(found.weights, Vec3::splat(1.0 / 3.0));
        assert_eq!(found.weights_dx, Vec3::ZERO);
    }
}

/// Two by two, linear 0 and 1 and alpha 0..=3 thirds.
fn checker() -> Textures {
    let rgba = [
        [0, 0, 0, 0],
        [255, 0, 0, 85],
        [0, 255, 0, 170],
        [255, 255, 255, 255],
    ]
    .concat();
    build_textures(&[(2, 2, rgba)], 100).unwrap()
}

fn sample(textures: &Textures, flags: u32, u: f32, v: f32, footprint_texels: f32) -> Vec4 {
    let record = &textures.records[0];
    let dx = Vec2::new(footprint_texels / record.width as f32, 0.0);
    sample_texture(
        &textures.words,
        record,
        flags,
        Vec2::new(u, v),
        dx,
        Vec2::ZERO,
    )
}

#[test]
fn sampling_gives_the_values_by_hand() {
    use material_flag::{CLAMP_U, CLAMP_V, MIRROR_U, MIRROR_V, NEAREST};
    let textures = checker();
    let third = 1.0 / 3.0;
    for (flags, u, v, footprint, expected) in [
        // Texel centres.
        (0, 0.25, 0.25, 0.0, [0.0, 0.0, 0.0, 0.0]),
        (0, 0.75, 0.25, 1.0, [1.0, 0.0, 0.0, third]),
        (0, 0.25, 0.75, 0.5, [0.0, 1.0, 0.0, 2.0 * third]),
        // A quarter of the way between the upper two; between all four.
        (0, 0.375, 0.25, 0.0, [0.25, 0.0, 0.0, third * 0.25]),
        (0, 0.5, 0.5, 0.0, [0.5, 0.5, 0.25, 0.5]),
        // The left border repeats from the right one, or holds.
        (0, 0.0, 0.25, 0.0, [0.5, 0.0, 0.0, third * 0.5]),
        (CLAMP_U, 0.0, 0.25, 0.0, [0.0; 4]),
        (CLAMP_U, -7.0, 0.25, 0.0, [0.0; 4]),
        (MIRROR_U, 0.0, 0.25, 0.0, [0.0; 4]),
        (0, -0.25, 0.25, 0.0, [1.0, 0.0, 0.0, third]),
        (0, 5.75, -2.75, 0.0, [1.0, 0.0, 0.0, third]),
        (MIRROR_U, 1.25, 0.25, 0.0, [1.0, 0.0, 0.0, third]),
        (MIRROR_U, -0.25, 0.25, 0.0, [0.0; 4]),
        (MIRROR_V, 0.25, 1.25, 0.0, [0.0, 1.0, 0.0, 2.0 * third]),
        (CLAMP_V, 0.25, 9.0, 0.0, [0.0, 1.0, 0.0, 2.0 * third]),
        (NEAREST, 0.49, 0.25, 0.0, [0.0; 4]),
        (NEAREST, 0.51, 0.25, 0.0, [1.0, 0.0, 0.0, third]),
        (NEAREST | CLAMP_U, 1.0, 0.25, 0.0, [1.0, 0.0, 0.0, third]),
    ] {
        let found = sample(&textures, flags, u, v, footprint);
        assert!(
            (found - Vec4::from(expected)).length() < 1e-5,
            "{flags} {u} {v}: {found} {expected:?}"
        );
    }
}

#[test]
fn footprint_chooses_the_mip() {
    let textures = checker();
    let mean = sample(&textures, 0, 0.25, 0.25, 2.0);
    // Weighted by alpha, in thirds: red 1 + 3 of 6, green 2 + 3, blue 3; rounded to bytes.
    let [red, green, blue] = [4.0, 5.0, 3.0]
        .map(|sixths| linear_from_byte(byte_from_unit(srgb_from_linear(sixths / 6.0))));
    assert!(
        (mean - Vec4::new(red, green, blue, 128.0 / 255.0)).length() < 1e-6,
        "{mean}"
    );
    assert_eq!(sample(&textures, 0, 0.9, 0.1, 1e6), mean);
    assert_eq!(
        sample(&textures, material_flag::NEAREST, 0.9, 0.1, 1e30),
        mean
    );
    // Half-way between the mips: the footprint is the square root of two.
    let between = sample(&textures, 0, 0.25, 0.25, std::f32::consts::SQRT_2);
    assert!((between - mean * 0.5).length() < 1e-4, "{between}");
    for bad in [f32::NAN, f32::INFINITY] {
        assert!(sample(&textures, material_flag::NEAREST, bad, 0.25, 0.0).is_finite());
        assert!(sample(&textures, 0, 0.25, 0.25, bad).is_finite());
    }
}

fn brightness(color: [u8; 3]) -> u32 {
    color.iter().map(|&channel| channel as u32).sum()
}

#[test]
fn sphere_is_brighter_towards_the_key_light() {
    let mut picture = Picture::new(&[sphere(Attributes::NORMAL)], Attributes::NORMAL);
    let front = picture.shade(ShadeMode::Shaded);
    let (upper_left, lower_right) = (front[pixel(42, 24)], front[pixel(55, 42)]);
    assert!(
        brightness(upper_left) > brightness(lower_right) + 120,
        "{upper_left:?} {lower_right:?}"
    );
    picture.view = camera(DVec3::new(0.0, 0.0, -4.0), DVec3::ZERO).view(0.01, 1.0);
    let back = picture.shade(ShadeMode::Shaded);
    assert!(brightness(front[center()]) > brightness(back[center()]) + 120);
    assert!(
        brightness(back[center()]) > 150,
        "nothing is black: {:?}",
        back[center()]
    );
    // The sky gets lighter downwards and surrounds the sphere.
    assert!(brightness(front[0]) < brightness(front[pixel(0, SIZE_PX[1] - 1)]));
}

#[test]
fn normals_point_out_of_the_sphere_whatever_the_side_and_the_map() {
    for attributes in [0, Attributes::NORMAL] {
        for linear in [
            Mat3::IDENTITY,
            Mat3::from_diagonal(Vec3::new(-1.0, 1.0, 1.0)),
            Mat3::from_rotation_x(1.0),
            Mat3::from_diagonal(Vec3::splat(-1.0)),
        ] {
            let mut picture = Picture::new(&[sphere(attributes)], attributes);
            picture.arrays.instances = vec![instance(linear, DVec3::ZERO)];
            let normals = picture.shade(ShadeMode::Normals);
            let mut checked = 0;
            for (index, word) in picture.raster().iter().enumerate() {
                if *word == 0 {
                    continue;
                }
                let column = (index as u32 % SIZE_PX[0]) as f32 + 0.5 - 48.0;
                let row = (index as u32 / SIZE_PX[0]) as f32 + 0.5 - 32.0;
                let ray = Vec3::new(column, -row, -picture.view.pixels_at_one_metre).normalize();
                // Where the ray from (0, 0, 4) meets the unit sphere.
                let along = -4.0 * ray.z;
                let below = along * along - 15.0;
                if below < 0.5 {
                    continue;
                }
                let point = Vec3::new(0.0, 0.0, 4.0) + ray * (along - below.sqrt());
                let normal = Vec3::from(normals[index].map(|byte| byte as f32 / 127.5 - 1.0));
                // Facets of 45 degrees bend the flat normal by up to half of that, and more at the poles.
                let least = if attributes == 0 { 0.85 } else { 0.96 };
                assert!(
                    normal.dot(point) > least,
                    "{attributes} {linear} {normal} {point}"
                );
                checked += 1;
            }
            assert!(checked > 300, "{checked}");
        }
    }
}

/// A non-uniform map: normals follow the inverse transpose, so a squeezed sphere's front looks forward the more.
#[test]
fn normals_follow_a_stretch() {
    let mut picture = Picture::new(&[sphere(Attributes::NORMAL)], Attributes::NORMAL);
    picture.arrays.instances = vec![instance(
        Mat3::from_diagonal(Vec3::new(1.0, 1.0, 0.05)),
        DVec3::ZERO,
    )];
    let normals = picture.shade(ShadeMode::Normals);
    for x in [44, 48, 52] {
        assert!(
            normals[pixel(x, 32)][2] > 250,
            "{:?}",
            normals[pixel(x, 32)]
        );
    }
}

#[test]
fn picture_does_not_change_with_place_and_scale() {
    let mut picture = Picture::new(&[sphere(Attributes::NORMAL)], Attributes::NORMAL);
    let original = picture.shade(ShadeMode::Shaded);
    for (scale, place) in [
        (1e-6, DVec3::ZERO),
        (1e6, DVec3::ZERO),
        (1e15, DVec3::ZERO),
        (1.0, DVec3::new(6_378_137.0, -1e6, 4e6)),
    ] {
        picture.arrays.instances = vec![instance(Mat3::from_diagonal(Vec3::splat(scale)), place)];
        let eye = place + DVec3::new(0.0, 0.0, 4.0 * scale as f64);
        picture.view = camera(eye, place).view(0.01 * scale, 1.0);
        let moved = picture.shade(ShadeMode::Shaded);
        let differing = original
            .iter()
            .zip(&moved)
            .filter(|(a, b)| (0..3).any(|channel| a[channel].abs_diff(b[channel]) > 2));
        // Silhouette pixels may fall to the other side.
        assert!(differing.count() < 8, "{scale} {place}");
    }
}

#[test]
fn unlit_textures_come_out_as_they_went_in() {
    let mut picture = Picture::new(&[square(0.0, Attributes::UV)], Attributes::UV);
    let rgba = [
        [10, 20, 30, 255],
        [200, 100, 50, 255],
        [0, 255, 128, 255],
        [77, 78, 79, 255],
    ]
    .concat();
    picture.textures = build_textures(&[(2, 2, rgba)], 100).unwrap();
    picture.arrays.materials[0] = MaterialRecord {
        base_color: [1.0; 4],
        texture: 0,
        flags: material_flag::UNLIT | material_flag::NEAREST | material_flag::DOUBLE_SIDED,
        ..WHITE
    };
    let colors = picture.shade(ShadeMode::Shaded);
    assert_eq!(colors[pixel(44, 28)], [10, 20, 30]);
    assert_eq!(colors[pixel(52, 28)], [200, 100, 50]);
    assert_eq!(colors[pixel(44, 36)], [0, 255, 128]);
    assert_eq!(colors[pixel(52, 36)], [77, 78, 79]);
    // A quarter turn of the texture.
    picture.arrays.materials[0].uv_row_u = [0.0, 1.0, 0.0];
    picture.arrays.materials[0].uv_row_v = [1.0, 0.0, 0.0];
    assert_eq!(
        picture.shade(ShadeMode::Shaded)[pixel(52, 28)],
        [0, 255, 128]
    );
}

#[test]
fn vertex_colours_multiply_in_linear_light_and_emission_adds() {
    let mut picture = Picture::new(&[square(0.0, Attributes::COLOR)], Attributes::COLOR);
    picture.arrays.materials[0] = MaterialRecord {
        base_color: [1.0; 4],
        flags: material_flag::UNLIT,
        ..WHITE
    };
    let half = byte_from_unit(srgb_from_linear(128.0 / 255.0));
    assert_eq!(picture.shade(ShadeMode::Shaded)[center()], [255, half, 0]);
    picture.arrays.materials[0].flags = 0;
    let dark = picture.shade(ShadeMode::Shaded)[center()];
    picture.arrays.materials[0].emissive = [0.0, 0.0, 0.5];
    let glowing = picture.shade(ShadeMode::Shaded)[center()];
    assert!(
        glowing[2] > dark[2] + 100 && glowing[0] == dark[0],
        "{dark:?} {glowing:?}"
    );
}

#[test]
fn every_diagnostic_picture_tells_its_parts_apart() {
    let mut clusters = [square(-0.5, 0), sphere(0)];
    clusters[1].level = 3;
    clusters[1].group = 1;
    clusters[1].materials[0].slot = 1;
    let mut picture = Picture::new(&clusters, 0);
    picture.arrays.materials.push(WHITE);
    let rgb = |color: u32| [0, 1, 2].map(|channel| color.to_le_bytes()[channel]);
    let parts = pixel(57, 21);
    for (mode, differ) in [
        (ShadeMode::Clusters, true),
        (ShadeMode::Groups, true),
        (ShadeMode::Levels, true),
        (ShadeMode::Materials, true),
        (ShadeMode::Depth, true),
        (ShadeMode::Overdraw, true),
        (ShadeMode::Pages, false),
        (ShadeMode::Instances, false),
        (ShadeMode::Raster, false),
    ] {
        let colors = picture.shade(mode);
        assert_eq!(colors[0], rgb(EMPTY_COLOR), "{mode:?}");
        assert_eq!(colors[center()] != colors[parts], differ, "{mode:?}");
        assert_ne!(colors[parts], colors[0], "{mode:?}");
    }
    assert_eq!(
        picture.shade(ShadeMode::Raster)[center()],
        rgb(COMPUTE_COLOR)
    );
    picture.view.flags |= view_flag::HARDWARE;
    assert_eq!(
        picture.shade(ShadeMode::Raster)[center()],
        rgb(HARDWARE_COLOR)
    );
    let triangles: HashSet<_> = picture.shade(ShadeMode::Triangles).into_iter().collect();
    assert!(triangles.len() > 30, "{}", triangles.len());
    let depths = picture.shade(ShadeMode::Depth);
    assert!(depths[center()][0] > depths[parts][0], "nearer is lighter");
}

/// Numbers that WGSL repeats are those of the Rust side.
#[test]
fn constants_of_the_wgsl_are_those_of_the_twins() {
    let source = SHADE.source(PoolBindings {
        count: 1,
        words_log2: 25,
    });
    let module = naga::front::wgsl::parse_str(&source).unwrap();
    let constants: std::collections::HashMap<_, _> = module
        .constants
        .iter()
        .filter_map(
            |(_, constant)| match module.global_expressions[constant.init] {
                naga::Expression::Literal(naga::Literal::U32(value)) => {
                    Some((constant.name.clone()?, value))
                }
                _ => None,
            },
        )
        .collect();
    for (name, value) in [
        ("MODE_SHADED", ShadeMode::Shaded as u32),
        ("MODE_TRIANGLES", ShadeMode::Triangles as u32),
        ("MODE_CLUSTERS", ShadeMode::Clusters as u32),
        ("MODE_GROUPS", ShadeMode::Groups as u32),
        ("MODE_LEVELS", ShadeMode::Levels as u32),
        ("MODE_PAGES", ShadeMode::Pages as u32),
        ("MODE_DEPTH", ShadeMode::Depth as u32),
        ("MODE_NORMALS", ShadeMode::Normals as u32),
        ("MODE_OVERDRAW", ShadeMode::Overdraw as u32),
        ("MODE_RASTER", ShadeMode::Raster as u32),
        ("MODE_INSTANCES", ShadeMode::Instances as u32),
        ("MODE_MATERIALS", ShadeMode::Materials as u32),
        ("MATERIAL_DOUBLE_SIDED", material_flag::DOUBLE_SIDED),
        ("MATERIAL_UNLIT", material_flag::UNLIT),
        ("MATERIAL_MASK", material_flag::MASK),
        ("MATERIAL_NEAREST", material_flag::NEAREST),
        ("MATERIAL_CLAMP_U", material_flag::CLAMP_U),
        ("MATERIAL_CLAMP_V", material_flag::CLAMP_V),
        ("MATERIAL_MIRROR_U", material_flag::MIRROR_U),
        ("MATERIAL_MIRROR_V", material_flag::MIRROR_V),
        ("NO_TEXTURE", NO_TEXTURE),
        ("EMPTY_COLOR", EMPTY_COLOR),
        ("HARDWARE_COLOR", HARDWARE_COLOR),
        ("COMPUTE_COLOR", COMPUTE_COLOR),
    ] {
        assert_eq!(constants.get(name), Some(&value), "{name}");
    }
}
