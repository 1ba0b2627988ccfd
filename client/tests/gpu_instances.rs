//! Instances that move, hide, come and go after the scene is open: each picture equals that of a
//! scene opened with them.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used)] // A test's way to fail.

mod gpu_common;

use std::sync::Arc;

use gpu_common::{TestScene, gpu, look, placed, plain_scene};
use lodestream_client::gpu::{Gpu, Renderer, Work};
use lodestream_format::scene::Instance;
use lodestream_shaders::SceneArrays;
use lodestream_shaders::cpu::{Capacities, near_for_radius};
use lodestream_shaders::types::{Counters, View};

const SIZE: [u32; 2] = [160, 90];
/// A scene is opened anew so often: its pipelines take seconds.
const FRAMES_A_CHECK: u32 = 8;

/// A small, fast generator with one sequence a seed (Marsaglia, "Xorshift RNGs", 2003).
struct Random(u64);

impl Random {
    fn below(&mut self, end: u32) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % u64::from(end)) as u32
    }

    fn coordinate(&mut self) -> f64 {
        f64::from(self.below(1000)) / 250.0 - 2.0
    }
}

fn draw(renderer: &mut Renderer, view: &View) -> Counters {
    renderer.draw(view, Work::Picture).unwrap();
    renderer.collect(true).unwrap().pop().unwrap().counters
}

/// The picture of a scene that is opened with `instances`.
fn fresh(
    gpu: &Gpu,
    test: &mut TestScene,
    instances: Vec<Instance>,
    view: &View,
) -> (Vec<u32>, Counters) {
    test.scene.instances = instances;
    let assets = test
        .assets
        .iter()
        .map(|(asset, hierarchy)| (asset, hierarchy));
    test.arrays = Arc::new(SceneArrays::new(&test.scene, assets));
    let mut renderer = test.renderer(gpu, 1.0, SIZE);
    renderer.set_occlusion(false);
    let counters = draw(&mut renderer, view);
    (renderer.read_color().unwrap(), counters)
}

#[test]
fn changed_instances_look_as_if_opened_with_them() {
    let Some(gpu) = gpu() else { return };
    let (test, mut other) = (plain_scene(), plain_scene());
    let mut renderer = test.renderer(&gpu, 1.0, SIZE);
    let radius = test.arrays.bounds_in_world().unwrap().1;
    // Places with their instance, and whether it is hidden.
    let mut places: Vec<(Option<Instance>, bool)> = test
        .scene
        .instances
        .iter()
        .map(|it| (Some(it.clone()), false))
        .collect();
    let assets = test.assets.len() as u32;
    let mut random = Random(0x2545_f491_4f6c_dd1d);
    let mut hidden_frames = 0;
    for frame in 0..60 {
        let some = |random: &mut Random| {
            let at = [0; 3].map(|_| random.coordinate());
            let scale = [0.4, 0.4, if random.below(4) == 0 { -0.4 } else { 0.4 }];
            placed(random.below(assets), scale, random.coordinate(), at)
        };
        for _ in 0..random.below(4) {
            let first = random.below(places.len() as u32);
            let end = (first + 1 + random.below(3)).min(places.len() as u32);
            let range = first as usize..end as usize;
            match random.below(6) {
                0 | 1 => {
                    let moved: Vec<_> = range.clone().map(|_| some(&mut random)).collect();
                    renderer.set_instances(first, &moved).unwrap();
                    for (place, moved) in places[range].iter_mut().zip(moved) {
                        place.0 = Some(moved);
                    }
                }
                2 | 3 => {
                    let hide = random.below(2) == 0;
                    renderer.hide_instances(first..end, hide).unwrap();
                    places[range].iter_mut().for_each(|place| place.1 = hide);
                }
                4 => {
                    renderer.remove_instances(first..end).unwrap();
                    places[range].fill((None, false));
                }
                _ => {
                    let added: Vec<_> = (0..1 + random.below(20))
                        .map(|_| some(&mut random))
                        .collect();
                    let found = renderer.add_instances(&added).unwrap();
                    let expected = places.len() as u32..(places.len() + added.len()) as u32;
                    assert_eq!(found, expected);
                    places.extend(added.into_iter().map(|it| (Some(it), false)));
                }
            }
        }
        let eye = [random.coordinate() * 3.0, 2.0, 6.0 + random.coordinate()];
        let view = look(eye, [0.0, 0.4, 0.0], SIZE)
            .view(near_for_radius(radius), 1.0)
            .with_scene(&test.arrays, Capacities::UNBOUNDED);
        let counters = draw(&mut renderer, &view);
        hidden_frames += u32::from(counters.hidden_instances + counters.hidden_clusters > 0);
        if frame % FRAMES_A_CHECK != 0 {
            continue;
        }
        let shown = places.iter().filter(|(_, hidden)| !hidden);
        let shown = shown.filter_map(|(instance, _)| instance.clone());
        let (expected, whole) = fresh(&gpu, &mut other, shown.collect(), &view);
        let found = renderer.read_color().unwrap();
        // Surfaces at one depth may show either: tori meet in lines.
        let differing = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
        assert!(differing <= 8, "frame {frame}: {differing} pixels differ");
        assert_eq!(renderer.instance_count() as usize, places.len());
        assert!(counters.visible_count <= whole.visible_count);
    }
    assert!(
        hidden_frames > 5,
        "occlusion was at work in {hidden_frames} frames"
    );
}

#[test]
fn changes_that_the_scene_does_not_allow_name_what_it_has() {
    let Some(gpu) = gpu() else { return };
    let test = plain_scene();
    let mut renderer = test.renderer(&gpu, 1.0, SIZE);
    let count = renderer.instance_count();
    let good = placed(0, [1.0; 3], 0.0, [0.0; 3]);
    let errors = [
        renderer.set_instances(count, std::slice::from_ref(&good)),
        renderer.hide_instances(0..count + 1, true),
        renderer.remove_instances(count..count + 1),
        renderer.set_instances(u32::MAX, &[good.clone(), good.clone()]),
        renderer
            .add_instances(&[placed(9, [1.0; 3], 0.0, [0.0; 3])])
            .map(|_| ()),
        renderer
            .add_instances(&[placed(0, [f64::NAN; 3], 0.0, [0.0; 3])])
            .map(|_| ()),
    ];
    for (number, error) in errors.into_iter().enumerate() {
        let text = error.expect_err("not allowed").to_string();
        assert!(text.starts_with("instances: expected"), "{number}: {text}");
    }
    assert_eq!(renderer.instance_count(), count);
}
