//! The scalar rasterizer against geometry: each pixel once, whatever the size, the clipping and the order.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod drawing;

use drawing::{Picture, SIZE_PX, WHITE, center, instance, pixel, square};
use glam::{DVec2, DVec3, Mat3, Vec2, Vec3, Vec4};
use lodestream_format::cluster::Attributes;
use lodestream_shaders::cpu::fetch_vertex::clip_from_local;
use lodestream_shaders::cpu::scan::scan_triangle;
use lodestream_shaders::cpu::{build_textures, needs_masked, raster_overdraw};
use lodestream_shaders::types::{MaterialRecord, TRIANGLE_BITS, material_flag};
use proptest::prelude::*;

/// Fragments a pixel of triangles given in pixels.
fn counts(triangles: impl IntoIterator<Item = [Vec2; 3]>) -> Vec<u32> {
    let size = Vec2::new(SIZE_PX[0] as f32, SIZE_PX[1] as f32);
    let mut counts = vec![0; (SIZE_PX[0] * SIZE_PX[1]) as usize];
    for triangle in triangles {
        let clip = triangle.map(|point| {
            let ndc = point / size * 2.0 - 1.0;
            Vec4::new(ndc.x, -ndc.y, 0.5, 1.0)
        });
        scan_triangle(clip, SIZE_PX, |fragment| {
            counts[pixel(fragment.x, fragment.y)] += 1
        });
    }
    counts
}

/// A grid of squares of `side` pixels over the whole picture and beyond it, each cut into two triangles.
fn grid(side: f32, offset: Vec2) -> Vec<[Vec2; 3]> {
    let at = |x: i32, y: i32| Vec2::new(x as f32, y as f32) * side + offset;
    let (columns, rows) = (
        (SIZE_PX[0] as f32 / side) as i32 + 2,
        (SIZE_PX[1] as f32 / side) as i32 + 2,
    );
    (-2..rows)
        .flat_map(|y| (-2..columns).map(move |x| (x, y)))
        .flat_map(|(x, y)| {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
            // The diagonal alternates, so that shared edges run in all eight directions.
            match (x + y) % 2 == 0 {
                true => [[a, b, c], [b, d, c]],
                false => [[a, b, d], [a, d, c]],
            }
        })
        .collect()
}

#[test]
fn grid_on_pixel_centres_covers_each_pixel_once() {
    for offset in [Vec2::ZERO, Vec2::splat(0.5), Vec2::new(0.5, 0.25)] {
        assert!(
            counts(grid(3.0, offset)).iter().all(|&count| count == 1),
            "{offset}"
        );
    }
}

#[test]
fn sub_pixel_triangles_cover_each_pixel_once() {
    for side in [0.31, 0.125, 0.5] {
        assert!(
            counts(grid(side, Vec2::new(0.013, 0.4)))
                .iter()
                .all(|&count| count == 1),
            "{side}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn fan_is_watertight(spokes in 3usize..40, x in 20f32..70.0, y in 20f32..40.0, turn in 0f32..6.3) {
        let middle = Vec2::new(x, y);
        let rim = |spoke: usize| {
            let angle = turn + (spoke % spokes) as f32 / spokes as f32 * std::f32::consts::TAU;
            middle + Vec2::new(angle.cos(), angle.sin()) * 30.0
        };
        let fan = counts((0..spokes).map(|spoke| [middle, rim(spoke), rim(spoke + 1)]));
        let inner = 30.0 * (std::f32::consts::PI / spokes as f32).cos() - 0.1;
        for row in 0..SIZE_PX[1] {
            for column in 0..SIZE_PX[0] {
                let distance = (Vec2::new(column as f32, row as f32) + 0.5 - middle).length();
                let count = fan[pixel(column, row)];
                prop_assert!(count <= 1);
                prop_assert!(count == 1 || distance > inner, "{column} {row}");
                prop_assert!(count == 0 || distance < 30.1, "{column} {row}");
            }
        }
    }

    /// Any triangle, in front of the eye, behind it or across, against exact edge functions in homogeneous coordinates.
    #[test]
    fn coverage_and_depth_are_right_for_any_corners(
        corners in prop::array::uniform3((-4f32..4.0, -4f32..4.0, -2f32..6.0)),
        scale in prop::sample::select(vec![1e-6f32, 1.0, 1e6]),
    ) {
        const NEAR: f32 = 0.125;
        let clip = corners.map(|(x, y, w)| Vec4::new(x, y, NEAR, w) * scale);
        let mut depths = vec![None; (SIZE_PX[0] * SIZE_PX[1]) as usize];
        scan_triangle(clip, SIZE_PX, |fragment| {
            assert!(depths[pixel(fragment.x, fragment.y)].replace(fragment.depth).is_none(), "twice");
        });
        let p = clip.map(|clip| DVec3::new(clip.x as f64, clip.y as f64, clip.w as f64) / scale as f64);
        let normals = [p[1].cross(p[2]), p[2].cross(p[0]), p[0].cross(p[1])];
        let volume = p[0].dot(normals[0]);
        prop_assume!(volume.abs() > 0.05);
        for row in 0..SIZE_PX[1] {
            for column in 0..SIZE_PX[0] {
                let size = DVec2::new(SIZE_PX[0] as f64, SIZE_PX[1] as f64);
                let ndc = (DVec2::new(column as f64, row as f64) + 0.5) / size * 2.0 - 1.0;
                let ray = DVec3::new(ndc.x, -ndc.y, 1.0);
                let edges = normals.map(|normal| normal.dot(ray));
                let sum: f64 = edges.iter().sum();
                // weights * w is edges / volume at w = 1 / (their sum).
                let depth = NEAR as f64 * sum / volume;
                let distance_px = |index: usize| {
                    let gradient = DVec2::new(normals[index].x, normals[index].y) * 2.0 / size;
                    edges[index].abs() / gradient.length().max(1e-12)
                };
                if (0..3).any(|index| distance_px(index) < 0.05) || (depth - 1.0).abs() < 0.05 || depth.abs() < 1e-3 {
                    continue;
                }
                let covered = edges.iter().all(|edge| edge * volume > 0.0) && depth < 1.0;
                let found = depths[pixel(column, row)];
                prop_assert_eq!(found.is_some(), covered, "{} {} {}", column, row, depth);
                if let Some(found) = found {
                    // Snapping moves a corner by up to 1/512 pixel, hence the depth by that share of its slope.
                    let slope = normals.iter().fold(DVec3::ZERO, |sum, normal| sum + *normal) / volume;
                    let allowed = 1e-6 + NEAR as f64 * DVec2::new(slope.x, slope.y).length() * 0.02;
                    prop_assert!((found as f64 - depth).abs() < allowed, "{found} {depth}");
                }
            }
        }
    }
}

#[test]
fn near_clipped_ground_reaches_the_horizon() {
    let picture = Picture::new(&[square(0.0, 0)], 0);
    // A triangle a metre under the eye, around it, thousands of kilometres large.
    let corners = [
        Vec3::new(-1e7, -1.0, 1e7),
        Vec3::new(1e7, -1.0, 1e7),
        Vec3::new(0.0, -1.0, -1e7),
    ];
    let clip = corners.map(|corner| {
        clip_from_local(
            &picture.view,
            &picture.arrays.instances[0],
            corner + Vec3::new(0.0, 0.0, 4.0),
        )
    });
    let mut depths = vec![0.0; (SIZE_PX[0] * SIZE_PX[1]) as usize];
    scan_triangle(clip, SIZE_PX, |fragment| {
        depths[pixel(fragment.x, fragment.y)] = fragment.depth
    });
    for row in 0..SIZE_PX[1] {
        let down = (row as f32 + 0.5 - SIZE_PX[1] as f32 * 0.5) / picture.view.pixels_at_one_metre;
        for column in 0..SIZE_PX[0] {
            let depth = depths[pixel(column, row)];
            let expected = if down > 0.0 {
                picture.view.near_metres * down
            } else {
                0.0
            };
            // Corners snap to 1/256 pixel, and the plane moves by as much of its slope.
            let allowed = picture.view.near_metres / picture.view.pixels_at_one_metre / 256.0;
            assert!(
                (depth - expected).abs() <= allowed,
                "{row}: {depth} {expected}"
            );
            assert_eq!(depth > 0.0, expected > 0.0, "{row}");
        }
    }
}

#[test]
fn nearer_surface_wins_in_any_order_and_its_id_names_it() {
    for (clusters, front) in [
        ([square(0.5, 0), square(-0.5, 0)], 0),
        ([square(-0.5, 0), square(0.5, 0)], 1),
    ] {
        let picture = Picture::new(&clusters, 0);
        let word = picture.raster()[center()];
        assert_eq!((word as u32) >> TRIANGLE_BITS, front);
        assert!((word as u32 & 127) < 2);
        let depth = f32::from_bits((word >> 32) as u32);
        assert!((depth - 0.01 / 3.5).abs() < 1e-8, "{depth}");
        let counts = raster_overdraw(
            &picture.visible,
            &picture.arrays,
            &picture.pool,
            &picture.view,
        );
        assert_eq!((counts[center()], counts[0]), (2, 0));
        assert_eq!(picture.raster()[0], 0);
    }
}

#[test]
fn what_is_not_finite_draws_nothing() {
    for bad in [f32::NAN, f32::INFINITY] {
        let corners = [
            Vec4::new(bad, 0.0, 0.1, 1.0),
            Vec4::new(0.0, 1.0, 0.1, 1.0),
            Vec4::ONE,
        ];
        scan_triangle(corners, SIZE_PX, |fragment| panic!("{fragment:?}"));
    }
    scan_triangle([Vec4::new(0.1, 0.2, 0.1, 1.0); 3], SIZE_PX, |fragment| {
        panic!("{fragment:?}")
    });
}

#[test]
fn single_sided_backs_vanish_and_mirrored_ones_turn_round() {
    let flip = Mat3::from_diagonal(Vec3::new(-1.0, 1.0, 1.0));
    let half_turn = Mat3::from_rotation_y(std::f32::consts::PI);
    for (linear, seen) in [
        (Mat3::IDENTITY, true),
        (flip, true),
        (half_turn, false),
        (half_turn * flip, false),
    ] {
        let mut picture = Picture::new(&[square(0.0, 0)], 0);
        picture.arrays.instances = vec![instance(linear, DVec3::ZERO)];
        assert_eq!(picture.raster_masked(), picture.raster());
        picture.arrays.materials[0].flags = 0;
        assert_eq!(picture.raster_masked()[center()] != 0, seen, "{linear}");
        assert!(picture.raster()[center()] != 0);
    }
}

#[test]
fn masked_texture_cuts_its_holes() {
    let mut picture = Picture::new(&[square(0.0, Attributes::UV)], Attributes::UV);
    // Left column of texels clear, right one solid.
    let rgba = [[255, 255, 255, 0], [255, 255, 255, 255]]
        .concat()
        .repeat(2);
    picture.textures = build_textures(&[(2, 2, rgba)], 100).unwrap();
    picture.arrays.materials[0] = MaterialRecord {
        texture: 0,
        flags: material_flag::DOUBLE_SIDED | material_flag::MASK | material_flag::CLAMP_U,
        alpha_cutoff: 0.5,
        ..WHITE
    };
    let (whole, masked) = (picture.raster(), picture.raster_masked());
    let row = SIZE_PX[1] / 2;
    for column in 0..SIZE_PX[0] {
        let at = pixel(column, row);
        let expected = if column >= SIZE_PX[0] / 2 {
            whole[at]
        } else {
            0
        };
        assert_eq!(masked[at], expected, "{column}");
    }
    assert!(whole[pixel(SIZE_PX[0] / 2 - 2, row)] != 0);
}

#[test]
fn masked_pass_is_recorded_for_materials_that_hide_something() {
    let with = |flags| MaterialRecord { flags, ..WHITE };
    assert!(!needs_masked(&[
        WHITE,
        with(material_flag::DOUBLE_SIDED | material_flag::UNLIT)
    ]));
    assert!(needs_masked(&[WHITE, with(0)]));
    assert!(needs_masked(&[with(
        material_flag::DOUBLE_SIDED | material_flag::MASK
    )]));
}
