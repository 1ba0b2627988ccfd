//! The compute rasterizer against the hardware's: the same pixels are covered, whichever draws.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used)] // A test's way to fail.

mod gpu_common;

use gpu_common::{TestScene, gpu, look, plain_scene, textured_scene};
use lodestream_client::gpu::{Renderer, Work};
use lodestream_shaders::cpu::{Camera, near_for_radius};
use lodestream_shaders::types::{ClusterItem, Counters};

const SIZE: [u32; 2] = [640, 360];

/// Depth bits and triangle of every pixel.
type Shown = Vec<(u32, Option<(ClusterItem, u32)>)>;

fn drawn(renderer: &mut Renderer, camera: &Camera, by_compute: bool) -> (Shown, Counters) {
    let near = near_for_radius(renderer.arrays().bounds_in_world().unwrap().1);
    renderer.set_compute_raster(by_compute);
    renderer
        .draw(&camera.view(near, 0.7), Work::Visbuffer)
        .unwrap();
    let counters = renderer.collect(true).unwrap().pop().unwrap().counters;
    let visible = renderer.read_visible().unwrap();
    let show = |word: u64| {
        let (id, depth) = (word as u32, (word >> 32) as u32);
        let triangle = (depth != 0).then(|| (visible[(id >> 7) as usize], id & 127));
        (depth, triangle)
    };
    let words = renderer.read_visbuffer().unwrap();
    (words.into_iter().map(show).collect(), counters)
}

/// Cameras from near to far: all by hardware, mixed, nearly all by compute.
fn cameras() -> impl Iterator<Item = Camera> {
    (0..24).map(|step| {
        let angle = f64::from(step) * 2.399_963;
        let distance = 1.2 * 1.2f64.powi(step);
        let eye = [
            distance * angle.cos(),
            0.5 + 0.3 * distance,
            distance * angle.sin(),
        ];
        look(eye, [0.1, 0.4, -0.2], SIZE)
    })
}

fn check(test: &TestScene, masked: bool) {
    let Some(gpu) = gpu() else { return };
    let mut renderer = test.renderer(&gpu, 1.0, SIZE);
    renderer.set_occlusion(false);
    let (mut by_compute, mut by_hardware, mut apart, mut pixels) = (0u64, 0u64, 0u64, 0u64);
    for camera in cameras() {
        let (hardware, all) = drawn(&mut renderer, &camera, false);
        assert_eq!(
            (all.compute_count, all.hardware_count),
            (0, all.visible_count)
        );
        let (mixed, split) = drawn(&mut renderer, &camera, true);
        assert_eq!(
            split.compute_count + split.hardware_count,
            split.visible_count
        );
        assert_eq!(split.visible_count, all.visible_count);
        by_compute += u64::from(split.compute_count);
        by_hardware += u64::from(split.hardware_count);
        for (pixel, (a, b)) in hardware.iter().zip(&mixed).enumerate() {
            let covered = (a.0 != 0, b.0 != 0);
            assert_eq!(covered.0, covered.1, "pixel {pixel} of {camera:?}");
            if a.1 != b.1 {
                apart += 1;
                // Where surfaces meet the last bits of their depths decide.
                let [a, b] = [a.0, b.0].map(f32::from_bits);
                assert!(
                    (a - b).abs() <= 1e-3 * a,
                    "pixel {pixel}: {a} {b} of {camera:?}"
                );
            }
            pixels += u64::from(covered.0);
        }
    }
    println!(
        "{by_compute} by compute, {by_hardware} by hardware; {apart} of {pixels} pixels apart"
    );
    assert!(by_compute > 500 && by_hardware > 500);
    assert!(apart * 1000 <= pixels || masked);
}

#[test]
fn both_rasterizers_cover_the_same_pixels() {
    check(&plain_scene(), false);
}

#[test]
fn both_rasterizers_cover_the_same_pixels_of_masked_and_single_sided_surfaces() {
    check(&textured_scene(), true);
}
