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

use super::memory::Room;
use super::merge::MergedMesh;
use super::records::{self, StoredAsset};
use super::{IngestError, RENEW_AFTER_SECS};
use crate::build::{self, BuildOptions, BuildSite, BuiltAsset, Pack};
use crate::import::MeshSource;
use crate::library::{Library, Put, Repaired};

/// A mesh with its names.
#[derive(Debug)]
pub(super) struct KeyedMesh {
    /// Of what the build reads of it.
    pub content: ContentHash,
    /// Of its build.
    pub key: ContentHash,
    pub mesh: MergedMesh,
}

/// Names every mesh.
pub(super) fn keyed(
    meshes: Vec<MergedMesh>,
    options: &BuildOptions,
) -> Result<Vec<KeyedMesh>, IngestError> {
    let named = meshes.into_par_iter().map(|mesh| {
        let content = records::content(&mesh.mesh)?;
        let key = records::key(&content, options);
        Ok(KeyedMesh { content, key, mesh })
    });
    // The first error in order is the one told, whatever the thread count.
    let named: Vec<Result<KeyedMesh, IngestError>> = named.collect();
    named.into_iter().collect()
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
        let KeyedMesh { key, mesh, .. } = keyed;
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
        let built =
            build::build_at(mesh, self.options, site).map_err(|error| IngestError::Build {
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
