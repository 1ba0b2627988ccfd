//! Build records: a mesh that was built before, with the same options and the same builder, is found again.

use std::sync::Arc;

use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::ContentHash;
use lodestream_format::hash::ContentHasher;
use tokio::runtime::Handle;

use super::RENEW_AFTER_SECS;
use super::build_report::StoredReport;
use crate::build::{BuildOptions, BuildReport};
use crate::import::{ImportError, Mesh, MeshSource};
use crate::library::{BuildRecord, Check, Library, LibraryError, Repaired};

/// Of the builder. Raise it whenever the same mesh and options become other bytes: what an older builder stored is then built
/// anew. A test pins the bytes of a sample beside this number.
pub const BUILDER_VERSION: u32 = 11;

/// Records looked up at once.
const READS_AT_ONCE: usize = 16;
/// Builds hashed at once; each takes a few MiB of memory.
const CHECKS_AT_ONCE: usize = 8;

/// What a mesh became.
#[derive(Debug, Clone)]
pub(super) struct StoredAsset {
    pub asset: ContentHash,
    /// Of the build, whenever that was; warnings without the mesh's name.
    pub report: BuildReport,
    /// Seconds spent storing it now.
    pub store_secs: f64,
    /// Built in an earlier run.
    pub reused: bool,
    /// Those of its objects that were damaged in the library, or missing though recorded.
    pub repaired: Repaired,
}

/// Names what the build reads of a mesh: all but its name and which materials its slots mean.
///
/// # Errors
/// What reading the mesh says.
pub(super) fn content(mesh: &dyn MeshSource) -> Result<ContentHash, ImportError> {
    let mut hasher = ContentHasher::default();
    let mut part = |present: bool, bytes: &[u8]| {
        hasher.update(&[present as u8]);
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    part(true, &(mesh.material_slot_count() as u64).to_le_bytes());
    part(true, &(mesh.piece_count() as u64).to_le_bytes());
    for index in 0..mesh.piece_count() {
        let piece = mesh.piece(index)?;
        // Named one by one, so that an attribute added to a mesh cannot be forgotten here.
        let Mesh {
            name: _,
            positions,
            normals,
            uvs,
            colors,
            triangles,
            triangle_materials,
            material_slots: _,
        } = &*piece;
        part(true, bytemuck::cast_slice(positions));
        let (normals, uvs, colors) = (normals.as_deref(), uvs.as_deref(), colors.as_deref());
        part(
            normals.is_some(),
            bytemuck::cast_slice(normals.unwrap_or_default()),
        );
        part(uvs.is_some(), bytemuck::cast_slice(uvs.unwrap_or_default()));
        part(
            colors.is_some(),
            bytemuck::cast_slice(colors.unwrap_or_default()),
        );
        part(true, bytemuck::cast_slice(triangles));
        part(true, bytemuck::cast_slice(triangle_materials));
    }
    Ok(hasher.finish())
}

/// Names a build: what is built, how, beside which neighbours, and by which builder.
pub(super) fn key(
    content: &ContentHash,
    options: &BuildOptions,
    neighbours: &ContentHash,
) -> ContentHash {
    // `Debug` names every option, so that one added later is part of the name.
    let text = format!("lodestream build {BUILDER_VERSION} {options:?} {neighbours} {content}");
    ContentHash::of(text.as_bytes())
}

/// State of a recorded build.
pub(super) enum Known {
    /// No record.
    No,
    /// Its objects are whole.
    Whole(Arc<StoredAsset>),
    /// Some of its objects are damaged or missing.
    Broken([ContentHash; 3]),
}

/// States of the builds of `keys`, their objects checked as `check` says. `warn` gets a line for
/// each record that cannot be used.
pub(super) fn find(
    runtime: &Handle,
    library: &Library,
    keys: &[ContentHash],
    check: Check,
    warn: &dyn Fn(String),
) -> Result<Vec<Known>, LibraryError> {
    let at_once = match check {
        Check::Hash => CHECKS_AT_ONCE,
        Check::Length => READS_AT_ONCE,
    };
    let lookups = keys.iter().map(|key| find_one(library, key, check, warn));
    runtime.block_on(stream::iter(lookups).buffered(at_once).try_collect())
}

async fn find_one(
    library: &Library,
    key: &ContentHash,
    check: Check,
    warn: &dyn Fn(String),
) -> Result<Known, LibraryError> {
    let unusable = |error: LibraryError, known: Known| match error.is_damage() || error.is_missing()
    {
        true => {
            warn(format!("build record {key} is not used: {error}"));
            Ok(known)
        }
        false => Err(error),
    };
    let record = match library.build::<StoredReport>(key).await {
        Ok(Some(record)) => record,
        Ok(None) => return Ok(Known::No),
        Err(error) => return unusable(error, Known::No),
    };
    // Young before its objects are looked for: `gc` then leaves them.
    library.renew_build(key, &record, RENEW_AFTER_SECS).await?;
    match library.has_build(&record, check).await {
        Ok(()) => Ok(Known::Whole(Arc::new(StoredAsset {
            asset: record.asset,
            report: record.report.0,
            store_secs: 0.0,
            reused: true,
            repaired: Repaired::default(),
        }))),
        Err(error) => unusable(error, Known::Broken(record.objects())),
    }
}

/// Remembers what `key` became; its objects are stored already.
pub(super) async fn remember(
    library: &Library,
    key: &ContentHash,
    asset: &lodestream_format::Asset,
    asset_hash: ContentHash,
    report: &BuildReport,
) -> Result<(), LibraryError> {
    let record = BuildRecord {
        asset: asset_hash,
        hierarchy: asset.hierarchy,
        hierarchy_bytes: report.bytes.hierarchy,
        pack: asset.pack,
        pack_bytes: asset.pack_bytes(),
        report,
    };
    library.put_build(key, &record).await
}
