//! Ingest: the meshes of some files become one published scene.
//!
//! ```text
//! import every input -> one scene (`merge`) -> what meshes keep for each other (`neighbours`) ->
//! name every mesh (`records`) -> build and store those that no record knows (`assets`) -> textures
//! -> scene (`outline`) -> its instances in order (`arrange`) -> publish
//! ```
//!
//! The same in parts, on many machines: `plan` imports and deals out the meshes, `job` builds some of them, `finish` publishes.
//! Nothing names the new objects until the last step, so a run that fails leaves the library's scenes as they were; what it
//! built is found again by the next.

mod arrange;
mod assets;
mod build_report;
mod deal;
mod error;
mod job;
mod memory;
mod merge;
mod neighbours;
mod outline;
mod plan;
mod progress;
mod records;
mod report;

use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;
use lodestream_format::scene::Texture;
use lodestream_format::{ContentHash, Scene};
use tokio::runtime::Handle;

use crate::build::BuildOptions;
use crate::import::{self, MAX_IMAGE_PIXELS, OpenOptions};
use crate::library::{Check, Library, LibraryError, Put, Repaired, Replaces};
use assets::{Builder, KeyedMesh};
use merge::Merged;
use progress::Progress;
use records::{Known, StoredAsset};

pub use error::IngestError;
pub use job::{JobOptions, JobReport, finish, job};
pub use plan::{PlanReport, PlannedJob, plan};
pub use progress::ProgressTo;
pub use records::BUILDER_VERSION;
pub use report::{IngestBytes, IngestReport, IngestSeconds};

/// Objects that are there already and older than this are renewed, far below any sensible grace period of `gc`.
const RENEW_AFTER_SECS: i64 = 60;
/// For objects that a published scene keeps: nothing needs to be sent again.
const NEVER_RENEW: i64 = i64::MAX;

/// What a caller chooses.
#[derive(Debug, Clone, Default)]
pub struct IngestOptions {
    /// `.glb` and `.gltf` files; together they make one scene.
    pub inputs: Vec<PathBuf>,
    /// Name to publish under.
    pub scene: String,
    /// What the name must point at, when the work begins and when it is published.
    pub replaces: Replaces,
    /// Threads of the build; all cores where it is `None`.
    pub threads: Option<usize>,
    /// Stay below: read large meshes piece by piece and build them through the disk, refuse what still would not fit.
    pub memory_limit_bytes: Option<u64>,
    /// Folder for what does not fit memory; the system's own for temporary files where it is `None`.
    pub scratch: Option<PathBuf>,
    /// Options of every mesh.
    pub build: BuildOptions,
    /// Build also what the library holds already.
    pub rebuild: bool,
    /// How stored objects are checked before they are reused.
    pub check: Check,
    /// Most triangles of all meshes, each counted once.
    pub max_triangles: Option<u64>,
    /// Publish a scene also where the inputs hold no triangle.
    pub allow_empty: bool,
    /// Open no file but the inputs: see [`OpenOptions::self_contained`].
    pub self_contained: bool,
    /// Most pixels of an image: [`MAX_IMAGE_PIXELS`] where it is `None`; see
    /// [`OpenOptions::max_image_pixels`].
    pub max_image_pixels: Option<u64>,
    /// Where progress goes.
    pub progress: ProgressTo,
}

/// Imports, builds, stores and publishes; gives what was done.
pub fn ingest(
    runtime: &Handle,
    library: &Library,
    options: &IngestOptions,
) -> Result<IngestReport, IngestError> {
    on_threads(options.threads, || run(runtime, library, options))
}

/// Runs `work` on a pool of its own.
fn on_threads<T: Send>(
    threads: Option<usize>,
    work: impl FnOnce() -> Result<T, IngestError> + Send,
) -> Result<T, IngestError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .build()?;
    pool.install(work)
}

fn run(
    runtime: &Handle,
    library: &Library,
    options: &IngestOptions,
) -> Result<IngestReport, IngestError> {
    let start = Instant::now();
    runtime.block_on(library.check_replaced(&options.scene, options.replaces))?;
    let progress = Progress::new(options.progress);
    let (mut merged, meshes) = import_all(options, &progress)?;
    let entries = outline::entries(&meshes);
    let import_secs = start.elapsed().as_secs_f64();

    let looking = Instant::now();
    let keys: Vec<ContentHash> = entries.iter().map(|entry| entry.asset).collect();
    let FoundBuilds { mut known, broken } = match options.rebuild {
        true => FoundBuilds::default(),
        false => {
            progress.step("looking for what is built already");
            find_all(runtime, library, &keys, options.check, &progress)?
        }
    };
    let meshes = missing(meshes, &known);
    let look_secs = looking.elapsed().as_secs_f64();

    let building = Instant::now();
    let limit = options.memory_limit_bytes;
    let room = memory::check_build(&meshes, &merged.images, limit)?;
    progress.begin_triangles(meshes.iter().map(|keyed| keyed.mesh.triangles).sum());
    let builder = Builder {
        runtime,
        library,
        options: &options.build,
        scratch: options.scratch.as_deref(),
        room,
        broken: &broken,
        on_triangles: &|count| progress.triangles(count),
    };
    known.extend(builder.build_all(meshes)?);
    progress.end();
    let build_secs = building.elapsed().as_secs_f64();

    let storing = Instant::now();
    let mut repaired = Repaired::default();
    let textures = store_textures(runtime, library, &options.scene, &mut merged, &mut repaired)?;
    let outline = outline::outline(merged, entries, textures);
    // Each key was found or built.
    let stored: Vec<_> = keys.iter().map(|key| Arc::clone(&known[key])).collect();
    let mut scene = outline::fill(outline, &stored);
    arrange::arrange(runtime, library, &mut scene)?;
    let published = publish(runtime, library, &options.scene, options.replaces, &scene)?;
    repaired.merge(published);
    let clock = report::Clock {
        total: start.elapsed().as_secs_f64(),
        import: import_secs,
        meshes: build_secs,
        rest: look_secs + storing.elapsed().as_secs_f64(),
    };
    Ok(report::report(&scene, &stored, repaired, clock))
}

/// All inputs in one; the meshes on their own, with their names.
fn import_all(
    options: &IngestOptions,
    progress: &Progress,
) -> Result<(Merged, Vec<KeyedMesh>), IngestError> {
    memory::check_inputs(&options.inputs, options.memory_limit_bytes)?;
    let mut merged = Merged::default();
    for (index, input) in options.inputs.iter().enumerate() {
        progress.step(&format!("importing {}", input.display()));
        let max_mesh_bytes = memory::most_mesh_bytes(options.memory_limit_bytes);
        let open = OpenOptions {
            max_mesh_bytes,
            self_contained: options.self_contained,
            max_image_pixels: options.max_image_pixels.unwrap_or(MAX_IMAGE_PIXELS),
            memory_limit_bytes: memory::limit_of(max_mesh_bytes),
        };
        merged.add(input, index as u32, import::open(input, &open)?);
        check_triangles(&merged, options.max_triangles)?;
    }
    if merged.instances.is_empty() && !options.allow_empty {
        let file = options.inputs.first().cloned().unwrap_or_default();
        let others = options.inputs.len().saturating_sub(1);
        return Err(IngestError::Empty { file, others });
    }
    let meshes = std::mem::take(&mut merged.meshes);
    let named = assets::named(meshes)?;
    let neighbours = assets::neighbours(&named, &merged.instances, options)?;
    merged.warnings.extend(neighbours.warnings);
    let keyed = assets::keyed(named, neighbours.of_mesh, &options.build);
    // What only reading a mesh shows.
    for keyed in &keyed {
        merged.warn_of(&keyed.mesh);
    }
    Ok((merged, keyed))
}

/// Before anything else is done with them.
fn check_triangles(merged: &Merged, most: Option<u64>) -> Result<(), IngestError> {
    let triangles: u64 = merged.meshes.iter().map(|mesh| mesh.triangles).sum();
    match most {
        Some(most) if triangles > most => Err(IngestError::TooManyTriangles { most, triangles }),
        _ => Ok(()),
    }
}

/// Builds of earlier runs.
#[derive(Default)]
struct FoundBuilds {
    /// Whole builds, by key.
    known: HashMap<ContentHash, Arc<StoredAsset>>,
    /// Objects of the broken builds.
    broken: HashSet<ContentHash>,
}

/// The builds of `keys` that the library has.
fn find_all(
    runtime: &Handle,
    library: &Library,
    keys: &[ContentHash],
    check: Check,
    progress: &Progress,
) -> Result<FoundBuilds, LibraryError> {
    let mut told = HashSet::new();
    let mut unique = keys.to_vec();
    unique.retain(|key| told.insert(*key));
    let warn = |line: String| progress.warn(&line);
    let looked = records::find(runtime, library, &unique, check, &warn)?;
    let mut found = FoundBuilds::default();
    for (key, looked) in unique.into_iter().zip(looked) {
        match looked {
            Known::No => {}
            Known::Whole(stored) => drop(found.known.insert(key, stored)),
            Known::Broken(objects) => found.broken.extend(objects),
        }
    }
    Ok(found)
}

/// The meshes to build, each once; the others' memory is given back.
fn missing(
    meshes: Vec<KeyedMesh>,
    known: &HashMap<ContentHash, Arc<StoredAsset>>,
) -> Vec<KeyedMesh> {
    let mut meshes = assets::unique(meshes);
    meshes.retain(|keyed| !known.contains_key(&keyed.key));
    meshes
}

fn store_textures(
    runtime: &Handle,
    library: &Library,
    scene: &str,
    merged: &mut Merged,
    repaired: &mut Repaired,
) -> Result<Vec<Texture>, IngestError> {
    let images = std::mem::take(&mut merged.images);
    let kept = match images.is_empty() {
        true => HashSet::new(),
        false => runtime.block_on(published_textures(library, scene)),
    };
    let store = |image: merge::MergedImage| {
        let bytes = image.bytes.len() as u64;
        let renew = match kept.contains(&ContentHash::of(&image.bytes)) {
            true => NEVER_RENEW,
            false => RENEW_AFTER_SECS,
        };
        let put = library.put_object(Bytes::from(image.bytes), renew);
        let (object, put) = runtime.block_on(put)?;
        // The published scene needs it, and it was missing.
        if put == Put::Healed || (put == Put::Stored && renew == NEVER_RENEW) {
            repaired.add(bytes);
        }
        Ok(Texture {
            object,
            bytes,
            media_type: image.media_type,
            width: image.width,
            height: image.height,
        })
    };
    images.into_iter().map(store).collect()
}

/// What the scene of this name holds now: it keeps them from `gc`. None where there is no such scene that can be read.
async fn published_textures(library: &Library, scene: &str) -> HashSet<ContentHash> {
    let Ok(reference) = library.reference(scene).await else {
        return HashSet::new();
    };
    let scene = library.scene(&reference.scene).await.unwrap_or_default();
    scene
        .textures
        .iter()
        .map(|texture| texture.object)
        .collect()
}

fn publish(
    runtime: &Handle,
    library: &Library,
    name: &str,
    replaces: Replaces,
    scene: &Scene,
) -> Result<Repaired, IngestError> {
    let bytes = Bytes::from(scene.encode()?);
    let length = bytes.len() as u64;
    let (published, put, was_named) = runtime.block_on(async {
        let (hash, put) = library.put_object(bytes, RENEW_AFTER_SECS).await?;
        let before = library.reference(name).await;
        let was_named = before.is_ok_and(|before| before.scene == hash);
        let published = library.publish_replacing(name, hash, replaces).await?;
        Ok::<_, LibraryError>((published, put, was_named))
    })?;
    tracing::info!("scene {name} is now {}", published.scene);
    let mut repaired = Repaired::default();
    if put == Put::Healed || (put == Put::Stored && was_named) {
        repaired.add(length);
    }
    Ok(repaired)
}
