//! What each command does: it prints the figures, and writes them as JSON where asked to.

use std::path::Path;

use lodestream_client::path::{CameraPath, PathError};
use lodestream_client::stream::{OpenedScene, Source, StreamError, Transport};
use lodestream_client::trace::Trace;
use lodestream_loadtests::build::libraries;
use lodestream_loadtests::build::memory::{self, MemoryOf};
use lodestream_loadtests::build::print as build_print;
use lodestream_loadtests::build::stability::{self, Sizes};
use lodestream_loadtests::build::stored::{self, StoredError};
use lodestream_loadtests::build::study::{self, StudyOptions as BuildStudyOptions};
use lodestream_loadtests::build::target::{MeshesOf, StudyError};
use lodestream_loadtests::compare::{self, CompareError, DepthImage, Picture};
use lodestream_loadtests::load::{self, LoadError, LoadOptions};
use lodestream_loadtests::pages::{self, PagesOptions};
use lodestream_loadtests::policies::{self, LinkSpeed, StudyOptions};
use lodestream_loadtests::record::{self, RecordError};
use lodestream_loadtests::report::{self, ReportError};
use lodestream_loadtests::samples::{self, SampleError};
use lodestream_server::build::BuildOptions;
use lodestream_server::library::Library;
use serde::Serialize;
use serde_json::{Value, json};

use crate::cli::{
    Build, BuildMemory, Cli, Command, Common, Compare, Libraries, Load, Measure, Pages, Policies,
    Record, Sample, TransportName,
};

const MEBIBYTE: u64 = 1 << 20;

/// Why a command failed: one line.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// The library or the page pool.
    #[error(transparent)]
    Stream(#[from] StreamError),
    /// The camera path.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A trace.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The load test.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// No threads.
    #[error("worker threads: expected to start them, found {0}")]
    Threads(std::io::Error),
    /// A sample scene.
    #[error(transparent)]
    Sample(#[from] SampleError),
    /// Pictures.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// The page.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// Neither a trace nor what to record one from.
    #[error("policies: expected a trace, or a URL with a scene and a path, found neither")]
    NoTrace,
    /// Builders.
    #[error(transparent)]
    Build(#[from] StudyError),
    /// A stored scene.
    #[error(transparent)]
    Stored(#[from] StoredError),
    /// This program's own file.
    #[error("expected to find this program's file, found {0}")]
    Program(std::io::Error),
    /// Cases that do not hold.
    #[error("stability: expected every row to hold, found {failed} of {rows} that do not")]
    Unstable {
        /// Those that do not.
        failed: usize,
        /// All.
        rows: usize,
    },
    /// A file to be written.
    #[error("{file}: expected to write it, found {source}")]
    Write {
        /// The file.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
}

/// Does what the command line says.
///
/// # Errors
/// The first failure.
pub fn run(cli: Cli) -> Result<(), CommandError> {
    let figures = match cli.command {
        Command::Policies(arguments) => study(&arguments)?,
        Command::Record(arguments) => write_trace(&arguments)?,
        Command::Load(arguments) => load_server(arguments)?,
        Command::Sample(sample) => make_sample(sample)?,
        Command::Compare(files) => compare_pictures(&files)?,
        Command::Build(arguments) => return compare_builders(arguments, &cli.common),
        Command::Libraries(arguments) => return compare_libraries(arguments, &cli.common),
        Command::Measure(arguments) => return measure_stored(&arguments, &cli.common),
        Command::Pages(arguments) => return measure_pages(arguments, &cli.common),
        Command::BuildMemory(arguments) => return build_memory(arguments),
        Command::Stability { full, case } => return measure_stability(full, &case, &cli.common),
        Command::Report { folder } => json!({ "page": report::write(&folder)? }),
    };
    finish(&figures, &cli.common)
}

fn compare_builders(arguments: Build, common: &Common) -> Result<(), CommandError> {
    let files = arguments.inputs.into_iter().map(MeshesOf::File);
    let generated = arguments.generate.into_iter().map(MeshesOf::Generated);
    let options = BuildStudyOptions {
        inputs: files.chain(generated).collect(),
        threads: arguments.threads,
        runs: usize::from(arguments.runs),
        largest: arguments.largest,
        samples: arguments.samples,
        knobs: arguments.knobs,
        program: match arguments.no_memory {
            true => None,
            false => Some(std::env::current_exe().map_err(CommandError::Program)?),
        },
    };
    let study = study::study(&options, |input| tracing::info!("building {input}"))?;
    finish_text(&build_print::study(&study), &value(&study), common)
}

fn compare_libraries(arguments: Libraries, common: &Common) -> Result<(), CommandError> {
    let files = arguments.inputs.into_iter().map(MeshesOf::File);
    let generated = arguments.generate.into_iter().map(MeshesOf::Generated);
    let inputs: Vec<MeshesOf> = files.chain(generated).collect();
    let rows = libraries::study(&inputs, |input| tracing::info!("building {input}"))?;
    finish_text(&build_print::libraries(&rows), &value(&rows), common)
}

fn measure_stored(arguments: &Measure, common: &Common) -> Result<(), CommandError> {
    let runtime = tokio::runtime::Runtime::new().map_err(CommandError::Threads)?;
    let library = runtime.block_on(Library::open_existing(&arguments.library));
    let library = library.map_err(StoredError::from)?;
    let (largest, samples) = (arguments.largest, arguments.samples);
    let stored = stored::measure(&library, &arguments.scene, largest, samples);
    let stored = runtime.block_on(stored)?;
    finish_text(&build_print::stored(&stored), &value(&stored), common)
}

fn measure_pages(arguments: Pages, common: &Common) -> Result<(), CommandError> {
    let files = arguments.inputs.into_iter().map(MeshesOf::File);
    let generated = arguments.generate.into_iter().map(MeshesOf::Generated);
    let options = PagesOptions {
        inputs: files.chain(generated).collect(),
        steps: arguments.bits,
        placements: arguments.placement,
    };
    let rows = pages::study(&options, |input| tracing::info!("building {input}"))?;
    let figures = json!({ "rows": value(&rows) });
    finish_text(&build_print::pages(&rows), &figures, common)
}

fn build_memory(arguments: BuildMemory) -> Result<(), CommandError> {
    let memory = memory::measure(&MemoryOf {
        input: arguments.input,
        part: arguments.part,
        builder: arguments.builder,
        threads: arguments.threads,
    })?;
    println!("{}", value(&memory));
    Ok(())
}

fn measure_stability(full: bool, case: &str, common: &Common) -> Result<(), CommandError> {
    let sizes = if full { Sizes::FULL } else { Sizes::USUAL };
    let table = stability::table(sizes, case, &BuildOptions::default(), |row| {
        let (build, measure) = (row.build_secs, row.measure_secs);
        tracing::info!("{}: {build:.2} s, measured in {measure:.2} s", row.case);
    });
    finish_text(&build_print::stability(&table), &value(&table), common)?;
    match table.failed {
        0 => Ok(()),
        failed => Err(CommandError::Unstable {
            failed,
            rows: table.rows.len() + table.claims.len(),
        }),
    }
}

/// As [`finish`], for figures with a text of their own.
fn finish_text(text: &str, figures: &Value, common: &Common) -> Result<(), CommandError> {
    if !common.quiet {
        print!("{text}");
    }
    match &common.report {
        Some(file) => write(file, format!("{figures:#}\n").as_bytes()),
        None => Ok(()),
    }
}

fn finish(figures: &Value, common: &Common) -> Result<(), CommandError> {
    if !common.quiet {
        print(figures, "");
    }
    match &common.report {
        Some(file) => write(file, format!("{figures:#}\n").as_bytes()),
        None => Ok(()),
    }
}

/// One line a figure, and tables as tables; for readers, so with three digits where they are no whole numbers.
fn print(figures: &Value, prefix: &str) {
    let Value::Object(fields) = figures else {
        println!("{prefix} {}", cell(figures));
        return;
    };
    for (key, value) in fields {
        let name = match prefix {
            "" => key.clone(),
            prefix => format!("{prefix}.{key}"),
        };
        match value {
            Value::Array(rows) => print_table(&name, rows),
            value => print(value, &name),
        }
    }
}

fn print_table(name: &str, rows: &[Value]) {
    println!("{name}:");
    let Some(heads) = rows.first().and_then(Value::as_object) else {
        rows.iter().for_each(|row| println!("  {}", cell(row)));
        return;
    };
    let width = |head: &String| head.len().max(13);
    let line = |texts: Vec<String>| println!(" {}", texts.concat());
    line(
        heads
            .keys()
            .map(|head| format!(" {head:>0$}", width(head)))
            .collect(),
    );
    for row in rows {
        let text = |head: &String| cell(row.get(head).unwrap_or(&Value::Null));
        line(
            heads
                .keys()
                .map(|head| format!(" {:>1$}", text(head), width(head)))
                .collect(),
        );
    }
}

fn cell(value: &Value) -> String {
    match value {
        Value::Null => "-".to_owned(),
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_f64() => number
            .as_f64()
            .map_or_else(|| number.to_string(), report::number),
        Value::Object(fields) => fields.values().map(cell).collect::<Vec<_>>().join(" "),
        value => value.to_string(),
    }
}

fn write(file: &Path, bytes: &[u8]) -> Result<(), CommandError> {
    std::fs::write(file, bytes).map_err(|source| CommandError::Write {
        file: file.display().to_string(),
        source,
    })
}

fn value(figures: &impl Serialize) -> Value {
    // Reports are plain structs with string keys, so nothing in them can fail to serialize; were it otherwise the figures
    // say so instead of hiding it.
    serde_json::to_value(figures).unwrap_or_else(|error| json!({ "error": error.to_string() }))
}

fn runtime() -> Result<tokio::runtime::Runtime, CommandError> {
    tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .map_err(CommandError::Threads)
}

fn open(url: &str, scene: &str) -> Result<OpenedScene, CommandError> {
    Ok(runtime()?.block_on(async { Source::connect(url)?.open(scene).await })?)
}

fn record_trace(
    url: &str,
    scene: &str,
    path: &Path,
    pixel_error_px: f64,
) -> Result<Trace, CommandError> {
    let path = CameraPath::read(path)?;
    let opened = open(url, scene)?;
    Ok(record::record(
        scene,
        &opened,
        &path,
        pixel_error_px as f32,
    )?)
}

fn study(arguments: &Policies) -> Result<Value, CommandError> {
    let trace = match (
        &arguments.trace,
        &arguments.url,
        &arguments.scene,
        &arguments.path,
    ) {
        (Some(file), ..) => record::read(file)?,
        (None, Some(url), Some(scene), Some(path)) => {
            record_trace(url, scene, path, arguments.pixel_error)?
        }
        // The command line does not parse without.
        _ => return Err(CommandError::NoTrace),
    };
    let options = StudyOptions {
        policies: arguments.policies.to_vec(),
        pools_bytes: arguments
            .pool
            .iter()
            .map(|mebibytes| mebibytes * MEBIBYTE)
            .collect(),
        viewers: usize::from(arguments.viewers),
        pixel_error_px: arguments.pixel_error as f32,
        link: LinkSpeed {
            bandwidth_mbps: arguments.bandwidth,
            latency_ms: arguments.latency,
        },
        order: arguments.order,
    };
    let study = policies::study(&trace, &options)?;
    if let Some(file) = &arguments.html {
        write(file, policies::page(&study).as_bytes())?;
    }
    Ok(value(&study))
}

fn write_trace(arguments: &Record) -> Result<Value, CommandError> {
    let trace = record_trace(
        &arguments.url,
        &arguments.scene,
        &arguments.path,
        arguments.pixel_error,
    )?;
    record::write_file(&trace, arguments.format, &arguments.trace)?;
    let mut figures = value(&policies::TraceFigures::of(&trace));
    figures["trace"] = json!(arguments.trace);
    Ok(figures)
}

fn load_server(arguments: Load) -> Result<Value, CommandError> {
    // One of the two given: the other does not hold anything up.
    let link = (arguments.bandwidth.is_some() || arguments.latency.is_some()).then(|| LinkSpeed {
        bandwidth_mbps: arguments.bandwidth.unwrap_or(1e6),
        latency_ms: arguments.latency.unwrap_or(0.0),
    });
    let options = LoadOptions {
        url: arguments.url,
        scene: arguments.scene,
        viewers: usize::from(arguments.viewers),
        seconds: arguments.seconds,
        rate: arguments.rate,
        link,
        transport: match arguments.transport {
            TransportName::Get => Transport::Get,
            TransportName::Post => Transport::Post,
        },
        pool_bytes: arguments.pool * MEBIBYTE,
        pixel_error_px: arguments.pixel_error as f32,
        seed: arguments.seed,
    };
    Ok(value(&runtime()?.block_on(load::run(options))?))
}

fn make_sample(sample: Sample) -> Result<Value, CommandError> {
    let (glb, out) = match sample {
        Sample::City {
            out,
            instances,
            unique,
            seed,
        } => (samples::city(instances, unique, seed), out),
        Sample::Rock {
            out,
            triangles,
            seed,
        } => (samples::rock(triangles, seed), out),
        Sample::Crowd {
            out,
            instances,
            triangles,
            seed,
        } => (samples::crowd(instances, triangles, seed), out),
    };
    glb.write(&out)?;
    Ok(json!({
        "out": out,
        "unique_triangles": glb.unique_triangles,
        "instances": glb.instances,
        "instanced_triangles": glb.instanced_triangles,
    }))
}

fn compare_pictures(files: &Compare) -> Result<Value, CommandError> {
    let picture = Picture::read(&files.picture)?;
    let reference = Picture::read(&files.reference)?;
    let depths = match files.depths.as_deref() {
        Some([depth, reference]) => Some((DepthImage::read(depth)?, DepthImage::read(reference)?)),
        _ => None,
    };
    let depths = depths.as_ref().map(|(depth, reference)| (depth, reference));
    Ok(value(&compare::compare(&picture, &reference, depths)?))
}
