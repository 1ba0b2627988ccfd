//! Visbuffer and colours against their twins, on scenes with several instances, textures and masks.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used)] // A test's way to fail.

mod gpu_common;

use gpu_common::{TestScene, gpu, keep_picture, look, plain_scene, textured_scene};
use lodestream_client::gpu::{Gpu, Renderer, Work};
use lodestream_shaders::cpu::{self, Camera, Capacities, near_for_radius};
use lodestream_shaders::types::{Counters, ShadeMode, View};

const SIZE: [u32; 2] = [480, 270];
const MODES: [ShadeMode; 12] = [
    ShadeMode::Shaded,
    ShadeMode::Triangles,
    ShadeMode::Clusters,
    ShadeMode::Groups,
    ShadeMode::Levels,
    ShadeMode::Pages,
    ShadeMode::Depth,
    ShadeMode::Normals,
    ShadeMode::Overdraw,
    ShadeMode::Raster,
    ShadeMode::Materials,
    ShadeMode::Instances,
];

fn cameras() -> [Camera; 3] {
    [
        look([0.0, 2.0, 6.0], [0.0, 0.4, 0.0], SIZE),
        look([1.6, 1.1, 1.9], [0.3, 0.5, 0.0], SIZE),
        look([0.3, 0.3, 0.6], [1.0, 0.6, 0.0], SIZE),
    ]
}

fn view_of(test: &TestScene, camera: &Camera) -> View {
    let radius = test.arrays.bounds_in_world().unwrap().1;
    camera
        .view(near_for_radius(radius), 1.0)
        .with_scene(&test.arrays, Capacities::UNBOUNDED)
}

fn drawn(renderer: &mut Renderer, view: &View, mode: ShadeMode) -> Counters {
    renderer.set_mode(mode).unwrap();
    renderer.draw(view, Work::Picture).unwrap();
    renderer.collect(true).unwrap().pop().unwrap().counters
}

/// At most a thousandth of the pixels may hold another triangle, and only where triangles meet: the found one is a
/// neighbour of the expected one, in the picture or in depth. The rim of a `masked` hole may show what lies behind it.
fn check_visbuffer(expected: &[u64], found: &[u64], masked: bool) {
    let width = SIZE[0] as usize;
    let (mut differing, mut deeper) = (0, 0);
    for (at, (a, b)) in expected.iter().zip(found).enumerate() {
        if *a as u32 == *b as u32 && (*a == 0) == (*b == 0) {
            // Interpolated along a sliver, a depth is no better than the hardware's plane equation.
            let [a, b] = [a, b].map(|word| f32::from_bits((word >> 32) as u32));
            deeper += ((a - b).abs() > 1e-4 * a.abs()) as usize;
            assert!(
                (a - b).abs() <= 1e-2 * a.abs(),
                "depth at pixel {at}: {a} {b}"
            );
            continue;
        }
        differing += 1;
        let near = [0, 1, width, width + 1, width - 1];
        let around = near
            .iter()
            .flat_map(|by| [at.wrapping_sub(*by), at + by])
            .filter_map(|at| expected.get(at));
        let among = around.into_iter().any(|word| *word as u32 == *b as u32);
        let [a, b] = [a, b].map(|word| f32::from_bits((word >> 32) as u32));
        assert!(
            masked || among || (a - b).abs() <= 1e-3 * a.max(b),
            "pixel {at} holds a triangle that is none of its neighbours'"
        );
    }
    println!("{differing} pixels differ, {deeper} in depth");
    assert!(differing * 1000 <= expected.len());
    assert!(deeper * 1000 <= expected.len());
}

fn largest_difference(a: u32, b: u32) -> u8 {
    let (a, b) = (a.to_le_bytes(), b.to_le_bytes());
    (0..4).map(|c| a[c].abs_diff(b[c])).max().unwrap_or(0)
}

fn compare(gpu: &Gpu, test: &TestScene, name: &str) {
    let (pool, page_table) = test.twin_pool(1.0);
    let mut textures = test.twin_textures();
    let mut arrays = lodestream_shaders::SceneArrays::clone(&test.arrays);
    textures.add_mask_cutoffs(&mut arrays.materials);
    let arrays = &arrays;
    let mut renderer = test.renderer(gpu, 1.0, SIZE);
    assert_eq!(renderer.page_table(), page_table);
    if !test.scene.textures.is_empty() {
        let texels = renderer.read_texels().unwrap();
        assert_eq!(texels[..textures.words.len()], textures.words);
    }
    for (number, camera) in cameras().iter().enumerate() {
        let view = view_of(test, camera);
        for mode in MODES {
            drawn(&mut renderer, &view, mode);
            let visible = renderer.read_visible().unwrap();
            let visbuffer = renderer.read_visbuffer().unwrap();
            let color = renderer.read_color().unwrap();
            let twin_view = View {
                shade_mode: mode as u32,
                ..view
            };
            if mode == ShadeMode::Shaded {
                keep_picture(&format!("{name}_{number}"), SIZE, &color);
                let masked = cpu::needs_masked(&arrays.materials);
                let twin = match masked {
                    true => cpu::raster_masked(&visible, arrays, &pool, &twin_view, &textures),
                    false => cpu::raster(&visible, arrays, &pool, &twin_view),
                };
                assert!(twin.iter().filter(|word| **word != 0).count() > 10_000);
                check_visbuffer(&twin, &visbuffer, masked);
            }
            let counts = match mode {
                ShadeMode::Overdraw => cpu::raster_overdraw(&visible, arrays, &pool, &twin_view),
                _ => Vec::new(),
            };
            let twin = cpu::shade(
                &visbuffer, &visible, arrays, &pool, &twin_view, &textures, &counts,
            );
            let wrong = (0..color.len())
                .filter(|&at| largest_difference(color[at], twin[at]) > 2)
                .count();
            // Edges are the rasterizer's to decide; everything else follows from the visbuffer.
            let allowed = if mode == ShadeMode::Overdraw {
                color.len() / 500
            } else {
                0
            };
            if wrong > allowed {
                let kept = keep_picture(&format!("{name}_{number}_{mode:?}_gpu"), SIZE, &color);
                keep_picture(&format!("{name}_{number}_{mode:?}_cpu"), SIZE, &twin);
                panic!("{mode:?}: {wrong} pixels differ, see {}", kept.display());
            }
        }
    }
}

/// The error of the finest clusters is the rounding of the source; it shows where it is more than
/// the pixel error, and the nearest pixel decides.
#[test]
fn the_rounding_of_the_source_is_told_where_it_shows() {
    let Some(gpu) = gpu() else { return };
    let test = plain_scene();
    let mut renderer = test.renderer(&gpu, 1.0, SIZE);
    for camera in cameras() {
        let view = view_of(&test, &camera);
        assert_eq!(
            drawn(&mut renderer, &view, ShadeMode::Shaded).rounding_px_bits,
            0
        );
        let fine = View {
            pixel_error_px: 1e-4,
            ..view
        };
        let found = f32::from_bits(drawn(&mut renderer, &fine, ShadeMode::Shaded).rounding_px_bits);
        let visible = renderer.read_visible().unwrap();
        let visbuffer = renderer.read_visbuffer().unwrap();
        let twin = cpu::rounding_px(&visbuffer, &visible, &test.arrays, &fine);
        println!("{found} px, {twin} px");
        assert!(found > 1e-4 && (found - twin).abs() <= 1e-5 * twin);
    }
}

#[test]
fn plain_pictures_agree_with_the_twins() {
    if let Some(gpu) = gpu() {
        compare(&gpu, &plain_scene(), "plain");
    }
}

#[test]
fn textured_and_masked_pictures_agree_with_the_twins() {
    if let Some(gpu) = gpu() {
        compare(&gpu, &textured_scene(), "textured");
    }
}
