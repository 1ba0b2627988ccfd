//! Occlusion culling against brute force: the visbuffer with it equals the one without it, while
//! cameras, instances, sizes and pages change between frames.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used)] // A test's way to fail.

mod gpu_common;

use std::collections::BTreeSet;

use gpu_common::{TestScene, gpu, look, material, placed, sheet, torus, used};
use lodestream_client::gpu::{Renderer, Work, read_buffer};
use lodestream_format::Scene;
use lodestream_shaders::cpu::visit::CullInput;
use lodestream_shaders::cpu::{self, Camera, Capacities, Hzb, Occluder, near_for_radius};
use lodestream_shaders::types::{ClusterItem, Counters, InstanceRecord, View};

/// Frames of the random walk; `OCCLUSION_FRAMES` sets another number.
const FRAMES: u32 = 250;
const SIZES: [[u32; 2]; 7] = [
    [1, 1],
    [63, 64],
    [64, 65],
    [130, 63],
    [65, 1],
    [200, 120],
    [1023, 769],
];

/// A small, fast generator with one sequence a seed (Marsaglia, "Xorshift RNGs", 2003).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }

    fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Upright sheets with tori between them: most is behind a sheet from most places. One torus is
/// mirrored, one flat, one huge around it all.
fn hall() -> TestScene {
    let mut wall = sheet(64, 6.0);
    for position in &mut wall.positions {
        *position = [position[0], position[2], position[1]];
    }
    wall.normals = Some(vec![[0.0, 0.0, 1.0]; wall.positions.len()]);
    let meshes = [torus("torus", 96, 1.0, 1), wall];
    let mut instances = Vec::new();
    for row in 0..5 {
        let z = -3.0 * f64::from(row);
        instances.push(placed(1, [1.0; 3], 0.1 * f64::from(row), [0.0, 0.0, z]));
        for column in 0..4 {
            let x = 1.6 * f64::from(column) - 2.4;
            let scale = [0.4, 0.4 + 0.1 * f64::from(row), 0.4];
            instances.push(placed(0, scale, f64::from(column), [x, 0.2, z - 1.5]));
        }
    }
    instances.push(placed(0, [-0.5, 0.5, 0.5], 1.0, [0.5, 0.5, 1.5]));
    instances.push(placed(0, [0.5, 1e-3, 0.5], 1.0, [-0.5, 0.5, 1.5]));
    instances.push(placed(0, [12.0; 3], 0.0, [0.0, 0.0, -6.0]));
    let scene = Scene {
        assets: vec![used("torus", vec![0]), used("wall", vec![0])],
        instances,
        materials: vec![material([0.8, 0.3, 0.2], true)],
        ..Scene::default()
    };
    TestScene::new(&meshes, scene, Vec::new())
}

/// Two renderers of one scene; one culls hidden geometry.
struct Pair<'a> {
    test: &'a TestScene,
    culled: Renderer,
    whole: Renderer,
    instances: Vec<InstanceRecord>,
    pages: Vec<(u32, u32)>,
}

impl Pair<'_> {
    fn each(&mut self, mut change: impl FnMut(&mut Renderer)) {
        change(&mut self.culled);
        change(&mut self.whole);
    }

    /// Installs the first `share` of the pages past the roots and takes the rest away.
    fn set_pages(&mut self, share: f64) {
        let (kept, _) = self.test.places(share);
        let pages = self.pages.clone();
        let gone = |page: &&(u32, u32)| !kept.iter().any(|&(kept, _)| kept == page.0);
        let evicted: Vec<u32> = pages.iter().filter(gone).map(|page| page.0).collect();
        let installed: Vec<_> = pages.iter().filter(|page| !gone(page)).copied().collect();
        self.each(|renderer| {
            let evicted = evicted.iter().copied();
            renderer
                .apply(evicted, &[], installed.iter().copied())
                .unwrap();
        });
    }

    fn move_instance(&mut self, index: usize, by: [f32; 3]) {
        for (axis, by) in by.into_iter().enumerate() {
            self.instances[index].translation_high[axis] += by;
        }
        let instances = self.instances.clone();
        self.each(|renderer| {
            renderer.write_buffer("instances", bytemuck::cast_slice(&instances));
        });
    }

    /// Draws a frame with both; every pixel shows the same triangle at the same depth, but for
    /// ties.
    fn check(&mut self, view: &View, place: &str) -> Counters {
        let counters = draw(&mut self.culled, view);
        draw(&mut self.whole, view);
        let [culled, whole] = [&self.culled, &self.whole].map(shown);
        for (pixel, (found, expected)) in culled.iter().zip(&whole).enumerate() {
            let is_tie = found.0 == expected.0 && found.0 != 0;
            assert!(
                found == expected || is_tie,
                "{place}: pixel {pixel}: {found:?}, without occlusion {expected:?}"
            );
        }
        counters
    }
}

fn draw(renderer: &mut Renderer, view: &View) -> Counters {
    for _ in 0..20 {
        renderer.draw(view, Work::Visbuffer).unwrap();
        let counters = renderer.collect(true).unwrap().pop().unwrap().counters;
        let grown = renderer
            .capacities()
            .grown(&renderer.gpu, &counters)
            .unwrap();
        if grown == renderer.capacities() {
            return counters;
        }
        renderer.set_capacities(grown).unwrap();
    }
    panic!("queues still grow");
}

/// Depth bits and triangle of every pixel.
fn shown(renderer: &Renderer) -> Vec<(u32, Option<(ClusterItem, u32)>)> {
    let visible = renderer.read_visible().unwrap();
    let words = renderer.read_visbuffer().unwrap();
    let item = |word: u64| {
        let id = word as u32;
        let depth = (word >> 32) as u32;
        let triangle = (depth != 0).then(|| (visible[(id >> 7) as usize], id & 127));
        (depth, triangle)
    };
    words.into_iter().map(item).collect()
}

fn random_camera(random: &mut Random, size_px: [u32; 2]) -> Camera {
    let mut point = |spread: f64| {
        let [x, y] = [0, 1].map(|_| random.range(-spread, spread));
        [x, 0.3 * y, random.range(-13.0, 6.0)]
    };
    let mut camera = look(point(4.0), point(3.0), size_px);
    camera.fov_y_degrees = random.range(5.0, 140.0);
    camera
}

#[test]
fn no_visible_triangle_is_lost_whatever_moves() {
    let Some(gpu) = gpu() else { return };
    let test = hall();
    let size_px = SIZES[5];
    let mut pair = Pair {
        culled: test.renderer(&gpu, 1.0, size_px),
        whole: test.renderer(&gpu, 1.0, size_px),
        instances: test.arrays.instances.clone(),
        pages: test.places(1.0).0,
        test: &test,
    };
    pair.whole.set_occlusion(false);
    let frames = std::env::var("OCCLUSION_FRAMES").map_or(FRAMES, |it| it.parse().unwrap());
    let near = near_for_radius(test.arrays.bounds_in_world().unwrap().1);
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let mut camera = random_camera(&mut random, size_px);
    let (mut hidden, mut late) = (0u64, 0u64);
    for frame in 0..frames {
        match random.below(12) {
            0 | 1 => camera = random_camera(&mut random, camera.size_px),
            2 => {
                let size_px = SIZES[random.below(SIZES.len())];
                camera.size_px = size_px;
                pair.each(|renderer| renderer.resize(size_px).unwrap());
            }
            3 => {
                let index = random.below(test.arrays.instances.len());
                let by = [0; 3].map(|_| random.range(-1.0, 1.0) as f32);
                pair.move_instance(index, by);
            }
            4 => {
                let share = [0.0, 0.3, 0.7, 1.0][random.below(4)];
                pair.set_pages(share);
            }
            5 => {}
            // A step aside.
            _ => {
                let step = glam::DVec3::new(0.2, 0.05, -0.2) * random.range(-1.0, 1.0);
                camera.eye += step;
            }
        }
        let pixel_error_px = [0.5, 2.0, 8.0][random.below(3)];
        let view = camera.view(near, pixel_error_px);
        let counters = pair.check(&view, &format!("frame {frame}: {camera:?}"));
        hidden += u64::from(counters.hidden_clusters + counters.hidden_nodes);
        hidden += u64::from(counters.hidden_instances);
        late += u64::from(counters.drawn_count - counters.early_count);
    }
    println!("{frames} frames: {hidden} items hidden, {late} clusters drawn late");
    let frames = u64::from(frames);
    assert!(
        hidden > 10 * frames && late > frames,
        "{hidden} hidden, {late} late"
    );
}

#[test]
fn the_pyramid_is_the_twins() {
    let Some(gpu) = gpu() else { return };
    let test = hall();
    let near = near_for_radius(test.arrays.bounds_in_world().unwrap().1);
    let mut renderer = test.renderer(&gpu, 1.0, SIZES[0]);
    for size_px in SIZES {
        renderer.resize(size_px).unwrap();
        let camera = look([0.3, 0.4, 6.0], [0.0, 0.2, 0.0], size_px);
        // The first frame draws all before it builds the pyramid.
        renderer
            .draw(&camera.view(near, 1.0), Work::Visbuffer)
            .unwrap();
        renderer.collect(true).unwrap();
        let expected = Hzb::new(&renderer.read_visbuffer().unwrap(), size_px);
        let texels = expected.texels.len();
        let found: Vec<u32> = read_buffer(&gpu, renderer.buffer("hzb"), texels).unwrap();
        assert_eq!(found, expected.texels, "{size_px:?}");
    }
}

/// Hidden pages are asked for, without a priority, and visible ones as before.
#[test]
fn hidden_pages_are_asked_for_last() {
    let Some(gpu) = gpu() else { return };
    let test = hall();
    let near = near_for_radius(test.arrays.bounds_in_world().unwrap().1);
    let size_px = SIZES[5];
    let camera = look([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], size_px);
    let view = camera.view(near, 0.5);
    let requests = |on: bool| {
        let mut renderer = test.renderer(&gpu, 1.0, size_px);
        renderer.set_occlusion(on);
        let mut last = Vec::new();
        for work in [Work::Visbuffer, Work::Visbuffer, Work::Requests] {
            draw(&mut renderer, &view);
            renderer.draw(&view, work).unwrap();
            last = renderer.collect(true).unwrap().pop().unwrap().requests;
        }
        last.sort_by_key(|request| request.page);
        last
    };
    let (culled, whole) = (requests(true), requests(false));
    let pages = |list: &[lodestream_shaders::types::RequestRecord]| {
        list.iter().map(|it| it.page).collect::<Vec<_>>()
    };
    assert_eq!(pages(&culled), pages(&whole));
    assert!(whole.iter().all(|request| request.priority > 0));
    let visible = culled.iter().filter(|request| request.priority > 0).count();
    assert!(
        visible > 0 && visible < culled.len(),
        "{visible} of {}",
        culled.len()
    );
    for (culled, whole) in culled.iter().zip(&whole) {
        assert!(culled.priority <= whole.priority && culled.error_px <= whole.error_px);
    }
}

/// Both passes decide as the twins do over the same depths, apart from rounding.
#[test]
fn both_passes_agree_with_the_twins() {
    let Some(gpu) = gpu() else { return };
    let test = hall();
    let near = near_for_radius(test.arrays.bounds_in_world().unwrap().1);
    let size_px = SIZES[5];
    let (pool, page_table) = test.twin_pool(1.0);
    let mut renderer = test.renderer(&gpu, 1.0, size_px);
    let mut random = Random(0x2545_f491_4f6c_dd1d);
    let (mut late_clusters, mut hidden_nodes) = (0, 0);
    for walk in 0..12 {
        let camera = random_camera(&mut random, size_px);
        let aside = Camera {
            eye: camera.eye + glam::DVec3::new(0.3, 0.1, -0.2),
            ..camera
        };
        let [first, second] = [camera, aside].map(|camera| {
            let view = camera.view(near, 1.0);
            view.with_scene(&test.arrays, Capacities::UNBOUNDED)
        });
        renderer.resize([1, 1]).unwrap();
        renderer.resize(size_px).unwrap();
        draw(&mut renderer, &first);
        let last = Hzb::new(&renderer.read_visbuffer().unwrap(), size_px);
        let counters = draw(&mut renderer, &second);
        let found: BTreeSet<_> = renderer.read_visible().unwrap().into_iter().collect();

        let occluder = |view, hzb, late| Occluder { view, hzb, late };
        let early = occluder(&first, &last, false);
        let input = |occluder| CullInput {
            arrays: &test.arrays,
            view: &second,
            page_table: &page_table,
            occluder: Some(occluder),
        };
        let mut frame = cpu::cut_early(&input(early), &pool);
        let early_count = frame.visible().len() as u32;
        let drawn = cpu::raster(frame.visible(), &test.arrays, &pool, &second);
        let this = Hzb::new(&drawn, size_px);
        let late = occluder(&second, &this, true);
        cpu::cut_late(&input(late), &late, &mut frame, &pool);
        let expected: BTreeSet<_> = frame.visible().iter().copied().collect();
        assert_eq!(
            expected.len(),
            frame.visible().len(),
            "nothing is drawn twice"
        );

        let apart = found.symmetric_difference(&expected).count();
        assert!(
            apart <= 2 + expected.len() / 100,
            "walk {walk}: {apart} of {}",
            expected.len()
        );
        let near_count = |a: u32, b: u32| a.abs_diff(b) <= 2 + b / 50;
        assert!(near_count(counters.early_count, early_count), "walk {walk}");
        let twin = frame.counters();
        assert!(
            near_count(counters.hidden_nodes, twin.hidden_nodes),
            "walk {walk}"
        );
        assert!(
            near_count(counters.hidden_clusters, twin.hidden_clusters),
            "walk {walk}"
        );
        late_clusters += twin.drawn_count - twin.early_count;
        hidden_nodes += twin.hidden_nodes;
    }
    assert!(late_clusters > 0 && hidden_nodes > 0);
}
