//! Triangles a second of the whole build and of its encoding.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lodestream_server::build::{BuildOptions, build};

#[path = "../tests/build_support/mod.rs"]
mod build_support;

use build_support::meshes;

fn builds(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("build");
    group.sample_size(10);
    for mesh in [
        meshes::torus(500, 250),
        meshes::two_material_box(140),
        meshes::cards(60_000),
    ] {
        group.throughput(Throughput::Elements(mesh.triangles.len() as u64));
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let Ok(pool) = pool else { continue };
            group.bench_function(format!("{}/{threads}-threads", mesh.name), |bencher| {
                bencher.iter(|| pool.install(|| build(&mesh, &BuildOptions::default())));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, builds);
criterion_main!(benches);
