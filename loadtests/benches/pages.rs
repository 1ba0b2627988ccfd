//! Triangles a second of every way that a page goes: clusters to disk form, its frame, and back to the memory form, on one core.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lodestream_format::Cluster;
use lodestream_format::disk_form::{self, DiskForm};
use lodestream_format::frame::{self, Codec};
use lodestream_loadtests::build::inputs::Generated;
use lodestream_server::build::{BuildOptions, build};
use lodestream_shaders::cpu::transcode::transcode;

/// The pages of a built input, in all the forms that they pass through.
struct Pages {
    clusters: Vec<Vec<Cluster>>,
    words: Vec<Vec<u32>>,
    forms: Vec<DiskForm>,
    /// By codec.
    frames: [(Codec, Vec<Vec<u8>>); 2],
    triangles: u64,
    attributes: lodestream_format::cluster::Attributes,
}

fn pages(name: &str) -> Result<Pages, Box<dyn std::error::Error>> {
    let mesh = name.parse::<Generated>()?.mesh();
    let built = build(&mesh, &BuildOptions::default())?;
    let mut words = Vec::new();
    for page in &built.asset.pages {
        let bytes = built
            .pack
            .read(page.offset..page.offset + page.bytes as u64)?;
        words.push(frame::decode(&bytes)?);
    }
    let forms = words.iter().cloned().map(DiskForm::parse);
    let forms = forms.collect::<Result<Vec<_>, _>>()?;
    let framed = |codec| {
        let frames = words.iter().map(|words| frame::encode(words, codec));
        frames.collect::<Result<Vec<_>, _>>()
    };
    let frames = [
        (Codec::Zstd, framed(Codec::Zstd)?),
        (Codec::Lz4, framed(Codec::Lz4)?),
    ];
    Ok(Pages {
        clusters: forms.iter().map(DiskForm::clusters).collect(),
        frames,
        words,
        triangles: built.asset.dag_triangles,
        attributes: built.asset.attributes,
        forms,
    })
}

fn all(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("pages");
    group.sample_size(10);
    for name in ["torus:250000", "charts:60000", "foliage:60000"] {
        let pages = match pages(name) {
            Ok(pages) => pages,
            Err(error) => unreachable!("{name} builds: {error}"),
        };
        group.throughput(Throughput::Elements(pages.triangles));
        group.bench_function(format!("{name}/encode"), |bencher| {
            bencher.iter(|| {
                let encode = |clusters| disk_form::encode(clusters, pages.attributes, 0);
                pages
                    .clusters
                    .iter()
                    .map(|page| encode(page))
                    .filter(Result::is_ok)
                    .count()
            });
        });
        for (codec, frames) in &pages.frames {
            group.bench_function(format!("{name}/compress-{codec:?}"), |bencher| {
                bencher.iter(|| {
                    let frames = pages.words.iter().map(|words| frame::encode(words, *codec));
                    frames.filter(Result::is_ok).count()
                });
            });
            group.bench_function(format!("{name}/decompress-{codec:?}"), |bencher| {
                bencher.iter(|| {
                    let words = frames.iter().map(|bytes| frame::decode(bytes));
                    words.filter(Result::is_ok).count()
                });
            });
            group.bench_function(format!("{name}/decode-{codec:?}"), |bencher| {
                bencher.iter(|| {
                    let forms = frames
                        .iter()
                        .map(|bytes| frame::decode(bytes).and_then(DiskForm::parse));
                    forms.filter(Result::is_ok).count()
                });
            });
        }
        group.bench_function(format!("{name}/transcode"), |bencher| {
            bencher.iter(|| {
                let words = pages.forms.iter().map(|form| transcode(form).len());
                words.sum::<usize>()
            });
        });
    }
    group.finish();
}

criterion_group!(benches, all);
criterion_main!(benches);
