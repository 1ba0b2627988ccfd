//! Triangles a second: the whole build of ours, and meshoptimizer's clusterlod with its defaults beside it.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lodestream_server::build::{BuildOptions, build};

/// What the load tests hold builders against each other with; a dependency on them would close a circle.
#[path = "../../loadtests/src/samples"]
#[allow(
    dead_code,
    unused_imports,
    reason = "the sample scenes and tests use the rest"
)]
mod samples {
    pub mod noise;
    pub mod number;
}
#[path = "../../loadtests/src/build/inputs.rs"]
#[allow(
    dead_code,
    unused_imports,
    reason = "the stability table and tests use the rest"
)]
mod inputs;

use inputs::Generated;

fn builds(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("build");
    group.sample_size(10);
    for name in ["torus:250000", "sphere:248832", "foliage:60000"] {
        let Ok(generated) = name.parse::<Generated>() else {
            unreachable!("{name} names an input")
        };
        let mesh = generated.mesh();
        group.throughput(Throughput::Elements(mesh.triangles.len() as u64));
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let Ok(pool) = pool else { continue };
            group.bench_function(format!("{name}/lodestream/{threads}-threads"), |bencher| {
                bencher.iter(|| pool.install(|| build(&mesh, &BuildOptions::default())));
            });
        }
        rival(&mut group, name, &mesh);
    }
    group.finish();
}

/// As its demo calls it: normals weighed by one half, texture seams protected.
fn rival(
    group: &mut criterion::BenchmarkGroup<criterion::measurement::WallTime>,
    name: &str,
    mesh: &lodestream_server::import::Mesh,
) {
    let (Some(normals), Some(uvs)) = (&mesh.normals, &mesh.uvs) else {
        unreachable!("{name} has normals and texture coordinates")
    };
    let attributes: Vec<f32> = normals
        .iter()
        .zip(uvs)
        .flat_map(|(&[x, y, z], &[u, v])| [x, y, z, u, v])
        .collect();
    let positions = meshopt::typed_to_bytes(&mesh.positions);
    let Ok(vertices) = meshopt::VertexDataAdapter::new(positions, 12, 0) else {
        unreachable!("twelve bytes a position")
    };
    let input = meshopt::ClodMesh {
        vertex_attributes: &attributes,
        vertex_attributes_stride: 5 * size_of::<f32>(),
        attribute_weights: &[0.5; 3],
        attribute_protect_mask: 0b11000,
        ..meshopt::ClodMesh::new(mesh.triangles.as_flattened(), &vertices)
    };
    for (preset, config) in [
        ("clusterlod", meshopt::clod_default_config(128)),
        ("clusterlod-rt", meshopt::clod_default_config_rt(128)),
    ] {
        group.bench_function(format!("{name}/{preset}"), |bencher| {
            bencher.iter(|| {
                let mut groups = 0;
                meshopt::clod_build(config, &input, |_, _| {
                    groups += 1;
                    groups - 1
                });
                groups
            });
        });
    }
}

criterion_group!(benches, builds);
criterion_main!(benches);
