//! Instances below a pixel: points against their twin, and a crowd of them against its
//! supersampled truth.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used)] // A test's way to fail.

mod gpu_common;

use std::collections::BTreeMap;

use glam::DVec3;
use gpu_common::{TestScene, gpu, used};
use lodestream_client::gpu::{Renderer, Work};
use lodestream_format::Scene;
use lodestream_format::scene::{Instance, Material};
use lodestream_server::import::Mesh;
use lodestream_shaders::VisbufferTarget;
use lodestream_shaders::cpu::{self, Camera, Capacities, near_for_radius};
use lodestream_shaders::types::{ClusterItem, POINT_FLAG, ShadeMode, View};

const SIZE: [u32; 2] = [320, 180];

/// A box of `size` metres, its middle at the origin.
fn cuboid(size: [f32; 3]) -> Mesh {
    let corner = |index: usize| {
        std::array::from_fn(|axis| match index >> axis & 1 {
            0 => -0.5 * size[axis],
            _ => 0.5 * size[axis],
        })
    };
    let quads = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    let split = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    Mesh {
        name: "box".to_owned(),
        positions: (0..8).map(corner).collect(),
        triangles: quads.into_iter().flat_map(split).collect(),
        triangle_materials: vec![0; 12],
        ..Mesh::default()
    }
}

/// `side` x `side` boxes on a plane, `spacing` metres apart, turned, some mirrored or stretched.
fn crowd(size: [f32; 3], side: u32, spacing: f64) -> TestScene {
    let instance = |index: u32| {
        let (column, row) = (index % side, index / side);
        let turn = index as f64 * 2.399;
        let jitter = |salt: u32| (cpu::hash::hash(index ^ salt) >> 8) as f64 / 16_777_216.0 - 0.5;
        let middle = 0.5 * f64::from(side);
        let x = (f64::from(column) - middle + 0.8 * jitter(0x1000_0000)) * spacing;
        let z = (f64::from(row) - middle + 0.8 * jitter(0x2000_0000)) * spacing;
        let mirror = if index.is_multiple_of(5) { -1.0 } else { 1.0 };
        let (sin, cos) = turn.sin_cos();
        Instance {
            asset: 0,
            world_from_object: [
                [cos * mirror, 0.0, sin, x],
                [0.0, 1.0 + 0.25 * f64::from(index % 3), 0.0, 0.0],
                [-sin * mirror, 0.0, cos, z],
            ],
        }
    };
    let scene = Scene {
        assets: vec![used("box", vec![0])],
        instances: (0..side * side).map(instance).collect(),
        materials: vec![Material {
            name: "paint".to_owned(),
            base_color_factor: [0.7, 0.3, 0.1, 1.0],
            base_color: None,
            emissive_factor: [0.0; 3],
            metallic: 0.0,
            roughness: 0.8,
            alpha_mode: Default::default(),
            double_sided: true,
            unlit: false,
        }],
        ..Scene::default()
    };
    TestScene::new(&[cuboid(size)], scene, Vec::new())
}

fn view_of(test: &TestScene, eye: DVec3, size_px: [u32; 2]) -> View {
    let radius = test.arrays.bounds_in_world().unwrap().1;
    let camera = Camera {
        eye,
        target: DVec3::ZERO,
        up: DVec3::Y,
        fov_y_degrees: 40.0,
        size_px,
    };
    camera
        .view(near_for_radius(radius), 1.0)
        .with_scene(&test.arrays, Capacities::UNBOUNDED)
}

/// The visible half of `clusters`, points at its end.
fn read_items(renderer: &Renderer) -> Vec<ClusterItem> {
    let bytes = renderer.buffer("clusters").size() as usize / size_of::<ClusterItem>();
    let all = lodestream_client::gpu::read_buffer::<ClusterItem>(
        &renderer.gpu,
        renderer.buffer("clusters"),
        bytes,
    );
    all.unwrap().split_off(bytes / 2)
}

#[test]
fn points_are_those_of_the_twin() {
    let Some(gpu) = gpu() else { return };
    let test = crowd([2.0, 2.0, 3.0], 60, 8.0);
    let (pool, page_table) = test.twin_pool(1.0);
    let mut renderer = test.renderer(&gpu, 1.0, SIZE);
    for distance in [300.0, 1300.0, 2000.0, 6000.0] {
        let view = view_of(&test, DVec3::new(0.3, 0.4, 0.85) * distance, SIZE);
        renderer.draw(&view, Work::Picture).unwrap();
        let counters = renderer.collect(true).unwrap().pop().unwrap().counters;
        let items = read_items(&renderer);
        let points = counters.point_count as usize;
        let found = &items[items.len() - points..];
        assert!(found.iter().all(|item| item.page & POINT_FLAG != 0));
        let by_instance = |items: &[ClusterItem]| -> BTreeMap<u32, ClusterItem> {
            items.iter().map(|item| (item.instance, *item)).collect()
        };
        let culled = cpu::cut(&test.arrays, &view, &page_table, &pool);
        let (found, expected) = (by_instance(found), by_instance(&culled.points));
        assert_eq!(found.len(), points, "an instance has one point");
        // Rounding may decide otherwise about an instance in a thousand.
        let lone = expected
            .keys()
            .filter(|key| !found.contains_key(key))
            .count()
            + found
                .keys()
                .filter(|key| !expected.contains_key(key))
                .count();
        assert!(
            lone <= 1 + expected.len() / 500,
            "{lone} of {}",
            expected.len()
        );
        assert_eq!(points > 0, distance > 600.0, "at {distance} m: {points}");
        for (instance, point) in &found {
            let Some(twin) = expected.get(instance) else {
                continue;
            };
            assert_eq!(point.page, twin.page, "pixel of instance {instance}");
            let [depth, twin_depth] = [point, twin].map(|item| f32::from_bits(item.page_word));
            assert!((depth - twin_depth).abs() <= 1e-6 * twin_depth);
            let bytes = point.cluster.to_le_bytes().into_iter();
            for (a, b) in bytes.zip(twin.cluster.to_le_bytes()) {
                assert!(a.abs_diff(b) <= 1, "colour of instance {instance}");
            }
        }
        // Every pixel shows its nearest point or what is nearer.
        let visbuffer = renderer.read_visbuffer().unwrap();
        let mut drawn = vec![0; visbuffer.len()];
        let capacity = renderer.capacities().clusters;
        let points = items.iter().rev().take(points).copied().collect::<Vec<_>>();
        cpu::raster_points(&mut drawn, &points, capacity);
        assert!(
            visbuffer
                .iter()
                .zip(&drawn)
                .all(|(word, point)| word >= point)
        );
        let shown = visbuffer.iter().zip(&drawn);
        let shown = shown.filter(|(word, point)| word == point && **point != 0);
        assert!(shown.count() * 2 >= points.len().min(1), "points are seen");
        let textures = test.twin_textures();
        let expected = cpu::shade(
            &visbuffer,
            &items,
            &test.arrays,
            &pool,
            &view,
            &textures,
            &[],
        );
        let color = renderer.read_color().unwrap();
        for (pixel, &point) in drawn.iter().enumerate() {
            if point != 0 && visbuffer[pixel] == point {
                assert_eq!(color[pixel], expected[pixel], "pixel {pixel}");
            }
        }
    }
}

/// Share of the pixels that are covered, and the mean linear colour of the picture.
fn mean(
    test: &TestScene,
    gpu: &lodestream_client::gpu::Gpu,
    eye: DVec3,
    scale: u32,
) -> (f64, DVec3) {
    let size = SIZE.map(|side| side * scale);
    let mut renderer = test.renderer(gpu, 1.0, size);
    renderer.set_mode(ShadeMode::Shaded).unwrap();
    let view = View {
        pixel_error_px: 1.0,
        ..view_of(test, eye, size)
    };
    renderer.draw(&view, Work::Picture).unwrap();
    let visbuffer = renderer.read_visbuffer().unwrap();
    let covered = visbuffer.iter().filter(|&&word| word != 0).count();
    let color = renderer.read_color().unwrap();
    let linear = |(&word, &color): (&u64, &u32)| {
        let [red, green, blue, _] = color.to_le_bytes().map(cpu::srgb::linear_from_byte);
        let shown = DVec3::new(red.into(), green.into(), blue.into());
        if word == 0 { DVec3::ZERO } else { shown }
    };
    let sum: DVec3 = visbuffer.iter().zip(&color).map(linear).sum();
    let pixels = visbuffer.len() as f64;
    (covered as f64 / pixels, sum / pixels)
}

/// A far crowd at one sample a pixel has the cover and the colour of its supersampled truth, for
/// boxes of several shapes. The bound is three times the noise of so many samples, and a twentieth.
#[test]
fn a_far_crowd_keeps_its_mean_cover_and_colour() {
    let Some(gpu) = gpu() else { return };
    for size in [[2.0, 2.0, 2.0], [1.0, 4.0, 1.0], [3.0, 0.2, 3.0]] {
        let test = crowd(size, 120, 5.0);
        for distance in [1500.0, 3000.0] {
            let eye = DVec3::new(0.25, 0.5, 0.8) * distance;
            let (cover, color) = mean(&test, &gpu, eye, 1);
            let (true_cover, true_color) = mean(&test, &gpu, eye, 8);
            let pixels = f64::from(SIZE[0] * SIZE[1]);
            let noise = 3.0 * (true_cover / pixels).sqrt();
            let allowed = 0.05 * true_cover + noise;
            let differs = (cover - true_cover).abs();
            assert!(
                differs <= allowed,
                "boxes of {size:?} m at {distance} m cover {cover}, not {true_cover}"
            );
            let relative = (color - true_color).abs() / true_color;
            let bound = allowed / true_cover + 0.1;
            assert!(
                relative.max_element() <= bound,
                "boxes of {size:?} m at {distance} m: mean {color}, not {true_color}"
            );
        }
    }
}

/// Every way to the visbuffer shows the same points before and behind the same clusters.
#[test]
fn points_are_the_same_on_every_target() {
    let Some(gpu) = gpu() else { return };
    let test = crowd([2.0, 2.0, 3.0], 60, 8.0);
    let mut renderer = test.renderer(&gpu, 1.0, SIZE);
    // Attachments have no compute rasterizer, whose depths differ in the last bit.
    renderer.set_compute_raster(false);
    // Some instances are points, some are not.
    let view = view_of(&test, DVec3::new(0.3, 0.4, 0.85) * 1300.0, SIZE);
    let mut pictures = VisbufferTarget::ALL.map(|target| {
        renderer.set_target(Some(target)).unwrap();
        renderer.draw(&view, Work::Picture).unwrap();
        let counters = renderer.collect(true).unwrap().pop().unwrap().counters;
        assert!(counters.point_count > 0 && counters.visible_count > 0);
        let words = renderer.read_visbuffer().unwrap();
        let depths: Vec<u32> = words.iter().map(|word| (word >> 32) as u32).collect();
        (depths, renderer.read_color().unwrap())
    });
    let expected = pictures[0].clone();
    for (found, target) in pictures.iter_mut().zip(VisbufferTarget::ALL).skip(1) {
        let apart = found
            .0
            .iter()
            .zip(&expected.0)
            .filter(|(a, b)| a != b)
            .count();
        assert_eq!(apart, 0, "{target:?}: depths");
        let apart = found
            .1
            .iter()
            .zip(&expected.1)
            .filter(|(a, b)| a != b)
            .count();
        // Two clusters of one instance may meet at one depth.
        assert!(apart <= 2, "{target:?}: {apart} colours");
    }
}
