//! Every pass compiles: on wgpu's noop backend, which validates everything on any machine, and on the adapter.

#![cfg(feature = "gpu")]

mod gpu_common;

use lodestream_client::gpu::{Gpu, Pipelines};
use lodestream_shaders::VisbufferTarget;
use lodestream_shaders::passes::{ALL, PRESENT, PoolBindings};

fn build_all(gpu: &Gpu, pools: &[(u32, u32)]) {
    for bindings in pools {
        let &(count, words_log2) = bindings;
        for target in VisbufferTarget::ALL {
            if target != VisbufferTarget::U64 || gpu.has_wide_atomics {
                build_for(gpu, PoolBindings { count, words_log2 }, target);
            }
        }
    }
}

fn build_for(gpu: &Gpu, pool: PoolBindings, target: VisbufferTarget) {
    let mut pipelines = Pipelines::new(gpu, pool);
    pipelines.set_target(target);
    let mut faults = Vec::new();
    for pass in &ALL {
        let target = (pass.name == PRESENT.name).then_some(wgpu::TextureFormat::Bgra8Unorm);
        if let Err(error) = pipelines.get(pass, target) {
            faults.push(error.to_string());
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert_eq!(pipelines.names().len(), ALL.len());
}

#[test]
fn every_pipeline_builds_on_the_noop_backend() {
    build_all(&Gpu::noop(), &[(1, 25)]);
    build_all(&Gpu::noop_with(wgpu::Features::empty()), &[(1, 25)]);
}

#[test]
fn every_pipeline_builds_on_the_adapter() {
    if let Some(gpu) = gpu_common::gpu() {
        build_all(&gpu, &[(1, 26), (3, 25)]);
    }
}
