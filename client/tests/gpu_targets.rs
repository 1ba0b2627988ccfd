//! Every way to the visbuffer gives the same words: 64-bit atomics, two rounds of 32-bit ones, and
//! attachments.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used)] // A test's way to fail.

mod gpu_common;

use gpu_common::{TestScene, gpu, look, plain_scene, textured_scene};
use lodestream_client::gpu::{Gpu, GpuError, Renderer, WIDE_ATOMICS, Work, instance};
use lodestream_shaders::VisbufferTarget::{self, Attachment, TwoRound, U64};
use lodestream_shaders::cpu::{Camera, near_for_radius};
use lodestream_shaders::types::{ClusterItem, ShadeMode, View};

const SIZES: [[u32; 2]; 6] = [[320, 180], [1, 1], [63, 64], [65, 1], [257, 130], [64, 65]];
const MODES: [ShadeMode; 11] = [
    ShadeMode::Shaded,
    ShadeMode::Triangles,
    ShadeMode::Clusters,
    ShadeMode::Groups,
    ShadeMode::Levels,
    ShadeMode::Pages,
    ShadeMode::Depth,
    ShadeMode::Normals,
    ShadeMode::Raster,
    ShadeMode::Materials,
    ShadeMode::Instances,
];

fn view_of(test: &TestScene, camera: &Camera) -> View {
    let radius = test.arrays.bounds_in_world().unwrap().1;
    camera.view(near_for_radius(radius), 0.7)
}

/// Near cameras cross surfaces; far ones show clusters of a pixel.
fn cameras(size_px: [u32; 2]) -> impl Iterator<Item = Camera> {
    (0..12).map(move |step| {
        let angle = f64::from(step) * 2.399_963;
        let distance = 0.9 * 1.45f64.powi(step);
        let eye = [
            distance * angle.cos(),
            0.5 + 0.3 * distance,
            distance * angle.sin(),
        ];
        look(eye, [0.1, 0.4, -0.2], size_px)
    })
}

/// The clusters that a frame of `view` draws.
fn visible(renderer: &mut Renderer, view: &View) -> Vec<ClusterItem> {
    renderer.draw(view, Work::Visbuffer).unwrap();
    renderer.collect(true).unwrap();
    renderer.read_visible().unwrap()
}

/// The words after each of `batches`, drawn over one another.
fn drawn(renderer: &mut Renderer, view: &View, batches: &[&[ClusterItem]]) -> Vec<Vec<u64>> {
    renderer.clear_visbuffer().unwrap();
    let draw = |items: &&[ClusterItem]| {
        renderer.raster_items(view, items).unwrap();
        renderer.read_visbuffer().unwrap()
    };
    batches.iter().map(draw).collect()
}

/// Words of the same clusters under the same ids, in one batch and in two over one another.
fn check_words(test: &TestScene, least_covered: usize) {
    let Some(gpu) = gpu() else { return };
    let mut renderer = test.renderer(&gpu, 1.0, SIZES[0]);
    renderer.set_occlusion(false);
    let mut covered = 0;
    for size_px in SIZES {
        renderer.resize(size_px).unwrap();
        for camera in cameras(size_px) {
            let view = view_of(test, &camera);
            renderer.set_target(Some(U64)).unwrap();
            let items = visible(&mut renderer, &view);
            // Halves over one another, then every cluster twice: each of its pixels is a tie.
            let twice = [&items[..], &items[..]].concat();
            let (near, far) = items.split_at(items.len() / 2);
            let batches = [far, near, &twice[..]];
            let expected = drawn(&mut renderer, &view, &batches);
            covered += expected[2].iter().filter(|word| **word != 0).count();
            for target in [TwoRound, Attachment] {
                renderer.set_target(Some(target)).unwrap();
                let found = drawn(&mut renderer, &view, &batches);
                for (batch, (a, b)) in expected.iter().zip(&found).enumerate() {
                    let apart = a.iter().zip(b).filter(|(a, b)| a != b).count();
                    assert_eq!(
                        apart, 0,
                        "{target:?}, batch {batch}, {size_px:?}, {camera:?}"
                    );
                }
            }
        }
    }
    assert!(covered > least_covered, "{covered} pixels");
}

#[test]
fn targets_store_the_same_words() {
    check_words(&plain_scene(), 200_000);
}

#[test]
fn targets_store_the_same_words_of_masked_and_single_sided_surfaces() {
    check_words(&textured_scene(), 200_000);
}

/// Depths of whole frames: both rasterizers, early and late pass, cameras that jump.
fn check_frames(test: &TestScene) {
    let Some(gpu) = gpu() else { return };
    let mut renderer = test.renderer(&gpu, 1.0, SIZES[0]);
    let mut depths = |target, occlusion, by_compute| {
        renderer.set_target(Some(target)).unwrap();
        renderer.set_occlusion(occlusion);
        renderer.set_compute_raster(by_compute);
        let mut all = Vec::new();
        let mut by_each = [0; 2];
        for size_px in [SIZES[0], SIZES[2], SIZES[4]] {
            renderer.resize(size_px).unwrap();
            for camera in cameras(size_px).step_by(3) {
                let view = view_of(test, &camera);
                renderer.draw(&view, Work::Visbuffer).unwrap();
                let counters = renderer.collect(true).unwrap().pop().unwrap().counters;
                by_each[0] += counters.compute_count;
                by_each[1] += counters.hardware_count;
                let words = renderer.read_visbuffer().unwrap();
                all.extend(words.into_iter().map(|word| (word >> 32) as u32));
            }
        }
        (all, by_each)
    };
    for by_compute in [true, false] {
        let (expected, by_each) = depths(U64, false, by_compute);
        assert_eq!(by_each[0] > 0, by_compute, "{by_each:?}");
        for occlusion in [false, true] {
            let (found, by_each) = depths(TwoRound, occlusion, by_compute);
            assert!(found == expected, "two-round, {occlusion} {by_compute}");
            assert_eq!(by_each[0] > 0, by_compute, "{by_each:?}");
        }
    }
    let (expected, _) = depths(U64, false, false);
    for occlusion in [false, true] {
        // The compute rasterizer is off, whatever is asked for.
        let (found, by_each) = depths(Attachment, occlusion, true);
        assert!(found == expected, "attachment, {occlusion}");
        assert_eq!(by_each[0], 0);
    }
}

#[test]
fn frames_have_the_same_depths_by_every_target() {
    check_frames(&plain_scene());
}

#[test]
fn frames_of_masked_scenes_have_the_same_depths_by_every_target() {
    check_frames(&textured_scene());
}

#[test]
fn pictures_of_every_mode_are_the_same_by_every_target() {
    let Some(gpu) = gpu() else { return };
    let test = textured_scene();
    let mut renderer = test.renderer(&gpu, 1.0, [257, 130]);
    renderer.set_occlusion(false);
    let camera = cameras([257, 130]).nth(2).unwrap();
    let view = view_of(&test, &camera);
    let items = visible(&mut renderer, &view);
    let mut pictures = |target: VisbufferTarget| -> Vec<Vec<u32>> {
        renderer.set_target(Some(target)).unwrap();
        drawn(&mut renderer, &view, &[&items]);
        let show = |mode: &ShadeMode| {
            renderer.set_mode(*mode).unwrap();
            renderer.shade(&view).unwrap();
            renderer.read_color().unwrap()
        };
        let mut pictures: Vec<_> = MODES.iter().map(show).collect();
        renderer.set_mode(ShadeMode::Overdraw).unwrap();
        renderer.draw(&view, Work::Picture).unwrap();
        renderer.collect(true).unwrap();
        pictures.push(renderer.read_color().unwrap());
        pictures
    };
    let expected = pictures(U64);
    for target in [TwoRound, Attachment] {
        let found = pictures(target);
        for (mode, (a, b)) in expected.iter().zip(&found).enumerate() {
            // The rasterizers are chosen anew by what the target allows.
            let by_choice = MODES.get(mode) == Some(&ShadeMode::Raster);
            assert!(
                a == b || (by_choice && target == Attachment),
                "{mode} {target:?}"
            );
        }
    }
}

#[test]
fn a_device_without_64_bit_atomics_draws_the_same() {
    let Some(gpu) = gpu() else { return };
    let (plain, _) = Gpu::open_without(&instance(), None, None, WIDE_ATOMICS).unwrap();
    assert!(!plain.has_wide_atomics);
    assert!(!plain.device.features().intersects(WIDE_ATOMICS));
    let test = plain_scene();
    let size_px = SIZES[0];
    let mut wide = test.renderer(&gpu, 1.0, size_px);
    let mut narrow = test.renderer(&plain, 1.0, size_px);
    assert_eq!((wide.target(), narrow.target()), (U64, TwoRound));
    let error = narrow.set_target(Some(U64)).unwrap_err();
    assert!(matches!(error, GpuError::Limit { .. }), "{error}");
    assert_eq!(narrow.target(), TwoRound);
    for target in [None, Some(Attachment)] {
        narrow.set_target(target).unwrap();
        for camera in cameras(size_px).take(4) {
            let view = view_of(&test, &camera);
            let items = visible(&mut wide, &view);
            let expected = drawn(&mut wide, &view, &[&items]);
            assert_eq!(drawn(&mut narrow, &view, &[&items]), expected, "{target:?}");
        }
    }
}

/// Passes of a target alone are neither built nor recorded by the others.
#[test]
fn resolve_is_recorded_for_attachments_alone() {
    let Some(gpu) = gpu() else { return };
    let test = plain_scene();
    for target in VisbufferTarget::ALL {
        let mut renderer = test.renderer(&gpu, 1.0, SIZES[0]);
        renderer.set_target(Some(target)).unwrap();
        let camera = cameras(SIZES[0]).nth(5).unwrap();
        visible(&mut renderer, &view_of(&test, &camera));
        let attaches = target == Attachment;
        for names in [renderer.passes_recorded(), renderer.pipelines_built()] {
            assert_eq!(names.contains(&"resolve"), attaches, "{names:?}");
            assert_eq!(names.contains(&"raster_compute"), !attaches, "{names:?}");
        }
    }
}
