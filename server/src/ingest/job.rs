//! A job of a plan, and the end of a plan.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use lodestream_format::ContentHash;
use tokio::runtime::Handle;

use super::arrange::Freedom;
use super::assets::{self, Builder, KeyedMesh, NamedMesh};
use super::deal::Task;
use super::merge::{Merged, MergedMesh};
use super::neighbours::stored;
use super::plan::{Plan, PlanMesh, hash_input};
use super::progress::{Progress, ProgressTo};
use super::report::{self, Clock};
use super::{
    FoundBuilds, IngestError, IngestReport, IngestSeconds, RENEW_AFTER_SECS, arrange, find_all,
    memory, outline,
};
use crate::build::{BuildOptions, Neighbours};
use crate::import::{self, OpenOptions};
use crate::library::{Check, Library, PlanNote, Repaired, Replaces};

/// What the caller of a job chooses; all else is in the plan.
#[derive(Debug, Clone, Default)]
pub struct JobOptions {
    /// Name of the planned scene.
    pub scene: String,
    /// Which job, from 0.
    pub job: u32,
    /// Where the inputs lie on this machine, in the order of the plan; where the plan says if there are none.
    pub inputs: Vec<PathBuf>,
    /// Threads of the build; all cores where it is `None`.
    pub threads: Option<usize>,
    /// Stay below; see [`super::IngestOptions::memory_limit_bytes`].
    pub memory_limit_bytes: Option<u64>,
    /// Folder for what does not fit memory; the system's own for temporary files where it is `None`.
    pub scratch: Option<PathBuf>,
    /// Build also what the library holds already.
    pub rebuild: bool,
    /// Open no file but the inputs: see [`OpenOptions::self_contained`].
    pub self_contained: bool,
    /// How stored objects are checked before they count as built.
    pub check: Check,
    /// Where progress goes.
    pub progress: ProgressTo,
}

/// What a job did.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct JobReport {
    /// The planned scene.
    pub scene: String,
    /// Which job, from 0.
    pub job: u32,
    /// Jobs of the plan.
    pub jobs: u32,
    /// Meshes of the job.
    pub meshes: u64,
    /// Those built now.
    pub built: u64,
    /// Those found in the library.
    pub reused: u64,
    /// Objects that were damaged or missing in the library, stored anew.
    pub repaired: Repaired,
    /// Triangles of the meshes built now.
    pub triangles: u64,
    /// Wall-clock time.
    pub seconds: IngestSeconds,
    /// Largest resident set of the process, where the system tells.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak_rss_bytes: Option<u64>,
}

/// Builds and stores the meshes of one job, those that are stored already passed over.
///
/// # Errors
/// No such plan or job, an input that is not as it was planned, and what can go wrong in a build.
pub fn job(
    runtime: &Handle,
    library: &Library,
    options: &JobOptions,
) -> Result<JobReport, IngestError> {
    super::on_threads(options.threads, || run(runtime, library, options))
}

fn run(
    runtime: &Handle,
    library: &Library,
    options: &JobOptions,
) -> Result<JobReport, IngestError> {
    let start = Instant::now();
    let progress = Progress::new(options.progress);
    let (note, build_options) = read_plan(runtime, library, &options.scene)?;
    let plan = &note.plan;
    let no_fit = |expected, found| fault(library, &options.scene, expected, found);
    let Some(tasks) = plan.jobs.get(options.job as usize) else {
        let expected = format!("a job of 0 to {}", plan.jobs.len().saturating_sub(1));
        return Err(no_fit(expected, options.job.to_string()));
    };
    if !options.inputs.is_empty() && options.inputs.len() != plan.inputs.len() {
        let expected = format!("all {} inputs or none", plan.inputs.len());
        return Err(no_fit(expected, options.inputs.len().to_string()));
    }
    let keys: Vec<ContentHash> = tasks
        .iter()
        .map(|&Task::Mesh(mesh)| note.builds[mesh as usize])
        .collect();
    let looking = Instant::now();
    let FoundBuilds { known, broken } = match options.rebuild {
        true => FoundBuilds::default(),
        false => find_all(runtime, library, &keys, options.check, &progress)?,
    };
    let look_secs = looking.elapsed().as_secs_f64();

    let mut by_input: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    let mut triangles = 0;
    for (&Task::Mesh(mesh), key) in tasks.iter().zip(&keys) {
        if !known.contains_key(key) {
            let planned = &plan.meshes[mesh as usize];
            by_input.entry(planned.input).or_default().push(mesh);
            triangles += planned.triangles;
        }
    }
    let neighbours = read_neighbours(runtime, library, &options.scene, plan)?;
    let (mut import_secs, mut build_secs) = (0.0, 0.0);
    let mut built = HashMap::new();
    progress.begin_triangles(triangles);
    for (input, wanted) in by_input {
        let importing = Instant::now();
        let file = match options.inputs.get(input as usize) {
            Some(file) => file.clone(),
            None => PathBuf::from(&plan.inputs[input as usize].path),
        };
        let limit = options.memory_limit_bytes;
        let wanted: Vec<Wanted> = wanted
            .into_iter()
            .map(|mesh| Wanted {
                mesh: &plan.meshes[mesh as usize],
                key: note.builds[mesh as usize],
                neighbours: Arc::clone(&neighbours[mesh as usize]),
            })
            .collect();
        let meshes = read_meshes(&file, plan, input, &wanted, options);
        let meshes = match options.inputs.is_empty() {
            true => meshes.map_err(elsewhere)?,
            false => meshes?,
        };
        import_secs += importing.elapsed().as_secs_f64();
        let building = Instant::now();
        let room = memory::check_build(&meshes, &[], limit)?;
        let builder = Builder {
            runtime,
            library,
            options: &build_options,
            scratch: options.scratch.as_deref(),
            room,
            broken: &broken,
            on_triangles: &|count| progress.triangles(count),
        };
        built.extend(builder.build_all(meshes)?);
        build_secs += building.elapsed().as_secs_f64();
    }
    progress.end();
    let clock = Clock {
        total: start.elapsed().as_secs_f64(),
        import: import_secs,
        meshes: build_secs,
        rest: look_secs,
    };
    let mut repaired = Repaired::default();
    for asset in built.values() {
        repaired.merge(asset.repaired);
    }
    Ok(JobReport {
        scene: options.scene.clone(),
        job: options.job,
        jobs: plan.jobs.len() as u32,
        meshes: tasks.len() as u64,
        built: built.len() as u64,
        reused: known.len() as u64,
        repaired,
        triangles,
        seconds: clock.seconds(built.values().map(|asset| &**asset)),
        peak_rss_bytes: report::peak_rss_bytes(),
    })
}

/// A mesh of the plan that is built now.
struct Wanted<'a> {
    mesh: &'a PlanMesh,
    key: ContentHash,
    neighbours: Arc<Neighbours>,
}

/// The neighbours of every mesh of the plan.
fn read_neighbours(
    runtime: &Handle,
    library: &Library,
    scene: &str,
    plan: &Plan,
) -> Result<Vec<Arc<Neighbours>>, IngestError> {
    let object = runtime.block_on(library.object(&plan.neighbours))?;
    let neighbours = stored::decode(&object).unwrap_or_default();
    let hashes = neighbours.iter().map(Neighbours::hash);
    if !hashes.eq(plan.meshes.iter().map(|mesh| mesh.neighbours)) {
        let expected = format!("the neighbours of {} meshes", plan.meshes.len());
        let found = format!("object {} with others", plan.neighbours);
        return Err(fault(library, scene, expected, found));
    }
    Ok(neighbours.into_iter().map(Arc::new).collect())
}

/// The `wanted` meshes of an input; all else that the file holds is let go.
fn read_meshes(
    file: &Path,
    plan: &Plan,
    input: u32,
    wanted: &[Wanted],
    options: &JobOptions,
) -> Result<Vec<KeyedMesh>, IngestError> {
    let planned = &plan.inputs[input as usize];
    let changed = |planned, found| IngestError::Changed {
        file: file.to_owned(),
        planned,
        found,
    };
    let (bytes, hash) = hash_input(file)?;
    if hash != planned.hash {
        let expected = format!("{} bytes, {}", planned.bytes, planned.hash);
        return Err(changed(expected, format!("{bytes} bytes, {hash}")));
    }
    memory::check_inputs(&[file.to_owned()], options.memory_limit_bytes)?;
    let mut merged = Merged::default();
    let open = OpenOptions {
        max_mesh_bytes: plan.max_mesh_bytes,
        self_contained: options.self_contained,
        memory_limit_bytes: memory::limit_of(plan.max_mesh_bytes),
        ..OpenOptions::default()
    };
    merged.add(file, input, import::open(file, &open)?);
    let mut found: HashMap<ContentHash, MergedMesh> = HashMap::new();
    for NamedMesh { content, mesh } in assets::named(merged.meshes)? {
        // Of equal meshes the first is built.
        found.entry(content).or_insert(mesh);
    }
    let take = |wanted: &Wanted| {
        let content = wanted.mesh.content;
        // The file is the same, so one that it names is another.
        let mesh = found.remove(&content).ok_or_else(|| {
            let expected = format!("mesh {:?} of content {content}", wanted.mesh.name);
            changed(expected, "other meshes".to_owned())
        })?;
        Ok(KeyedMesh {
            content,
            key: wanted.key,
            neighbours: Arc::clone(&wanted.neighbours),
            // The outline says it.
            freedom: Freedom::None,
            mesh,
        })
    };
    wanted.iter().map(take).collect()
}

/// An input that is not where the plan says may lie elsewhere on this machine.
fn elsewhere(error: IngestError) -> IngestError {
    match error {
        IngestError::Input { file, cause } => {
            let text = format!(
                "{cause} (so the plan says; name all INPUTs where they lie elsewhere here)"
            );
            let cause = std::io::Error::new(cause.kind(), text);
            IngestError::Input { file, cause }
        }
        error => error,
    }
}

/// Publishes a planned scene whose jobs are done: the scene that a plain ingest gives. The inputs are not needed.
///
/// # Errors
/// No such plan, or jobs that are not done, which it names.
pub fn finish(
    runtime: &Handle,
    library: &Library,
    scene: &str,
    check: Check,
    to: ProgressTo,
) -> Result<IngestReport, IngestError> {
    let start = Instant::now();
    let progress = Progress::new(to);
    progress.step("looking for what the jobs built");
    let (note, _) = read_plan(runtime, library, scene)?;
    let known = find_all(runtime, library, &note.builds, check, &progress)?.known;
    if known.len() < note.builds.len() {
        let (jobs, meshes) = unfinished(&note, |key| known.contains_key(key));
        let expected = format!("all {} jobs done", note.plan.jobs.len());
        let found = format!("{meshes} meshes not built yet, of jobs {}", ranges(&jobs));
        return Err(fault(library, scene, expected, found));
    }
    let outline = runtime.block_on(library.scene(&note.plan.outline))?;
    let stored: Option<Vec<_>> = outline
        .assets
        .iter()
        .map(|entry| known.get(&entry.asset).map(Arc::clone))
        .collect();
    let Some(stored) = stored else {
        let expected = "the outline's meshes among the planned ones".to_owned();
        return Err(fault(library, scene, expected, "another".to_owned()));
    };
    if check == Check::Hash {
        // Stored by --plan; no job checks them.
        for texture in &outline.textures {
            runtime.block_on(library.check_object(&texture.object))?;
        }
    }
    let mut scene_object = outline::fill(outline, &stored);
    arrange::arrange(runtime, library, &mut scene_object)?;
    let repaired = super::publish(runtime, library, scene, Replaces::Anything, &scene_object)?;
    progress.end();
    let total = start.elapsed().as_secs_f64();
    let clock = Clock {
        total,
        import: 0.0,
        meshes: 0.0,
        rest: total,
    };
    Ok(report::report(&scene_object, &stored, repaired, clock))
}

/// The plan of a scene, checked, and young again; with the options that it says.
fn read_plan(
    runtime: &Handle,
    library: &Library,
    scene: &str,
) -> Result<(PlanNote<Plan>, BuildOptions), IngestError> {
    let note = runtime.block_on(library.plan::<Plan>(scene))?;
    let checked = note.plan.check(&note.builds);
    let options = checked.map_err(|(expected, found)| fault(library, scene, expected, found))?;
    runtime.block_on(library.renew_plan(scene, &note, RENEW_AFTER_SECS))?;
    Ok((note, options))
}

fn fault(library: &Library, scene: &str, expected: String, found: String) -> IngestError {
    IngestError::Plan {
        location: library.location().to_owned(),
        scene: scene.to_owned(),
        expected,
        found,
    }
}

/// Jobs with meshes that are not `done`, ascending, and how many meshes.
fn unfinished(note: &PlanNote<Plan>, done: impl Fn(&ContentHash) -> bool) -> (Vec<u32>, usize) {
    let mut meshes = HashSet::new();
    let mut jobs = vec![];
    for (job, tasks) in note.plan.jobs.iter().enumerate() {
        let before = meshes.len();
        let all = tasks.iter().map(|&Task::Mesh(mesh)| mesh);
        meshes.extend(all.filter(|&mesh| !done(&note.builds[mesh as usize])));
        if meshes.len() > before {
            jobs.push(job as u32);
        }
    }
    (jobs, meshes.len())
}

/// `0,3-5`, as array schedulers read it.
fn ranges(sorted: &[u32]) -> String {
    let runs = sorted.chunk_by(|a, b| a + 1 == *b);
    let text = runs.map(|run| match run {
        [one] => one.to_string(),
        [first, .., last] => format!("{first}-{last}"),
        [] => String::new(),
    });
    text.collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jobs_are_named_as_ranges() {
        assert_eq!(ranges(&[0, 3, 4, 5, 7]), "0,3-5,7");
        assert_eq!(ranges(&[2]), "2");
        assert_eq!(ranges(&[]), "");
    }
}
