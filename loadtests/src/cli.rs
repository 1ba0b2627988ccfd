//! The command line: words and defaults. What the commands do is in `commands.rs`.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use lodestream_loadtests::build::inputs::Generated;
use lodestream_loadtests::build::rows::Builder;
use lodestream_loadtests::build::target::{MeshesOf, Part};
use lodestream_loadtests::pages::Step;
use lodestream_loadtests::policies::{Order, PolicyName};
use lodestream_loadtests::record::TraceFormat;
use lodestream_server::build::Placement;

/// Load tests, eviction policies and sample scenes for Lodestream; needs no GPU.
#[derive(Debug, Parser)]
#[command(version, about, long_about = None, arg_required_else_help = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Options of every command.
    #[command(flatten)]
    pub common: Common,
}

/// Options of every command.
#[derive(Debug, Clone, Args)]
pub struct Common {
    /// Write the figures as JSON.
    #[arg(long, global = true, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Print nothing but errors.
    #[arg(long, short, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Say more on standard error; twice for everything.
    #[arg(long, short, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
}

/// A command.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Replay a trace with each eviction policy at each pool size, in simulated time.
    Policies(Policies),
    /// Record which pages a camera path wants, as a trace.
    Record(Record),
    /// Load a server with many virtual viewers over real HTTP.
    Load(Load),
    /// Make a sample scene.
    #[command(subcommand)]
    Sample(Sample),
    /// Measure how far a picture is from its reference.
    Compare(Compare),
    /// Hold our builder against clusterlod: time, memory, clusters, and errors measured on dense samples.
    Build(Build),
    /// Hold single stages of our build against what libraries offer for them: meshoptimizer and METIS.
    Libraries(Libraries),
    /// Measure a scene that a library holds against its own finest level: what groups promise, levels, open edges.
    Measure(Measure),
    /// What pages cost: stored bytes over position steps and placements, part by part, beside the same mesh without levels.
    Pages(Pages),
    /// Peak memory of one build; what `build` runs for each of its rows.
    #[command(hide = true)]
    BuildMemory(BuildMemory),
    /// Build stiff and extreme meshes and measure them against an f64 reference; exit 1 where something does not hold.
    Stability {
        /// A million where a case says so; otherwise 20,000.
        #[arg(long)]
        full: bool,
        /// Only cases whose names contain this.
        #[arg(long, value_name = "TEXT", default_value = "")]
        case: String,
    },
    /// Gather the JSON reports and pictures of a folder in one page, `index.html`.
    Report {
        /// Holds `build-*.json`, `builders-*.json`, `pages-*.json`, `draw-*.json`,
        /// `compare-*.json`, `play-*.json`, `policies-*.json`, `load-*.json`, `judges-*.json` and
        /// `*.png`.
        folder: PathBuf,
    },
}

/// Arguments of `policies`.
#[derive(Debug, Args)]
pub struct Policies {
    /// A trace that `record` or the client's `play --trace` wrote.
    #[arg(long, value_name = "FILE", required_unless_present = "url", conflicts_with_all = ["url", "scene", "path"])]
    pub trace: Option<PathBuf>,
    /// Without a trace: a server (`http://…`) or a library folder, to record one in memory.
    #[arg(requires_all = ["scene", "path"])]
    pub url: Option<String>,
    /// The scene to record.
    #[arg(long, value_name = "NAME", requires = "url")]
    pub scene: Option<String>,
    /// The camera path to record.
    #[arg(long, value_name = "FILE", requires = "url")]
    pub path: Option<PathBuf>,
    /// Pool sizes, MiB.
    #[arg(long, value_name = "MiB[,MiB...]", value_delimiter = ',', required = true, value_parser = clap::value_parser!(u64).range(1..=16_384))]
    pub pool: Vec<u64>,
    /// Policies: `all`, or some of lru, lowest-error, decayed-error, fifo, clock, clairvoyant.
    #[arg(long, value_name = "all|A,B", default_value = "all", value_parser = policies)]
    pub policies: std::sync::Arc<[PolicyName]>,
    /// Viewers, each with a pool and a link of its own, walking the trace from evenly spaced frames on; figures are added up.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    pub viewers: u16,
    /// Each viewer's bandwidth.
    #[arg(long, value_name = "Mbps", default_value_t = 50.0, value_parser = positive)]
    pub bandwidth: f64,
    /// Each viewer's latency from a request to its answer's first byte.
    #[arg(long, value_name = "MS", default_value_t = 40.0, value_parser = not_negative)]
    pub latency: f64,
    /// The pixel error that the viewers ask for.
    #[arg(long, value_name = "PX", default_value_t = 1.0, value_parser = positive)]
    pub pixel_error: f64,
    /// By what pages are put in order: the error that they remove over all instances, or the
    /// largest.
    #[arg(long, value_enum, default_value = "total")]
    pub order: Order,
    /// Write a page of plots and a table.
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
}

/// Arguments of `record`.
#[derive(Debug, Args)]
pub struct Record {
    /// A server (`http://…`) or a library folder.
    pub url: String,
    /// The scene.
    #[arg(long, value_name = "NAME")]
    pub scene: String,
    /// The camera path.
    #[arg(long, value_name = "FILE")]
    pub path: PathBuf,
    /// Where to write the trace.
    #[arg(long, value_name = "FILE")]
    pub trace: PathBuf,
    /// How to write it.
    #[arg(long, value_enum, default_value = "lodestream")]
    pub format: TraceFormat,
    /// The pixel error that the viewer asks for.
    #[arg(long, value_name = "PX", default_value_t = 1.0, value_parser = positive)]
    pub pixel_error: f64,
}

/// Arguments of `load`.
#[derive(Debug, Args)]
pub struct Load {
    /// A server (`http://…`), or a library folder without a server.
    pub url: String,
    /// The scene; without one, viewers take turns over all of them.
    #[arg(long, value_name = "NAME")]
    pub scene: Option<String>,
    /// Viewers.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub viewers: u16,
    /// How long to run.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: f64,
    /// Each viewer's bandwidth; unbounded unless this or the latency is given.
    #[arg(long, value_name = "Mbps", value_parser = positive)]
    pub bandwidth: Option<f64>,
    /// Each viewer's added latency of a round trip.
    #[arg(long, value_name = "MS", value_parser = not_negative)]
    pub latency: Option<f64>,
    /// Updates a second and viewer.
    #[arg(long, value_name = "R", default_value_t = 10.0, value_parser = rate)]
    pub rate: f64,
    /// How pages are asked for: a GET a page range, or posts that name everything wanted.
    #[arg(long, value_enum, default_value = "get")]
    pub transport: TransportName,
    /// Page pool of each viewer; no memory is taken.
    #[arg(long, value_name = "MiB", default_value_t = 128, value_parser = clap::value_parser!(u64).range(1..=16_384))]
    pub pool: u64,
    /// The pixel error that the viewers ask for.
    #[arg(long, value_name = "PX", default_value_t = 1.0, value_parser = positive)]
    pub pixel_error: f64,
    /// Another number, other walks.
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
}

/// How pages are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TransportName {
    /// A GET a page range.
    Get,
    /// `POST /v1/pages`.
    Post,
}

/// A sample scene.
#[derive(Debug, Subcommand)]
pub enum Sample {
    /// Thousands of instances of a few detailed meshes.
    City {
        /// Where to write it.
        #[arg(long, value_name = "FILE.glb")]
        out: PathBuf,
        /// Instances.
        #[arg(long, value_name = "N", default_value_t = 4000, value_parser = clap::value_parser!(u32).range(1..))]
        instances: u32,
        /// Unique meshes, at least 8.
        #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(8..))]
        unique: u32,
        /// Another number, another city.
        #[arg(long, value_name = "S", default_value_t = 1)]
        seed: u64,
    },
    /// One rock many times, and five others in front of it.
    Crowd {
        /// Where to write it.
        #[arg(long, value_name = "FILE.glb")]
        out: PathBuf,
        /// Instances of the one rock.
        #[arg(long, value_name = "N", default_value_t = 1000,
            value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
        instances: u32,
        /// Triangles of each rock; the nearest 12 n² is made.
        #[arg(long, value_name = "N", default_value_t = 60_000,
            value_parser = clap::value_parser!(u32).range(48..))]
        triangles: u32,
        /// Another number, other rocks.
        #[arg(long, value_name = "S", default_value_t = 1)]
        seed: u64,
    },
    /// One closed surface with detail at every scale.
    Rock {
        /// Where to write it.
        #[arg(long, value_name = "FILE.glb")]
        out: PathBuf,
        /// Triangles; the nearest 12 n² is made.
        #[arg(long, value_name = "N", default_value_t = 300_000, value_parser = clap::value_parser!(u32).range(48..))]
        triangles: u32,
        /// Another number, another rock.
        #[arg(long, value_name = "S", default_value_t = 1)]
        seed: u64,
    },
}

/// Arguments of `build`.
#[derive(Debug, Args)]
pub struct Build {
    /// .glb or .gltf files.
    #[arg(value_name = "INPUT", required_unless_present = "generate")]
    pub inputs: Vec<PathBuf>,
    /// Made inputs, as SHAPE:TRIANGLES; shapes are torus, sphere, charts, facet, foliage.
    #[arg(long, value_name = "SHAPE:N", num_args = 1..)]
    pub generate: Vec<Generated>,
    /// Thread counts of our builder; clusterlod has one.
    #[arg(long, value_name = "N[,N...]", value_delimiter = ',', default_value = "1,2", value_parser = threads)]
    pub threads: Vec<usize>,
    /// Timed runs, the builders in turns; medians are shown.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..))]
    pub runs: u16,
    /// Meshes of a file with a row of their own, beside the whole file.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub largest: usize,
    /// Samples each way a cut at most, about; 15 a triangle where that is fewer. 0: measure no surface.
    #[arg(long, value_name = "N", default_value_t = 300_000)]
    pub samples: usize,
    /// Try every setting of every knob of our build on each mesh with a row of its own.
    #[arg(long)]
    pub knobs: bool,
    /// Leave out the memory of each row.
    #[arg(long)]
    pub no_memory: bool,
}

/// Arguments of `libraries`.
#[derive(Debug, Args)]
pub struct Libraries {
    /// .glb or .gltf files; of each the largest mesh.
    #[arg(value_name = "INPUT", required_unless_present = "generate")]
    pub inputs: Vec<PathBuf>,
    /// Made inputs, as SHAPE:TRIANGLES; shapes are torus, sphere, charts, facet, foliage.
    #[arg(long, value_name = "SHAPE:N", num_args = 1..)]
    pub generate: Vec<Generated>,
}

/// Arguments of `measure`.
#[derive(Debug, Args)]
pub struct Measure {
    /// The library folder.
    #[arg(value_name = "LIB")]
    pub library: String,
    /// The scene.
    #[arg(long, value_name = "NAME")]
    pub scene: String,
    /// Assets of the scene, the largest first.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub largest: usize,
    /// Samples each way a cut at most, about; 15 a triangle where that is fewer.
    #[arg(long, value_name = "N", default_value_t = 300_000)]
    pub samples: usize,
}

/// Arguments of `pages`.
#[derive(Debug, Args)]
pub struct Pages {
    /// .glb or .gltf files.
    #[arg(value_name = "INPUT", required_unless_present = "generate")]
    pub inputs: Vec<PathBuf>,
    /// Made inputs, as SHAPE:TRIANGLES; shapes are torus, sphere, charts, facet, foliage.
    #[arg(long, value_name = "SHAPE:N", num_args = 1..)]
    pub generate: Vec<Generated>,
    /// Position steps: auto, or bits of the largest side of a mesh, 8 to 22.
    #[arg(
        long,
        value_name = "auto|N[,...]",
        value_delimiter = ',',
        default_value = "auto,14"
    )]
    pub bits: Vec<Step>,
    /// Placements: optimal, subset.
    #[arg(long, value_name = "A[,B]", value_delimiter = ',', default_value = "optimal,subset", value_parser = placement)]
    pub placement: Vec<Placement>,
}

/// Arguments of `build-memory`.
#[derive(Debug, Args)]
pub struct BuildMemory {
    /// A file or a made input.
    pub input: MeshesOf,
    /// Which mesh, the largest first, or all.
    #[arg(long, default_value = "all")]
    pub part: Part,
    /// Whose builder.
    #[arg(long, value_parser = builder)]
    pub builder: Builder,
    /// Threads of ours.
    #[arg(long, default_value = "1", value_parser = threads)]
    pub threads: usize,
}

/// Arguments of `compare`.
#[derive(Debug, Args)]
pub struct Compare {
    /// The picture, a PNG of 8-bit RGB or RGBA.
    pub picture: PathBuf,
    /// What it should look like.
    pub reference: PathBuf,
    /// Depth images of both (PFM), for the coverage.
    #[arg(long, num_args = 2, value_names = ["PICTURE.pfm", "REFERENCE.pfm"])]
    pub depths: Option<Vec<PathBuf>>,
}

fn policies(text: &str) -> Result<std::sync::Arc<[PolicyName]>, String> {
    if text == "all" {
        return Ok(PolicyName::ALL.into());
    }
    text.split(',')
        .map(|name| PolicyName::from_str(name, false))
        .collect()
}

fn builder(text: &str) -> Result<Builder, String> {
    let known = Builder::ALL.into_iter().find(|it| it.name() == text);
    known.ok_or_else(|| {
        format!(
            "expected one of {}",
            Builder::ALL.map(Builder::name).join(", ")
        )
    })
}

fn threads(text: &str) -> Result<usize, String> {
    let threads = text.parse().ok().filter(|it| (1..=1024).contains(it));
    threads.ok_or_else(|| "expected 1 to 1024 threads".to_owned())
}

fn number(text: &str, expected: &str, fits: impl Fn(f64) -> bool) -> Result<f64, String> {
    let number = text
        .parse::<f64>()
        .ok()
        .filter(|&number| number.is_finite() && fits(number));
    number.ok_or_else(|| format!("expected {expected}"))
}

fn positive(text: &str) -> Result<f64, String> {
    number(text, "a number above 0", |number| number > 0.0)
}

fn not_negative(text: &str) -> Result<f64, String> {
    number(text, "a number from 0 to 60000", |number| {
        (0.0..=60_000.0).contains(&number)
    })
}

fn seconds(text: &str) -> Result<f64, String> {
    number(text, "seconds above 0, at most a day", |number| {
        number > 0.0 && number <= 86_400.0
    })
}

fn rate(text: &str) -> Result<f64, String> {
    number(text, "updates a second from 0.01 to 1000", |number| {
        (0.01..=1000.0).contains(&number)
    })
}

fn placement(text: &str) -> Result<Placement, String> {
    match text {
        "optimal" => Ok(Placement::Optimal),
        "subset" => Ok(Placement::Subset),
        _ => Err(format!("expected optimal or subset, found {text:?}")),
    }
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory, Parser};

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn what_scripts_call_parses_and_wrong_usage_does_not() {
        let parses = |line: &str| Cli::try_parse_from(line.split(' ')).is_ok();
        for line in [
            "l policies --trace t --pool 8,12,16 --report r.json",
            "l policies http://h --scene s --path p.json --pool 8 --policies lru,clairvoyant --viewers 3 --order largest --html x.html",
            "l record http://h --scene s --path p.json --trace t --format oracle-general",
            "l load http://h --viewers 24 --seconds 10 --report r.json",
            "l load http://h --scene s --viewers 2 --seconds 1.5 --bandwidth 10 --latency 40 --rate 30 --transport post",
            "l sample city --out c.glb --instances 100 --unique 8 --seed 2",
            "l sample rock --out r.glb --triangles 5000 --quiet",
            "l sample crowd --out c.glb --instances 100 --triangles 5000 --seed 2",
            "l compare a.png b.png --depths a.pfm b.pfm --report r.json",
            "l report folder",
            "l build a.glb b.glb --threads 1,2 --report r.json",
            "l build --generate torus:1000000 sphere:1000000 --runs 5 --samples 0",
            "l libraries a.glb --generate torus:1000",
            "l build-memory torus:1000 --part 0 --builder clusterlod",
            "l stability --full --report r.json",
        ] {
            assert!(parses(line), "{line}");
        }
        for line in [
            "l",
            "l policies --pool 8",
            "l policies --trace t",
            "l policies --trace t http://h --scene s --path p --pool 8",
            "l policies http://h --pool 8",
            "l policies --trace t --pool 8 --policies lfu",
            "l policies --trace t --pool 0",
            "l load http://h --viewers 0 --seconds 1",
            "l load http://h --viewers 1 --seconds -1",
            "l load http://h --viewers 1 --seconds 1 --bandwidth nan",
            "l record http://h --scene s --path p --trace t --format xml",
            "l compare a.png b.png --depths a.pfm",
            "l build",
            "l build --generate cube:9",
            "l build a.glb --threads 0",
            "l build-memory torus:1000 --builder bevy",
        ] {
            assert!(!parses(line), "{line}");
        }
    }
}
