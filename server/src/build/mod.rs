//! Build: a mesh becomes an asset.
//!
//! ```text
//! mesh -> quantize -> clusterize -> [ partition -> simplify -> clusterize ]* -> paginate -> hierarchy -> encode
//!                                   '------------- dag, bounds ----------'
//! ```
//!
//! Simplifying a group leaves the places that it shares with other groups alone and keeps its boundary chain
//! (`boundary`), so every cut is closed where the source is. The stored error bounds the distance to the source
//! (`measure`, `bounds`). Groups run in parallel and are merged in order: the same mesh and options give the same
//! bytes, whatever the thread count.

mod boundary;
mod bounds;
mod clusterize;
mod dag;
mod encode;
mod error;
mod hierarchy;
mod local;
mod measure;
mod merge;
mod meshopt_seam;
mod paginate;
mod partition;
mod quantize;
mod report;
mod seams;
mod simplify;
mod steps;
mod triangle_tree;

use std::time::Instant;

use lodestream_format::disk_form::DiskForm;
use lodestream_format::frame::{self, Codec};
use lodestream_format::{Asset, FormatError};

use crate::import::Mesh;

pub use error::BuildError;
pub use report::{BuildBytes, BuildReport, BuildSeconds, LevelRow};
pub use steps::PositionStep;
pub use triangle_tree::{Point, TriangleTree};

/// What a caller chooses.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BuildOptions {
    /// Step of the position grid.
    pub position_step: PositionStep,
    /// Compression of the pages.
    pub codec: Codec,
}

/// An asset with the bytes of its objects.
#[derive(Debug, Clone, PartialEq)]
pub struct BuiltAsset {
    /// The asset itself.
    pub asset: Asset,
    /// Its object.
    pub asset_bytes: Vec<u8>,
    /// The hierarchy's object.
    pub hierarchy_bytes: Vec<u8>,
    /// The frames of all pages.
    pub pack: Vec<u8>,
    /// What the build did.
    pub report: BuildReport,
}

/// Builds the asset of `mesh` on rayon's threads.
///
/// # Errors
/// A mesh without triangles, one that breaks the promises of [`Mesh`], one wider than 2^123 metres, or a step that is no
/// length. Triangles that collapse on the grid are dropped with a warning, all but the first if all do.
pub fn build(mesh: &Mesh, options: &BuildOptions) -> Result<BuiltAsset, BuildError> {
    let start = Instant::now();
    let quantized = quantize::quantize(mesh, options.position_step)?;
    let dag = dag::build(&quantized);
    let pages = paginate::paginate(&quantized, &dag);
    let hierarchy = hierarchy::hierarchy(&quantized, &dag, &pages);
    let build = start.elapsed();
    let encoded = encode::encode(&quantized, &dag, &pages, &hierarchy, options.codec)?;
    let encode = start.elapsed() - build;
    let report = report::report(&quantized, &dag, &pages, &encoded, build, encode);
    Ok(BuiltAsset {
        asset: encoded.asset,
        asset_bytes: encoded.asset_bytes,
        hierarchy_bytes: encoded.hierarchy_bytes,
        pack: encoded.pack,
        report,
    })
}

/// Reads every page back, with all checks of the reader; for tests and tools.
///
/// # Errors
/// What the readers of the frame and the disk form say; none for an asset that [`build`] gave.
pub fn decode_pages(built: &BuiltAsset) -> Result<Vec<DiskForm>, FormatError> {
    let frame_of = |page: &lodestream_format::asset::PageEntry| {
        let range = page.offset as usize..page.offset as usize + page.bytes as usize;
        built.pack.get(range).ok_or_else(|| {
            FormatError::new(
                "page frame",
                format!("inside {} bytes", built.pack.len()),
                page.offset,
            )
        })
    };
    built
        .asset
        .pages
        .iter()
        .map(|page| DiskForm::parse(frame::decode(frame_of(page)?)?))
        .collect()
}
