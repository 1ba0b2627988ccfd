//! Ingest: glTF files become one published scene.
//!
//! ```text
//! import every input -> one scene (`merge`) -> build every mesh, store its asset (`assets`) -> textures -> scene -> publish
//! ```
//!
//! Nothing names the new objects until the last step, so a run that fails leaves the library's scenes as they were.

mod assets;
mod memory;
mod merge;
mod progress;
mod report;

use std::path::PathBuf;
use std::time::Instant;

use bytes::Bytes;
use lodestream_format::scene::{SceneAsset, Texture};
use lodestream_format::{ContentHash, FormatError, Scene};
use tokio::runtime::Handle;

use crate::build::{BuildError, BuildOptions};
use crate::import::{self, ImportError};
use crate::library::{Library, LibraryError};
use assets::StoredMesh;
use merge::Merged;
use progress::Progress;

pub use report::{IngestBytes, IngestReport, IngestSeconds};

/// Objects that are there already and older than this are renewed, far below any sensible grace period of `gc`.
const RENEW_AFTER_SECS: i64 = 60;

/// What a caller chooses.
#[derive(Debug, Clone, Default)]
pub struct IngestOptions {
    /// `.glb` and `.gltf` files; together they make one scene.
    pub inputs: Vec<PathBuf>,
    /// Name to publish under.
    pub scene: String,
    /// Threads of the build; all cores where it is `None`.
    pub threads: Option<usize>,
    /// Refuse what would need more memory.
    pub memory_limit_bytes: Option<u64>,
    /// Options of every mesh.
    pub build: BuildOptions,
    /// Show progress where standard error is a terminal.
    pub progress: bool,
}

/// Why nothing was published.
#[derive(Debug, thiserror::Error)]
pub enum IngestError {
    /// An input cannot be read.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// An input is not there.
    #[error("{}: cannot read: {cause}", file.display())]
    Input {
        /// The file.
        file: PathBuf,
        /// The operating system's reason.
        cause: std::io::Error,
    },
    /// A mesh cannot be built.
    #[error("{}: {error}", file.display())]
    Build {
        /// The file that holds the mesh.
        file: PathBuf,
        /// Why.
        error: BuildError,
    },
    /// The option and the inputs do not fit.
    #[error(
        "{what}: expected at most {limit_bytes} bytes of memory (--memory-limit), found a need of about {need_bytes}"
    )]
    Memory {
        /// What needs it.
        what: String,
        /// The option.
        limit_bytes: u64,
        /// The estimate.
        need_bytes: u64,
    },
    /// The threads cannot be started.
    #[error("threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The scene breaks the format's limits.
    #[error("scene: {0}")]
    Format(#[from] FormatError),
    /// The library failed.
    #[error(transparent)]
    Library(#[from] LibraryError),
}

/// Imports, builds, stores and publishes; gives what was done.
pub fn ingest(
    runtime: &Handle,
    library: &Library,
    options: &IngestOptions,
) -> Result<IngestReport, IngestError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads.unwrap_or(0))
        .build()?;
    pool.install(|| run(runtime, library, options))
}

fn run(
    runtime: &Handle,
    library: &Library,
    options: &IngestOptions,
) -> Result<IngestReport, IngestError> {
    let start = Instant::now();
    let progress = Progress::new(options.progress);
    memory::check_inputs(&options.inputs, options.memory_limit_bytes)?;
    let mut merged = import_all(&options.inputs, &progress)?;
    let import_secs = start.elapsed().as_secs_f64();

    let large = memory::check_build(&merged, options.memory_limit_bytes)?;
    let building = Instant::now();
    let meshes = std::mem::take(&mut merged.meshes);
    let stored = assets::build_and_store(runtime, library, options, meshes, large, &progress)?;
    let build_secs = building.elapsed().as_secs_f64();

    let storing = Instant::now();
    let textures = store_textures(runtime, library, &mut merged)?;
    let scene = scene_of(
        &merged,
        &stored,
        textures,
        report::warnings(&merged, &stored),
    );
    let bytes = Bytes::from(scene.encode()?);
    let published = runtime.block_on(async {
        let (hash, _) = library.put_object(bytes, RENEW_AFTER_SECS).await?;
        library.publish(&options.scene, hash).await
    })?;
    tracing::info!("scene {} is now {}", options.scene, published.scene);
    let seconds = report::Clock {
        total: start.elapsed().as_secs_f64(),
        import: import_secs,
        meshes: build_secs,
        rest: storing.elapsed().as_secs_f64(),
    };
    Ok(report::report(&scene, &stored, seconds))
}

fn import_all(inputs: &[PathBuf], progress: &Progress) -> Result<Merged, IngestError> {
    let mut merged = Merged::default();
    for input in inputs {
        progress.step(&format!("importing {}", input.display()));
        merged.add(input, import::import(input)?);
    }
    Ok(merged)
}

fn store_textures(
    runtime: &Handle,
    library: &Library,
    merged: &mut Merged,
) -> Result<Vec<Texture>, IngestError> {
    let images = std::mem::take(&mut merged.images);
    let store = |image: merge::MergedImage| {
        let bytes = image.bytes.len() as u64;
        let put = library.put_object(Bytes::from(image.bytes), RENEW_AFTER_SECS);
        let (object, _) = runtime.block_on(put)?;
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

/// Meshes that became the same asset with the same materials are one entry of the scene.
fn scene_of(
    merged: &Merged,
    stored: &[StoredMesh],
    textures: Vec<Texture>,
    warnings: Vec<String>,
) -> Scene {
    let mut assets: Vec<SceneAsset> = vec![];
    let mut known = std::collections::HashMap::<(ContentHash, &[u32]), u32>::new();
    let asset_of_mesh: Vec<u32> = stored
        .iter()
        .map(|mesh| {
            *known
                .entry((mesh.asset, &mesh.materials))
                .or_insert_with(|| {
                    assets.push(SceneAsset {
                        name: mesh.name.clone(),
                        asset: mesh.asset,
                        materials: mesh.materials.clone(),
                    });
                    assets.len() as u32 - 1
                })
        })
        .collect();
    let instances = merged.instances.iter().map(|(mesh, world_from_object)| {
        lodestream_format::scene::Instance {
            asset: asset_of_mesh[*mesh],
            world_from_object: *world_from_object,
        }
    });
    Scene {
        instances: instances.collect(),
        assets,
        materials: merged.materials.clone(),
        textures,
        source_triangles: merged.source_triangles,
        warnings,
    }
}
