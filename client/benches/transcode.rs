//! Bytes of memory form a second that the GPU makes of pages in staged form, upload included, against what it copies in the same run.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lodestream_client::gpu::{PageUpload, Renderer};
use lodestream_format::instances::InstanceSteps;
use lodestream_format::scene::SceneAsset;
use lodestream_format::{ContentHash, Scene};
use lodestream_shaders::types::NOT_INSTALLED;

#[path = "../tests/gpu_common/mod.rs"]
mod gpu_common;

use gpu_common::{TestScene, gpu, material, placed, torus};

/// Quads a side: a quarter of a million triangles at the source.
const QUADS: u32 = 354;
/// What is copied: more than any cache holds.
const COPIED_BYTES: u64 = 128 << 20;

fn transcode(criterion: &mut Criterion) {
    let Some(gpu) = gpu() else { return };
    let scene = Scene {
        assets: vec![SceneAsset {
            name: "torus".into(),
            asset: ContentHash::of(&[]),
            materials: vec![0],
            steps: InstanceSteps::default(),
        }],
        instances: vec![placed(0, [1.0; 3], 0.0, [0.0; 3])],
        materials: vec![material([0.8; 3], false)],
        ..Scene::default()
    };
    let test = TestScene::new(&[torus("torus", QUADS, 1.0, 1)], scene, Vec::new());
    let (places, words) = test.places(1.0);
    let mut renderer =
        Renderer::new(&gpu, test.arrays.clone(), words.into(), [64, 64]).expect("a renderer");
    let word_of = |page: u32| places.iter().find(|place| place.0 == page);
    let parents: Vec<Vec<u32>> = places
        .iter()
        .map(|&(page, _)| {
            let parents = test.form(page).parents().iter();
            let words =
                parents.map(|&[parent, _]| word_of(parent).map_or(NOT_INSTALLED, |it| it.1));
            words.collect()
        })
        .collect();
    let all: Vec<_> = places
        .iter()
        .zip(&parents)
        .map(|(&(page, pool_word), parents)| PageUpload {
            form: test.form(page),
            pool_word,
            parents,
        })
        .collect();
    println!("{}, {} pages, {words} words", gpu.name, all.len());
    let mut group = criterion.benchmark_group("gpu");
    group.sample_size(10);
    group.throughput(Throughput::Bytes(4 * u64::from(words)));
    group.bench_function("transcode every page", |bencher| {
        bencher.iter(|| {
            renderer.apply([], &all, []).expect("uploads");
            gpu.wait().expect("the device");
        });
    });
    let [from, to] = ["from", "to"].map(|label| {
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: COPIED_BYTES,
            usage: wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    });
    group.throughput(Throughput::Bytes(COPIED_BYTES));
    group.bench_function("copy a buffer", |bencher| {
        bencher.iter(|| {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(&from, 0, &to, 0, COPIED_BYTES);
            gpu.queue.submit([encoder.finish()]);
            gpu.wait().expect("the device");
        });
    });
    group.finish();
}

criterion_group!(benches, transcode);
criterion_main!(benches);
