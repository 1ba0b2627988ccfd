//! GPU against CPU twins, pass by pass: a pass is believed when its twin agrees.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used)] // A test's way to fail.

mod gpu_common;

use std::collections::BTreeSet;

use gpu_common::{TestScene, gpu, look, plain_scene};
use lodestream_client::gpu::{Renderer, Work};
use lodestream_shaders::cpu::{self, Camera, Capacities, near_for_radius};
use lodestream_shaders::types::View;

const SIZE: [u32; 2] = [480, 270];

fn cameras() -> Vec<Camera> {
    let look = |eye, target| look(eye, target, SIZE);
    vec![
        look([0.0, 2.0, 6.0], [0.0, 0.4, 0.0]),
        look([0.9, 0.9, 1.2], [0.3, 0.6, 0.0]),
        look([20.0, 15.0, 25.0], [0.0, 0.0, 0.0]),
        // Inside a tube, and with the back to everything.
        look([1.0, 0.62, 0.05], [0.0, 0.6, 1.0]),
        look([0.0, 2.0, 9.0], [0.0, 4.0, 90.0]),
    ]
}

fn view_of(test: &TestScene, camera: &Camera, pixel_error_px: f32) -> View {
    let radius = test.arrays.bounds_in_world().unwrap().1;
    camera
        .view(near_for_radius(radius), pixel_error_px)
        .with_scene(&test.arrays, Capacities::UNBOUNDED)
}

#[test]
fn transcode_gives_the_bits_of_the_twin() {
    let Some(gpu) = gpu() else { return };
    let test = plain_scene();
    let renderer = test.renderer(&gpu, 1.0, SIZE);
    let (expected, page_table) = test.twin_pool(1.0);
    assert_eq!(renderer.page_table(), page_table);
    let found = renderer.read_pool().unwrap();
    let differing = expected.iter().zip(&found).filter(|(a, b)| a != b).count();
    assert_eq!(expected.len(), found.len());
    assert_eq!(differing, 0, "of {} words", expected.len());
}

/// The drawn set and the requests equal the twin's, whatever is resident. A decision may differ only where the two sides
/// of its comparison lie within rounding of each other: for that the pixel error is moved by 1e-5 both ways, and what the
/// twin decides the same at both is decided that way by the GPU.
#[test]
fn culling_agrees_with_the_twin() {
    let Some(gpu) = gpu() else { return };
    let test = plain_scene();
    for share in [1.0, 0.5, 0.0] {
        let (pool, page_table) = test.twin_pool(share);
        let mut renderer = test.renderer(&gpu, share, SIZE);
        renderer.set_occlusion(false);
        for camera in cameras() {
            for pixel_error_px in [0.5, 2.0, 16.0] {
                let cut = |px: f32| {
                    let view = view_of(&test, &camera, px);
                    let culled = cpu::cut(&test.arrays, &view, &page_table, &pool);
                    let visible: BTreeSet<_> = culled.visible.iter().copied().collect();
                    let pages: BTreeSet<_> = culled.requests.iter().map(|r| r.page).collect();
                    (visible, pages, culled)
                };
                let (fine, fine_pages, _) = cut(pixel_error_px * (1.0 - 1e-5));
                let (coarse, coarse_pages, _) = cut(pixel_error_px * (1.0 + 1e-5));
                let (_, _, twin) = cut(pixel_error_px);
                let view = view_of(&test, &camera, pixel_error_px);
                renderer.draw(&view, Work::Picture).unwrap();
                let result = renderer.collect(true).unwrap().pop().unwrap();
                let found = renderer.read_visible().unwrap();
                let set: BTreeSet<_> = found.iter().copied().collect();
                assert_eq!(found.len(), set.len(), "nothing is drawn twice");
                let sure: Vec<_> = fine.intersection(&coarse).collect();
                assert!(sure.iter().all(|item| set.contains(item)));
                assert!(
                    set.iter()
                        .all(|item| fine.contains(item) || coarse.contains(item))
                );

                let pages: BTreeSet<_> = result.requests.iter().map(|r| r.page).collect();
                assert_eq!(
                    pages.len(),
                    result.requests.len(),
                    "a page is asked for once"
                );
                assert!(coarse_pages.is_subset(&pages) && pages.is_subset(&fine_pages));
                for request in &result.requests {
                    let same = twin.requests.iter().find(|twin| twin.page == request.page);
                    if let Some(same) = same {
                        let (a, b) = (request.error_px, same.error_px);
                        assert!((a - b).abs() <= 1e-5 * b, "page {}: {a} {b}", request.page);
                        let (a, b) = (request.priority, same.priority);
                        // A last bit of the error, as another order of a product gives, is a unit
                        // where it lies on the border of one.
                        let rounded = a.abs_diff(b) as usize <= test.arrays.instances.len();
                        assert!(rounded, "page {}: priority {a} {b}", request.page);
                    }
                }
                if fine == coarse {
                    assert_eq!(result.counters.visible_count, twin.counters.visible_count);
                    assert_eq!(
                        result.counters.triangles_drawn,
                        twin.counters.triangles_drawn
                    );
                }
                assert_eq!(
                    result.counters.instances_drawn,
                    twin.counters.instances_drawn
                );
            }
        }
    }
}

/// Queues that are too small say by how much, and a frame with the queues that they ask for is whole.
#[test]
fn queues_that_overflow_say_so_and_grow() {
    let Some(gpu) = gpu() else { return };
    let test = plain_scene();
    let mut renderer = test.renderer(&gpu, 1.0, SIZE);
    renderer.set_occlusion(false);
    let view = view_of(&test, &cameras()[0], 0.5);
    let whole = draw(&mut renderer, &view);
    let small = lodestream_client::gpu::Capacities {
        nodes: 8,
        clusters: 64,
    };
    renderer.set_capacities(small).unwrap();
    let mut capacities = small;
    for _ in 0..20 {
        let counters = draw(&mut renderer, &view);
        let grown = capacities.grown(&gpu, &counters).unwrap();
        if grown == capacities {
            assert_eq!(counters.visible_count, whole.visible_count);
            assert_eq!(counters.triangles_drawn, whole.triangles_drawn);
            assert!(capacities.nodes > 8 && capacities.clusters > 64);
            return;
        }
        capacities = grown;
        renderer.set_capacities(capacities).unwrap();
    }
    panic!("still growing at {capacities:?}");
}

fn draw(renderer: &mut Renderer, view: &View) -> lodestream_shaders::types::Counters {
    renderer.draw(view, Work::Picture).unwrap();
    renderer.collect(true).unwrap().pop().unwrap().counters
}
