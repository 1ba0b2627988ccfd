//! A plan: an ingest cut into jobs that know nothing of each other, all of it in the library.
//!
//! `plan` imports the inputs, stores textures and the scene's outline, and deals the meshes, equal ones once, to the jobs. A
//! job builds its meshes and leaves build records; `finish` needs the records alone. So jobs may run anywhere, at once, again,
//! and be killed.

use std::collections::HashSet;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Instant;

use bytes::Bytes;
use lodestream_format::ContentHash;
use lodestream_format::frame::Codec;
use lodestream_format::hash::ContentHasher;
use serde::{Deserialize, Serialize};
use tokio::runtime::Handle;

use super::deal::{self, Task, Weight};
use super::memory;
use super::neighbours::stored;
use super::progress::Progress;
use super::{
    BUILDER_VERSION, IngestError, IngestOptions, RENEW_AFTER_SECS, assets, find_all, outline,
};
use crate::build::{BuildOptions, PositionStep};
use crate::import::MeshSource;
use crate::library::{Check, Library, PlanNote, Repaired};

/// What jobs read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Plan {
    /// [`BUILDER_VERSION`] of the program that planned.
    pub builder: u32,
    pub options: PlanOptions,
    /// Bytes above which a mesh is read in pieces: its content is named piece by piece, so jobs must cut it alike.
    pub max_mesh_bytes: u64,
    pub inputs: Vec<PlanInput>,
    /// The scene's outline, an object.
    pub outline: ContentHash,
    /// Neighbours of the meshes, an object (`neighbours::stored`), in the order of
    /// `meshes`.
    pub neighbours: ContentHash,
    /// Meshes to build, each once; their keys are the `builds` of the note.
    pub meshes: Vec<PlanMesh>,
    /// What each job does.
    pub jobs: Vec<Vec<Task>>,
}

/// An input as it was when the plan was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlanInput {
    /// As it was given.
    pub path: String,
    pub bytes: u64,
    /// Of the file itself; files that it names show in the meshes' contents.
    pub hash: ContentHash,
}

/// A mesh of an input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlanMesh {
    pub name: String,
    /// Index into [`Plan::inputs`].
    pub input: u32,
    pub triangles: u64,
    pub content: ContentHash,
    /// Of its neighbours.
    pub neighbours: ContentHash,
}

/// [`BuildOptions`] as text: options must come back bit by bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlanOptions {
    /// `auto` or metres.
    position_step: String,
    placement: String,
    codec: String,
}

impl PlanOptions {
    fn new(options: &BuildOptions) -> Self {
        // Named one by one, so that an option added later cannot be forgotten here.
        let BuildOptions {
            position_step,
            placement,
            codec,
        } = options;
        Self {
            position_step: match position_step {
                PositionStep::Auto => "auto".to_owned(),
                PositionStep::Metres(metres) => metres.to_string(),
            },
            placement: placement.name().to_owned(),
            codec: match codec {
                Codec::None => "none",
                Codec::Zstd => "zstd",
                Codec::Lz4 => "lz4",
            }
            .to_owned(),
        }
    }

    /// `None` where another version wrote them.
    pub(super) fn build_options(&self) -> Option<BuildOptions> {
        Some(BuildOptions {
            position_step: match self.position_step.as_str() {
                "auto" => PositionStep::Auto,
                metres => PositionStep::Metres(metres.parse().ok()?),
            },
            placement: self.placement.parse().ok()?,
            codec: self.codec.parse().ok()?,
        })
    }
}

/// What was planned.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PlanReport {
    /// Name of plan and scene.
    pub scene: String,
    /// Meshes to build, equal ones once.
    pub meshes: u64,
    /// Their triangles.
    pub triangles: u64,
    /// Meshes among them that are built already; their jobs pass them over.
    pub reusable: u64,
    /// Textures that were damaged or missing in the library, stored anew.
    pub repaired: Repaired,
    /// The jobs.
    pub jobs: Vec<PlannedJob>,
    /// Wall-clock seconds.
    pub total_secs: f64,
}

/// A job of a plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct PlannedJob {
    /// Meshes that it builds.
    pub meshes: u64,
    /// Their triangles.
    pub triangles: u64,
}

/// Imports, and stores the plan of `options.scene` for `jobs` jobs, in place of an earlier one. Nothing is built or published.
///
/// # Errors
/// What can go wrong with the inputs and the library.
pub fn plan(
    runtime: &Handle,
    library: &Library,
    options: &IngestOptions,
    jobs: u32,
) -> Result<PlanReport, IngestError> {
    super::on_threads(options.threads, || make(runtime, library, options, jobs))
}

fn make(
    runtime: &Handle,
    library: &Library,
    options: &IngestOptions,
    jobs: u32,
) -> Result<PlanReport, IngestError> {
    let start = Instant::now();
    let progress = Progress::new(options.progress);
    let inputs: Vec<PlanInput> = options
        .inputs
        .iter()
        .map(|input| plan_input(input))
        .collect::<Result<_, _>>()?;
    let (mut merged, meshes) = super::import_all(options, &progress)?;
    let entries = outline::entries(&meshes);
    let meshes = assets::unique(meshes);
    let keys: Vec<ContentHash> = meshes.iter().map(|keyed| keyed.key).collect();
    let neighbours = stored::encode(meshes.iter().map(|keyed| &*keyed.neighbours));
    let neighbours = neighbours.map_err(IngestError::Neighbours)?;
    let planned: Vec<PlanMesh> = meshes
        .into_iter()
        .map(|keyed| PlanMesh {
            name: keyed.mesh.mesh.name().to_owned(),
            input: keyed.mesh.input,
            triangles: keyed.mesh.triangles,
            content: keyed.content,
            neighbours: keyed.neighbours.hash(),
        })
        .collect();
    let weights: Vec<Weight> = planned
        .iter()
        .map(|mesh| Weight {
            input: mesh.input,
            triangles: mesh.triangles,
        })
        .collect();
    let dealt = deal::deal(&weights, jobs);
    progress.step("looking for what is built already");
    // Only a count for the report: each job checks the objects that it reuses.
    let found = find_all(runtime, library, &keys, Check::Length, &progress)?;
    let reusable = found.known.len() as u64;

    let mut repaired = Repaired::default();
    let textures =
        super::store_textures(runtime, library, &options.scene, &mut merged, &mut repaired)?;
    let mut objects: Vec<ContentHash> = textures.iter().map(|texture| texture.object).collect();
    let outline = Bytes::from(outline::outline(merged, entries, textures).encode()?);
    let put = library.put_object(outline, RENEW_AFTER_SECS);
    let (outline, _) = runtime.block_on(put)?;
    objects.push(outline);
    let put = library.put_object(neighbours, RENEW_AFTER_SECS);
    let (neighbours, _) = runtime.block_on(put)?;
    objects.push(neighbours);
    let note = PlanNote {
        objects,
        builds: keys,
        plan: Plan {
            builder: BUILDER_VERSION,
            options: PlanOptions::new(&options.build),
            max_mesh_bytes: memory::most_mesh_bytes(options.memory_limit_bytes),
            inputs,
            outline,
            neighbours,
            meshes: planned,
            jobs: dealt,
        },
    };
    runtime.block_on(library.put_plan(&options.scene, &note))?;
    progress.end();
    Ok(PlanReport {
        scene: options.scene.clone(),
        meshes: note.plan.meshes.len() as u64,
        triangles: note.plan.meshes.iter().map(|mesh| mesh.triangles).sum(),
        reusable,
        repaired,
        jobs: note
            .plan
            .jobs
            .iter()
            .map(|job| note.plan.sum(job))
            .collect(),
        total_secs: start.elapsed().as_secs_f64(),
    })
}

impl Plan {
    fn sum(&self, tasks: &[Task]) -> PlannedJob {
        let triangles = |&Task::Mesh(mesh): &Task| self.meshes[mesh as usize].triangles;
        PlannedJob {
            meshes: tasks.len() as u64,
            triangles: tasks.iter().map(triangles).sum(),
        }
    }

    /// Checks that this program can work with the plan; gives the options of its meshes.
    ///
    /// # Errors
    /// What was expected and what was found.
    pub(super) fn check(&self, keys: &[ContentHash]) -> Result<BuildOptions, (String, String)> {
        let ensure = |ok: bool, expected: String, found: String| match ok {
            true => Ok(()),
            false => Err((expected, found)),
        };
        ensure(
            self.builder == BUILDER_VERSION,
            format!("one for builder {BUILDER_VERSION} (ingest --plan makes it)"),
            format!("one for builder {}", self.builder),
        )?;
        let options = self.options.build_options();
        let options = options.ok_or_else(|| {
            (
                "options that it knows".to_owned(),
                format!("{:?}", self.options),
            )
        })?;
        let count = self.meshes.len();
        ensure(
            keys.len() == count,
            format!("{count} builds"),
            keys.len().to_string(),
        )?;
        for (mesh, key) in self.meshes.iter().zip(keys) {
            ensure(
                super::records::key(&mesh.content, &options, &mesh.neighbours) == *key,
                format!(
                    "mesh {:?} under the name that this program gives it",
                    mesh.name
                ),
                format!("{key} (ingest --plan plans anew)"),
            )?;
            ensure(
                (mesh.input as usize) < self.inputs.len(),
                format!("inputs below {}", self.inputs.len()),
                mesh.input.to_string(),
            )?;
        }
        let tasks: Vec<u32> = self
            .jobs
            .iter()
            .flatten()
            .map(|&Task::Mesh(mesh)| mesh)
            .collect();
        let dealt: HashSet<u32> = tasks.iter().copied().collect();
        ensure(
            tasks.len() == count
                && dealt.len() == count
                && tasks.iter().all(|&mesh| (mesh as usize) < count),
            format!("each of {count} meshes in one job"),
            format!("{} tasks over {} meshes", tasks.len(), dealt.len()),
        )?;
        Ok(options)
    }
}

fn plan_input(file: &Path) -> Result<PlanInput, IngestError> {
    let wrong = |cause| IngestError::Input {
        file: file.to_owned(),
        cause,
    };
    let path = file.to_str().ok_or_else(|| {
        let text = "expected a name in UTF-8, which a plan can hold";
        wrong(std::io::Error::new(std::io::ErrorKind::InvalidInput, text))
    })?;
    let (bytes, hash) = hash_input(file)?;
    Ok(PlanInput {
        path: path.to_owned(),
        bytes,
        hash,
    })
}

/// Length and hash of a file.
pub(super) fn hash_input(file: &Path) -> Result<(u64, ContentHash), IngestError> {
    let wrong = |cause| IngestError::Input {
        file: PathBuf::from(file),
        cause,
    };
    let mut reader = std::fs::File::open(file).map_err(wrong)?;
    let (mut hasher, mut bytes) = (ContentHasher::default(), 0);
    let mut piece = vec![0; 1 << 20];
    loop {
        match reader.read(&mut piece) {
            Ok(0) => return Ok((bytes, hasher.finish())),
            Ok(read) => {
                hasher.update(&piece[..read]);
                bytes += read as u64;
            }
            Err(cause) if cause.kind() == std::io::ErrorKind::Interrupted => {}
            Err(cause) => return Err(wrong(cause)),
        }
    }
}
