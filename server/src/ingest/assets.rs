//! Meshes built and stored, each with the record that lets a later run find it.
//!
//! Large meshes go one after another, each on all threads; then the small ones side by side. A thread that waits inside
//! one build steals another, so side by side they must be small for the peak of memory to stay near one build.

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use bytes::Bytes;
use lodestream_format::ContentHash;
use rayon::prelude::*;
use tokio::runtime::Handle;

use super::arrange::Freedom;
use super::memory::Room;
use super::merge::MergedMesh;
use super::neighbours::{self, Placed};
use super::records::{self, StoredAsset};
use super::{IngestError, IngestOptions, RENEW_AFTER_SECS};
use crate::build::{self, BuildOptions, BuildSite, BuiltAsset, Neighbours, Pack, PositionStep};
use crate::import::MeshSource;
use crate::library::{Library, Put, Repaired};

/// A mesh with its names.
#[derive(Debug)]
pub(super) struct KeyedMesh {
    /// Of what the build reads of it.
    pub content: ContentHash,
    /// Of its build.
    pub key: ContentHash,
    /// Meshes of one content have the same.
    pub neighbours: Arc<Neighbours>,
    pub freedom: Freedom,
    pub mesh: MergedMesh,
}

/// A mesh with the name of what the build reads of it.
#[derive(Debug)]
pub(super) struct NamedMesh {
    pub content: ContentHash,
    pub mesh: MergedMesh,
}

/// Names what the build reads of every mesh.
pub(super) fn named(meshes: Vec<MergedMesh>) -> Result<Vec<NamedMesh>, IngestError> {
    let named = meshes.into_par_iter().map(|mesh| {
        let content = records::content(&mesh.mesh)?;
        Ok(NamedMesh { content, mesh })
    });
    // The first error in order is the one told, whatever the thread count.
    let named: Vec<Result<NamedMesh, IngestError>> = named.collect();
    named.into_iter().collect()
}

/// The neighbours of every mesh of a scene.
pub(super) struct SceneNeighbours {
    pub of_mesh: Vec<(Arc<Neighbours>, Freedom)>,
    pub warnings: Vec<String>,
}

/// Finds what the meshes keep for each other. Equal meshes are one, in all their places.
pub(super) fn neighbours(
    named: &[NamedMesh],
    instances: &[(usize, [[f64; 4]; 3])],
    options: &IngestOptions,
) -> Result<SceneNeighbours, IngestError> {
    let mut number_of: HashMap<ContentHash, usize> = HashMap::new();
    let mut first: Vec<&MergedMesh> = vec![];
    let numbers: Vec<usize> = named
        .iter()
        .map(|named| {
            *number_of.entry(named.content).or_insert_with(|| {
                first.push(&named.mesh);
                first.len() - 1
            })
        })
        .collect();
    let placed = instances.iter();
    let placed = placed.map(|(mesh, rows)| Placed::new(numbers[*mesh], rows));
    let search = neighbours::Options {
        steps_are_free: options.build.position_step == PositionStep::Auto,
        memory_limit_bytes: options.memory_limit_bytes,
    };
    let found = neighbours::find(&first, placed, &search)?;
    let of_number: Vec<Arc<Neighbours>> = found.neighbours.into_iter().map(Arc::new).collect();
    Ok(SceneNeighbours {
        of_mesh: numbers
            .iter()
            .map(|&number| (Arc::clone(&of_number[number]), found.freedoms[number]))
            .collect(),
        warnings: found.warnings,
    })
}

/// Names the build of every mesh, beside its neighbours.
pub(super) fn keyed(
    named: Vec<NamedMesh>,
    neighbours: Vec<(Arc<Neighbours>, Freedom)>,
    options: &BuildOptions,
) -> Vec<KeyedMesh> {
    let keyed = named.into_iter().zip(neighbours);
    let keyed = keyed.map(
        |(NamedMesh { content, mesh }, (neighbours, freedom))| KeyedMesh {
            content,
            key: records::key(&content, options, &neighbours.hash()),
            neighbours,
            freedom,
            mesh,
        },
    );
    keyed.collect()
}

/// The first mesh of each key, in order.
pub(super) fn unique(meshes: Vec<KeyedMesh>) -> Vec<KeyedMesh> {
    let mut known = HashSet::new();
    let mut meshes = meshes;
    meshes.retain(|mesh| known.insert(mesh.key));
    meshes
}

/// How meshes are built.
pub(super) struct Builder<'a> {
    pub runtime: &'a Handle,
    pub library: &'a Library,
    pub options: &'a BuildOptions,
    /// Folder for what does not fit memory; the system's own where it is `None`.
    pub scratch: Option<&'a Path>,
    pub room: Room,
    /// Objects of broken builds; stored anew they count as repaired.
    pub broken: &'a HashSet<ContentHash>,
    /// Called from any thread with the triangles done since the last call; all calls for a mesh add up to its triangles.
    pub on_triangles: &'a (dyn Fn(u64) + Sync),
}

impl Builder<'_> {
    /// Builds and stores `meshes`, large ones on their own; gives what each key became.
    ///
    /// # Errors
    /// The first in order. What was built before is stored and recorded, so that the next run goes on from there.
    pub(super) fn build_all(
        &self,
        meshes: Vec<KeyedMesh>,
    ) -> Result<HashMap<ContentHash, Arc<StoredAsset>>, IngestError> {
        let (alone, beside): (Vec<_>, Vec<_>) = meshes
            .into_iter()
            .partition(|mesh| mesh.mesh.triangles > self.room.alone_above);
        // Each mesh goes as soon as it is built.
        let one = |mesh: KeyedMesh| Ok((mesh.key, Arc::new(self.build_one(mesh)?)));
        let mut built: HashMap<_, _> = alone
            .into_iter()
            .map(one)
            .collect::<Result<_, IngestError>>()?;
        // All are waited for, then the first error in order is the one told, whatever the thread count.
        let small: Vec<Result<_, IngestError>> = beside.into_par_iter().map(one).collect();
        for result in small {
            let (key, stored) = result?;
            built.insert(key, stored);
        }
        Ok(built)
    }

    fn build_one(&self, keyed: KeyedMesh) -> Result<StoredAsset, IngestError> {
        let KeyedMesh {
            key,
            mesh,
            neighbours,
            ..
        } = keyed;
        let MergedMesh {
            file,
            triangles,
            mesh,
            ..
        } = mesh;
        let name = mesh.name().to_owned();
        let temporary = std::env::temp_dir();
        let through_disk = triangles > self.room.disk_above;
        let done = AtomicU64::new(0);
        // Groups of all levels come to twice the triangles, about.
        let on_group = |count: u64| {
            let before = done.fetch_add(count, Ordering::Relaxed);
            let half = |sum: u64| (sum / 2).min(triangles);
            (self.on_triangles)(half(before + count) - half(before));
        };
        let site = BuildSite {
            scratch: through_disk.then_some(self.scratch.unwrap_or(&temporary)),
            on_triangles: &on_group,
        };
        let built = build::build_at(mesh, self.options, &neighbours, site);
        let built = built.map_err(|error| IngestError::Build {
            file: file.to_path_buf(),
            error,
        })?;
        (self.on_triangles)(triangles - (done.load(Ordering::Relaxed) / 2).min(triangles));
        let BuiltAsset {
            asset,
            asset_bytes,
            hierarchy_bytes,
            pack,
            mut report,
        } = built;
        // Equal meshes share the report under their own names.
        let prefix = format!("mesh {name:?}: ");
        for warning in &mut report.warnings {
            if let Some(rest) = warning.strip_prefix(&prefix) {
                *warning = rest.to_owned();
            }
        }
        let storing = Instant::now();
        let mut repaired = Repaired::default();
        let mut note = |(hash, put): (ContentHash, Put), bytes: u64| {
            if put == Put::Healed || (put == Put::Stored && self.broken.contains(&hash)) {
                repaired.add(bytes);
            }
            hash
        };
        let hash = self.runtime.block_on(async {
            // What an object names is there before it.
            let library = self.library;
            let put = match pack {
                Pack::Memory(frames) => {
                    let frames = Bytes::from(frames.concat());
                    library.put_object(frames, RENEW_AFTER_SECS).await?
                }
                Pack::File(pack) => {
                    let put = library.put_object_file(&pack.file, &pack.folder, RENEW_AFTER_SECS);
                    put.await?
                }
            };
            note(put, asset.pack_bytes());
            let (hierarchy, bytes) = (Bytes::from(hierarchy_bytes), report.bytes.hierarchy);
            let put = library.put_object(hierarchy, RENEW_AFTER_SECS).await?;
            note(put, bytes);
            let bytes = asset_bytes.len() as u64;
            let put = library.put_object(Bytes::from(asset_bytes), RENEW_AFTER_SECS);
            let hash = note(put.await?, bytes);
            records::remember(self.library, &key, &asset, hash, &report).await?;
            Ok::<_, IngestError>(hash)
        })?;
        Ok(StoredAsset {
            asset: hash,
            report,
            store_secs: storing.elapsed().as_secs_f64(),
            reused: false,
            repaired,
        })
    }
}
