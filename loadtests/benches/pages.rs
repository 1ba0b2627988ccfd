//! Triangles a second of every way that a page goes: clusters to disk form, its frame, and back to the memory form, on one core.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lodestream_format::cluster::{Attributes, NO_GROUP};
use lodestream_format::disk_form::{self, DiskForm, Parent};
use lodestream_format::frame::{self, Codec};
use lodestream_format::page_reader::PageReader;
use lodestream_format::{Cluster, FormatError, cluster_view};
use lodestream_loadtests::build::inputs::Generated;
use lodestream_server::build::{BuildOptions, BuiltAsset, build};

/// The pages of a built input, in all the forms that they pass through.
struct Pages {
    clusters: Vec<Vec<Cluster>>,
    words: Vec<Vec<u32>>,
    forms: Vec<DiskForm>,
    memory: Vec<Vec<u32>>,
    /// By codec.
    frames: [(Codec, Vec<Vec<u8>>); 2],
    triangles: u64,
    attributes: Attributes,
}

impl Pages {
    fn of(built: &BuiltAsset) -> Result<Self, Box<dyn std::error::Error>> {
        let mut words = Vec::new();
        for page in &built.asset.pages {
            let bytes = built
                .pack
                .read(page.offset..page.offset + page.bytes as u64)?;
            words.push(frame::decode(&bytes)?);
        }
        let forms = words.iter().cloned().map(DiskForm::parse);
        let forms = forms.collect::<Result<Vec<_>, _>>()?;
        let mut reader = PageReader::new(&built.asset);
        let memory = forms.iter().map(|form| Ok(reader.read(form)?.to_vec()));
        let memory = memory.collect::<Result<Vec<Vec<u32>>, FormatError>>()?;
        let framed = |codec| {
            let frames = words.iter().map(|words| frame::encode(words, codec));
            frames.collect::<Result<Vec<_>, _>>()
        };
        Ok(Self {
            clusters: memory
                .iter()
                .map(|page| cluster_view::clusters(page).collect())
                .collect(),
            frames: [
                (Codec::Zstd, framed(Codec::Zstd)?),
                (Codec::Lz4, framed(Codec::Lz4)?),
            ],
            triangles: built.asset.dag_triangles,
            attributes: built.asset.attributes,
            words,
            forms,
            memory,
        })
    }

    /// What a page's vertices can be inherited from.
    fn parents(&self, page: usize) -> Vec<Parent<'_>> {
        let own: Vec<u32> = self.clusters[page].iter().map(|it| it.group).collect();
        let mut parents = Vec::new();
        for (number, clusters) in (0..).zip(&self.clusters[..page]) {
            for (index, cluster) in (0..).zip(clusters) {
                if cluster.child_group != NO_GROUP && own.contains(&cluster.child_group) {
                    parents.push(Parent {
                        page: number,
                        index,
                        cluster,
                    });
                }
            }
        }
        parents
    }

    fn memory_form(&self, form: &DiskForm) -> Result<Vec<u32>, FormatError> {
        let page = |page: u32| self.memory.get(page as usize).map(Vec::as_slice);
        disk_form::memory_form(form, page)
    }

    fn decode(&self, frame: &[u8]) -> Result<Vec<u32>, FormatError> {
        self.memory_form(&DiskForm::parse(frame::decode(frame)?)?)
    }
}

fn all(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("pages");
    group.sample_size(10);
    for name in ["torus:250000", "charts:60000", "foliage:60000"] {
        let built = name
            .parse::<Generated>()
            .map_err(Into::into)
            .and_then(|input| Ok(build(input.mesh(), &BuildOptions::default())?))
            .and_then(|built| Pages::of(&built));
        let pages = match built {
            Ok(pages) => pages,
            Err(error) => unreachable!("{name} builds: {error}"),
        };
        let parents: Vec<_> = (0..pages.words.len()).map(|it| pages.parents(it)).collect();
        group.throughput(Throughput::Elements(pages.triangles));
        group.bench_function(format!("{name}/encode"), |bencher| {
            bencher.iter(|| {
                let all = pages.clusters.iter().zip(&parents);
                all.filter(|(clusters, parents)| {
                    disk_form::encode(clusters, pages.attributes, u32::MAX, parents).is_ok()
                })
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
                    let words = frames.iter().map(|frame| frame::decode(frame));
                    words.filter(Result::is_ok).count()
                });
            });
            group.bench_function(format!("{name}/decode-{codec:?}"), |bencher| {
                bencher.iter(|| {
                    let pages = frames.iter().map(|frame| pages.decode(frame));
                    pages.filter(Result::is_ok).count()
                });
            });
        }
        group.bench_function(format!("{name}/parse"), |bencher| {
            bencher.iter(|| {
                let forms = pages.words.iter().cloned().map(DiskForm::parse);
                forms.filter(Result::is_ok).count()
            });
        });
        group.bench_function(format!("{name}/restore"), |bencher| {
            bencher.iter(|| {
                let memory = pages.forms.iter().map(|form| pages.memory_form(form));
                memory.filter(Result::is_ok).count()
            });
        });
    }
    group.finish();
}

criterion_group!(benches, all);
criterion_main!(benches);
