//! The table: each builder on each input, timed in turns in one process, then measured.

use std::path::PathBuf;

use lodestream_format::ContentHash;
use lodestream_server::build::{BuildOptions, BuiltAsset};
use lodestream_server::import::Mesh;
use rayon::ThreadPool;
use serde::Serialize;

use super::clusterlod::{Prepared, Preset};
use super::curves::{CutFigures, EqualError, Measuring, SourceSurface, at_equal_error};
use super::dag::{ClusterDag, center_metres, source_places};
use super::edges::SourceBorder;
use super::groups::{self, GroupFigures};
use super::knobs::{self, KnobRow};
use super::memory::{self, Memory, MemoryOf, thread_pool};
use super::process::median;
use super::rows::{Builder, Run, Shape, run_clusterlod, run_ours};
use super::target::{MeshesOf, Part, StudyError};

/// Uniform-error cuts a builder.
const LADDER: usize = 10;
/// Groups of an asset that are measured, evenly spread.
const MOST_GROUPS: usize = 400;
/// Samples each way a group.
const GROUP_SAMPLES: usize = 30_000;

/// What to measure.
#[derive(Debug, Clone)]
pub struct StudyOptions {
    /// The inputs.
    pub inputs: Vec<MeshesOf>,
    /// Thread counts of ours.
    pub threads: Vec<usize>,
    /// Timed runs, each builder once a round.
    pub runs: usize,
    /// Meshes of a file with a row of their own.
    pub largest: usize,
    /// Samples each way a cut; 0 leaves out all that is measured on surfaces.
    pub samples: usize,
    /// Try every setting of every knob on the inputs of one mesh.
    pub knobs: bool,
    /// This program, for rows of memory; `None` leaves them out.
    pub program: Option<PathBuf>,
}

/// A row of the table.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Row {
    /// Input, with the mesh where it is one of several.
    pub input: String,
    /// Whose builder.
    pub builder: &'static str,
    /// Threads.
    pub threads: usize,
    /// Triangles of the input.
    pub triangles: u64,
    /// Median seconds from mesh to DAG.
    pub build_secs: f64,
    /// Input triangles by it, millions a second.
    pub mtris_per_sec: f64,
    /// Input triangles by processor seconds of the build, millions a second.
    pub mtris_per_cpu_sec: Option<f64>,
    /// Median seconds from mesh to bytes; the rival makes none.
    pub total_secs: f64,
    /// Median processor seconds of it.
    pub total_cpu_secs: Option<f64>,
    /// Build seconds of every run.
    pub runs_secs: Vec<f64>,
    /// Its clusters.
    #[serde(flatten)]
    pub shape: Shape,
    /// Mean triangles of a cluster.
    pub fill: f64,
    /// The same at level 0.
    pub fill_source: f64,
    /// The same above; `null` without levels above.
    pub fill_above: f64,
    /// Triangles of all clusters over those of the input.
    pub dag_per_input: f64,
    /// Pack and hierarchy over input triangles.
    pub stored_bytes_per_triangle: Option<f64>,
    /// Whether every run and thread count gave the same bytes.
    pub same_bytes: Option<bool>,
    /// Resident memory in a process of its own.
    #[serde(flatten)]
    pub memory: Memory,
    /// Peak over input triangles, bytes.
    pub peak_bytes_per_triangle: Option<f64>,
    /// Meshes that were refused.
    pub refused: Vec<String>,
}

/// A builder's measured cuts of an input.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Errors {
    /// The input.
    pub input: String,
    /// Whose builder.
    pub builder: &'static str,
    /// Open edges of its source clusters.
    pub source_open_edges: u64,
    /// Most edges that a cut opens.
    pub opened_edges: u64,
    /// Each level.
    pub levels: Vec<CutFigures>,
    /// Uniform-error cuts.
    pub cuts: Vec<CutFigures>,
}

/// Our triangles at the rival's errors.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Equal {
    /// The input.
    pub input: String,
    /// Geometric mean of ours over the rival's, at equal largest distance, over levels.
    pub levels_at_max: Option<f64>,
    /// At equal root mean square.
    pub levels_at_rms: Option<f64>,
    /// The worst level at equal largest distance.
    pub worst_level_at_max: Option<f64>,
    /// The worst level at equal root mean square.
    pub worst_level_at_rms: Option<f64>,
    /// Over uniform-error cuts, at equal largest distance.
    pub cuts_at_max: Option<f64>,
    /// Over uniform-error cuts, at equal root mean square.
    pub cuts_at_rms: Option<f64>,
    /// Each level of the rival.
    pub levels: Vec<EqualError>,
    /// Each uniform-error cut of the rival.
    pub cuts: Vec<EqualError>,
}

/// Our groups' promises.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Promises {
    /// The input.
    pub input: String,
    /// What was measured.
    #[serde(flatten)]
    pub figures: GroupFigures,
}

/// Everything.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Study {
    /// Timed runs.
    pub runs: usize,
    /// Samples each way a cut, at most about; 15 a triangle where that is fewer.
    pub samples: usize,
    /// The table.
    pub rows: Vec<Row>,
    /// Our triangles over the rival's.
    pub equal_error: Vec<Equal>,
    /// Our groups.
    pub promises: Vec<Promises>,
    /// Measured cuts.
    pub errors: Vec<Errors>,
    /// Settings of our build.
    pub knobs: Vec<KnobRow>,
}

/// Measures all inputs; `each` hears of every input before it starts.
///
/// # Errors
/// The first input that cannot be read.
pub fn study(options: &StudyOptions, mut each: impl FnMut(&str)) -> Result<Study, StudyError> {
    let mut study = Study {
        runs: options.runs,
        samples: options.samples,
        ..Study::default()
    };
    let pools = options
        .threads
        .iter()
        .map(|&threads| Ok((threads, thread_pool(threads)?)))
        .collect::<Result<Vec<_>, StudyError>>()?;
    for input in &options.inputs {
        let meshes = input.load()?;
        for part in Part::rows(meshes.len(), options.largest) {
            let name = row_name(input, part, &meshes);
            each(&name);
            let part_meshes = part.of(&meshes);
            let ours = time_and_shape(options, &mut study.rows, &name, part_meshes, &pools)?;
            if let Some(program) = &options.program {
                for row in study.rows.iter_mut().filter(|row| row.input == name) {
                    row.add_memory(program, input, part)?;
                }
            }
            if let (Part::Mesh(_), [mesh], Some(ours)) = (part, part_meshes, ours)
                && options.samples > 0
            {
                measure(options, &mut study, &name, mesh, &ours)?;
                if let (true, Some((_, pool))) = (options.knobs, pools.first()) {
                    let rows = knobs::rows(&name, mesh, pool, options.runs, options.samples)?;
                    study.knobs.extend(rows);
                }
            }
        }
    }
    Ok(study)
}

fn row_name(input: &MeshesOf, part: Part, meshes: &[Mesh]) -> String {
    let name = input.short_name();
    match part {
        Part::Mesh(_) if meshes.len() == 1 => name,
        Part::Mesh(index) => format!("{name}/{}", meshes[index].name),
        Part::All => format!("{name} (all {})", meshes.len()),
    }
}

/// Adds the rows of a part; gives our last asset.
fn time_and_shape(
    options: &StudyOptions,
    rows: &mut Vec<Row>,
    name: &str,
    meshes: &[Mesh],
    pools: &[(usize, ThreadPool)],
) -> Result<Option<BuiltAsset>, StudyError> {
    let rivals = [Preset::Default, Preset::Spatial];
    let mut ours: Vec<Vec<Run>> = vec![Vec::new(); pools.len()];
    let mut theirs: Vec<Vec<Run>> = vec![Vec::new(); rivals.len()];
    let mut last = None;
    let mut hashes: Vec<ContentHash> = Vec::new();
    let mut same_bytes = true;
    let (mut stored_bytes, mut shape) = (0, Shape::default());
    // In turns: what else the machine does falls on all of them.
    for round in 0..options.runs.max(1) {
        for (index, (_, pool)) in pools.iter().enumerate() {
            let first = round == 0 && index == 0;
            let mut own: Vec<ContentHash> = Vec::new();
            let mut fault = None;
            ours[index].push(run_ours(meshes, &BuildOptions::default(), pool, |built| {
                own.extend(objects(&built).map(ContentHash::of));
                if first {
                    stored_bytes += built.report.bytes.stored + built.report.bytes.hierarchy;
                    match ClusterDag::of_asset(&built) {
                        Ok(dag) => shape = shape.plus(Shape::of(&dag)),
                        Err(source) => fault = Some(source),
                    }
                }
                last = Some(built);
            }));
            if let Some(source) = fault {
                let input = name.to_owned();
                return Err(StudyError::Format { input, source });
            }
            if first {
                hashes = own;
            } else {
                same_bytes &= hashes == own;
            }
        }
        for (index, &preset) in rivals.iter().enumerate() {
            theirs[index].push(run_clusterlod(meshes, preset));
        }
    }
    let triangles: u64 = meshes.iter().map(|mesh| mesh.triangles.len() as u64).sum();
    for ((threads, _), runs) in pools.iter().zip(&ours) {
        rows.push(Row {
            same_bytes: Some(same_bytes),
            stored_bytes_per_triangle: Some(stored_bytes as f64 / triangles as f64),
            ..Row::new(name, Builder::Lodestream, *threads, triangles, runs, shape)
        });
    }
    for (&preset, runs) in rivals.iter().zip(&theirs) {
        let shapes = meshes
            .iter()
            .map(|mesh| Shape::of(&Prepared::new(mesh).dag(preset, [0.0; 3])));
        let shape = shapes.fold(Shape::default(), Shape::plus);
        let builder = Builder::Clusterlod(preset);
        rows.push(Row::new(name, builder, 1, triangles, runs, shape));
    }
    Ok(last)
}

/// The asset's object names the pack by its hash.
fn objects(built: &BuiltAsset) -> impl Iterator<Item = &[u8]> {
    [&built.asset_bytes, &built.hierarchy_bytes]
        .into_iter()
        .map(Vec::as_slice)
}

impl Row {
    fn new(
        input: &str,
        builder: Builder,
        threads: usize,
        triangles: u64,
        runs: &[Run],
        shape: Shape,
    ) -> Self {
        let middle = |figure: fn(&Run) -> Option<f64>| {
            let figures: Option<Vec<f64>> = runs.iter().map(figure).collect();
            figures.map(median)
        };
        let build_secs = median(runs.iter().map(|run| run.build_secs));
        let millions = triangles as f64 / 1e6;
        let [fill, fill_source, fill_above] = shape.fill();
        Self {
            input: input.into(),
            builder: builder.name(),
            threads,
            triangles,
            build_secs,
            mtris_per_sec: millions / build_secs,
            mtris_per_cpu_sec: middle(Run::build_cpu_secs).map(|cpu| millions / cpu),
            total_secs: median(runs.iter().map(|run| run.total_secs)),
            total_cpu_secs: middle(|run| run.total_cpu_secs),
            runs_secs: runs.iter().map(|run| run.build_secs).collect(),
            shape,
            fill,
            fill_source,
            fill_above,
            dag_per_input: shape.dag_triangles as f64 / triangles as f64,
            refused: runs
                .first()
                .map_or_else(Vec::new, |run| run.refused.clone()),
            ..Self::default()
        }
    }

    fn add_memory(
        &mut self,
        program: &std::path::Path,
        input: &MeshesOf,
        part: Part,
    ) -> Result<(), StudyError> {
        let Some(&builder) = Builder::ALL.iter().find(|it| it.name() == self.builder) else {
            return Ok(());
        };
        let of = MemoryOf {
            input: input.clone(),
            part,
            builder,
            threads: self.threads,
        };
        self.memory = memory::in_own_process(program, &of)?;
        let peak = self.memory.peak_bytes;
        self.peak_bytes_per_triangle = peak.map(|peak| peak as f64 / self.triangles as f64);
        Ok(())
    }
}

/// Adds what is measured on the surfaces of both builders.
fn measure(
    options: &StudyOptions,
    study: &mut Study,
    input: &str,
    mesh: &Mesh,
    built: &BuiltAsset,
) -> Result<(), StudyError> {
    let ours = ClusterDag::of_asset(built).map_err(|source| StudyError::Format {
        input: input.into(),
        source,
    })?;
    let center = center_metres(built);
    let step_metres = built.asset.position_grid.step();
    let source = SourceSurface::new(source_places(mesh, center));
    let rival = Prepared::new(mesh).dag(Preset::Default, center);
    let measured = |builder: Builder, dag: &ClusterDag, step_metres: f64| {
        let measuring = Measuring {
            dag,
            source: &source,
            border: SourceBorder::new(dag),
            step_metres,
            most_samples: options.samples,
        };
        let (levels, cuts) = (measuring.levels(), measuring.ladder(LADDER));
        let opened = levels.iter().chain(&cuts).map(|cut| cut.opened_edges);
        Errors {
            input: input.into(),
            builder: builder.name(),
            source_open_edges: measuring.border.open.len() as u64,
            opened_edges: opened.max().unwrap_or(0),
            levels,
            cuts,
        }
    };
    let own = measured(Builder::Lodestream, &ours, step_metres);
    let other = measured(Builder::Clusterlod(Preset::Default), &rival, 0.0);
    study.equal_error.push(Equal::of(input, &own, &other));
    let groups = groups::measure(&ours, MOST_GROUPS, GROUP_SAMPLES);
    study.promises.push(Promises {
        input: input.into(),
        figures: groups::figures(&ours, &groups, step_metres),
    });
    study.errors.extend([own, other]);
    Ok(())
}

impl Equal {
    fn of(input: &str, ours: &Errors, rival: &Errors) -> Self {
        let levels = at_equal_error(&ours.levels, &rival.levels);
        let cuts = at_equal_error(&ours.cuts, &rival.cuts);
        let max = |row: &EqualError| row.ratio_at_max;
        let rms = |row: &EqualError| row.ratio_at_rms;
        let worst = |ratio: fn(&EqualError) -> Option<f64>| {
            levels.iter().filter_map(ratio).max_by(f64::total_cmp)
        };
        Self {
            input: input.into(),
            levels_at_max: geometric_mean(levels.iter().filter_map(max)),
            levels_at_rms: geometric_mean(levels.iter().filter_map(rms)),
            worst_level_at_max: worst(max),
            worst_level_at_rms: worst(rms),
            cuts_at_max: geometric_mean(cuts.iter().filter_map(max)),
            cuts_at_rms: geometric_mean(cuts.iter().filter_map(rms)),
            levels,
            cuts,
        }
    }
}

fn geometric_mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let logs: Vec<f64> = values.map(f64::ln).collect();
    (!logs.is_empty()).then(|| (logs.iter().sum::<f64>() / logs.len() as f64).exp())
}
