//! Every mesh built and stored; equal meshes once.
//!
//! Large meshes go one after another, each on all threads; then the small ones side by side. A thread that waits inside
//! one build steals another, so side by side they must be small for the peak of memory to stay near one build.

use std::collections::HashMap;
use std::time::Instant;

use bytes::Bytes;
use lodestream_format::ContentHash;
use lodestream_format::hash::ContentHasher;
use rayon::prelude::*;
use tokio::runtime::Handle;

use super::merge::MergedMesh;
use super::progress::Progress;
use super::{IngestError, IngestOptions, RENEW_AFTER_SECS};
use crate::build::{self, BuildReport, BuiltAsset};
use crate::import::Mesh;
use crate::library::Library;

/// A mesh of the scene and the asset that it became.
#[derive(Debug, Clone)]
pub(super) struct StoredMesh {
    pub name: String,
    pub materials: Vec<u32>,
    pub asset: ContentHash,
    /// Of the build; shared by meshes that are equal.
    pub report: BuildReport,
    /// Seconds spent storing the asset.
    pub store_secs: f64,
}

/// Builds `meshes`, those of more than `large` triangles on their own; the result is in their order.
pub(super) fn build_and_store(
    runtime: &Handle,
    library: &Library,
    options: &IngestOptions,
    meshes: Vec<MergedMesh>,
    large: usize,
    progress: &Progress,
) -> Result<Vec<StoredMesh>, IngestError> {
    let triangles = meshes.iter().map(|mesh| mesh.mesh.triangles.len() as u64);
    progress.begin_triangles(triangles.sum());
    let mut first_of = HashMap::new();
    let mut uses = Vec::with_capacity(meshes.len());
    let (mut alone, mut beside) = (vec![], vec![]);
    for MergedMesh { file, mesh } in meshes {
        let next = first_of.len();
        let unique = *first_of.entry(content(&mesh)).or_insert(next);
        uses.push((unique, mesh.name.clone(), mesh.material_slots.clone()));
        if unique < next {
            progress.triangles(mesh.triangles.len() as u64);
        } else if mesh.triangles.len() > large {
            alone.push((unique, MergedMesh { file, mesh }));
        } else {
            beside.push((unique, MergedMesh { file, mesh }));
        }
    }
    // Each mesh goes as soon as it is built.
    let one = |(unique, mesh): (usize, MergedMesh)| {
        let built = build_one(runtime, library, options, &mesh);
        progress.triangles(mesh.mesh.triangles.len() as u64);
        built.map(|built| (unique, built))
    };
    let mut built: Vec<(usize, Built)> = alone.into_iter().map(one).collect::<Result<_, _>>()?;
    // All are waited for, then the first error in order is the one told, whatever the thread count.
    let small: Vec<Result<(usize, Built), IngestError>> = beside.into_par_iter().map(one).collect();
    for result in small {
        built.push(result?);
    }
    built.sort_by_key(|(unique, _)| *unique);
    progress.end();
    let stored = uses.into_iter().map(|(unique, name, materials)| {
        let (_, built) = &built[unique];
        StoredMesh {
            name,
            materials,
            asset: built.asset,
            report: built.report.clone(),
            store_secs: built.store_secs,
        }
    });
    Ok(stored.collect())
}

struct Built {
    asset: ContentHash,
    report: BuildReport,
    store_secs: f64,
}

fn build_one(
    runtime: &Handle,
    library: &Library,
    options: &IngestOptions,
    mesh: &MergedMesh,
) -> Result<Built, IngestError> {
    let built = build::build(&mesh.mesh, &options.build).map_err(|error| IngestError::Build {
        file: mesh.file.to_path_buf(),
        error,
    })?;
    let storing = Instant::now();
    let BuiltAsset {
        asset_bytes,
        hierarchy_bytes,
        pack,
        report,
        ..
    } = built;
    let asset = runtime.block_on(async {
        // What an object names is there before it.
        let pack = match pack {
            build::Pack::Memory(bytes) => bytes,
            build::Pack::File(file) => std::fs::read(file.path()).unwrap_or_default(),
        };
        for bytes in [pack, hierarchy_bytes] {
            library
                .put_object(Bytes::from(bytes), RENEW_AFTER_SECS)
                .await?;
        }
        let put = library.put_object(Bytes::from(asset_bytes), RENEW_AFTER_SECS);
        put.await.map(|(hash, _)| hash)
    })?;
    Ok(Built {
        asset,
        report,
        store_secs: storing.elapsed().as_secs_f64(),
    })
}

/// Names what the build reads of a mesh: all but its name and which materials its slots mean.
fn content(mesh: &Mesh) -> ContentHash {
    let mut hasher = ContentHasher::default();
    let mut part = |present: bool, bytes: &[u8]| {
        hasher.update(&[present as u8]);
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    part(true, bytemuck::cast_slice(&mesh.positions));
    let normals = mesh.normals.as_deref();
    part(
        normals.is_some(),
        bytemuck::cast_slice(normals.unwrap_or_default()),
    );
    let uvs = mesh.uvs.as_deref();
    part(uvs.is_some(), bytemuck::cast_slice(uvs.unwrap_or_default()));
    let colors = mesh.colors.as_deref();
    part(
        colors.is_some(),
        bytemuck::cast_slice(colors.unwrap_or_default()),
    );
    part(true, bytemuck::cast_slice(&mesh.triangles));
    part(true, bytemuck::cast_slice(&mesh.triangle_materials));
    part(true, &(mesh.material_slots.len() as u64).to_le_bytes());
    hasher.finish()
}
