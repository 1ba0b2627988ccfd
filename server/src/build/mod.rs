//! Build: a mesh becomes an asset.
//!
//! ```text
//! source -> survey -> scatter -> leaves (clusterize) -> [ partition -> simplify -> clusterize ]* -> paginate -> hierarchy -> encode
//!                                                       '-------------- dag, borders, bounds -'
//! ```
//!
//! Every stage takes pieces that fit memory, whatever the mesh: source pieces become blocks in buckets, buckets become
//! clusters, and each level's clusters are taken chunk by chunk. Between the stages they wait in a `store`, in memory or on
//! disk. Simplifying a group leaves alone what it shares with other groups (`borders`), so every cut is closed where the
//! source is. Each round has a budget, the distance from the source that its groups may reach
//! (`budgets`). The stored error bounds that distance both ways (`simplify/witness`, `back`,
//! `bounds`). Work runs in parallel and is
//! merged in order: the same mesh and options give the same bytes, whatever the thread count and wherever it waits.

mod back;
mod borders;
mod bounds;
mod budgets;
mod centroids;
mod cluster;
mod clusterize;
mod dag;
mod encode;
mod error;
mod hierarchy;
mod leaves;
mod measure;
mod meshopt_seam;
mod neighbours;
mod pack;
mod packed;
mod paginate;
mod parents;
mod partition;
mod proxy;
mod report;
mod scatter;
mod shape;
mod simplify;
mod split;
mod steps;
mod store;
mod survey;
mod triangle_tree;
mod vertex;

use std::path::Path;
use std::time::Instant;

use lodestream_format::disk_form::DiskForm;
use lodestream_format::frame::{self, Codec};
use lodestream_format::page_reader::PageReader;
use lodestream_format::{Asset, Cluster, FormatError, cluster_view};

use crate::import::MeshSource;
use dag::{Dag, Plan};
use neighbours::FixedPlaces;
use store::Store;
use survey::Survey;
use vertex::Grids;

pub use error::BuildError;
pub use neighbours::Neighbours;
pub use pack::{Pack, PackFile};
pub use report::{BuildBytes, BuildReport, BuildSeconds, GroupsByTerm, LevelRow};
pub use simplify::Placement;
pub use steps::MOST_EXTENT_STEPS;
pub use steps::PositionStep;
pub use triangle_tree::{Point, TriangleTree};

/// What a caller chooses.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BuildOptions {
    /// Step of the position grid.
    pub position_step: PositionStep,
    /// Where vertices of coarser levels may lie.
    pub placement: Placement,
    /// Compression of the pages.
    pub codec: Codec,
}

/// Where and how a build runs; the bytes of the asset do not depend on it.
#[derive(Clone, Copy)]
pub struct BuildSite<'a> {
    /// Folder for what does not fit memory; all is kept in memory without one.
    pub scratch: Option<&'a Path>,
    /// Told how many triangles each finished group held, from any thread. They add up to about twice those of the mesh.
    pub on_triangles: &'a (dyn Fn(u64) + Sync),
}

impl Default for BuildSite<'_> {
    fn default() -> Self {
        Self {
            scratch: None,
            on_triangles: &|_| (),
        }
    }
}

/// An asset with the bytes of its objects.
#[derive(Debug)]
pub struct BuiltAsset {
    /// The asset itself.
    pub asset: Asset,
    /// Its object.
    pub asset_bytes: Vec<u8>,
    /// The hierarchy's object.
    pub hierarchy_bytes: Vec<u8>,
    /// The frames of all pages.
    pub pack: Pack,
    /// What the build did.
    pub report: BuildReport,
}

/// Builds the asset of a mesh on rayon's threads. The source is let go as soon as it has been read.
///
/// # Errors
/// A mesh without triangles, one that breaks the promises of [`crate::import::Mesh`], one wider than 2^123 metres, a step
/// that is no length, a source that cannot be read, a scratch folder that is full. Triangles that collapse on the grid are
/// dropped with a warning, all but the first if all do.
pub fn build(source: impl MeshSource, options: &BuildOptions) -> Result<BuiltAsset, BuildError> {
    let alone = Neighbours::default();
    build_at(source, options, &alone, BuildSite::default())
}

/// The same beside `neighbours`, with a scratch folder and a listener.
///
/// # Errors
/// Those of [`build`].
pub fn build_at(
    source: impl MeshSource,
    options: &BuildOptions,
    neighbours: &Neighbours,
    site: BuildSite,
) -> Result<BuiltAsset, BuildError> {
    let start = Instant::now();
    let scratch = site.scratch;
    let name = source.name().to_owned();
    let material_slots = source.material_slot_count().max(1) as u32;
    let survey = survey::survey(&source)?;
    let mut warnings = Vec::new();
    let step = steps::Wanted {
        step: options.position_step,
        shared_exponent: neighbours.step_exponent,
    };
    let grids = grids(&name, &survey, step, &mut warnings)?;
    let fixed = FixedPlaces::new(neighbours, &grids);

    let mut blocks = Store::new(scratch)?;
    let buckets = scatter::scatter(&source, &survey, &grids, &mut blocks)?;
    drop(source);
    let mut dag = Dag::new(Store::new(scratch)?);
    let collapsed = leaves::leaves(&buckets, &mut blocks, |clusters| {
        dag.add(clusters, lodestream_format::cluster::NO_GROUP)
            .map(|_| ())
    })?;
    drop(blocks);
    let leaves = start.elapsed();
    let source_triangles = dag
        .clusters
        .iter()
        .map(|info| info.triangle_count as u64)
        .sum();
    if collapsed > 0 {
        warnings.push(collapse_warning(&name, &survey, collapsed, &grids));
    }
    let plan = Plan {
        grids: &grids,
        placement: options.placement,
        fixed: &fixed,
        on_triangles: site.on_triangles,
    };
    let proxy = dag.grow(plan)?;
    let build = start.elapsed();

    let pages = paginate::paginate(&grids, &dag)?;
    let hierarchy = hierarchy::hierarchy(&grids, &dag, &pages);
    let facts = encode::Facts {
        material_slots,
        source_triangles,
        proxy,
    };
    let encoded = encode::encode(
        &grids,
        facts,
        &mut dag,
        &pages,
        &hierarchy,
        options.codec,
        scratch,
    )?;
    let seconds = BuildSeconds {
        leaves: leaves.as_secs_f64(),
        build: build.as_secs_f64(),
        encode: (start.elapsed() - build).as_secs_f64(),
    };
    let report = report::report(warnings, &grids, &dag, &pages, &encoded, seconds);
    Ok(BuiltAsset {
        asset: encoded.asset,
        asset_bytes: encoded.asset_bytes,
        hierarchy_bytes: encoded.hierarchy_bytes,
        pack: encoded.pack,
        report,
    })
}

/// Exponent of the position step that [`PositionStep::Auto`] takes for a mesh on its own.
///
/// # Errors
/// Those of the source.
pub fn usual_step_exponent(source: &impl MeshSource) -> Result<i32, BuildError> {
    Ok(steps::auto(&survey::survey(source)?))
}

fn collapse_warning(name: &str, survey: &Survey, collapsed: u64, grids: &Grids) -> String {
    let step = grids.step_metres();
    if collapsed >= survey.triangles {
        return format!("mesh {name:?}: every triangle collapsed; the first stays, without area");
    }
    format!(
        "mesh {name:?}: {collapsed} triangles without area on the position grid of {step:e} metres were dropped"
    )
}

/// Grids of a mesh; positions count from the middle of its bounds.
fn grids(
    name: &str,
    survey: &Survey,
    step: steps::Wanted,
    warnings: &mut Vec<String>,
) -> Result<Grids, BuildError> {
    let position = steps::position_grid(name, survey, step, warnings)?;
    let uv = steps::uv_grid(survey);
    Ok(Grids {
        attributes: survey.attributes,
        position,
        uv,
        center_q: std::array::from_fn(|axis| {
            let (low, high) = (survey.low[axis], survey.high[axis]);
            let (low, high) = (position.quantize(low), position.quantize(high));
            low + (high - low) / 2
        }),
        uv_base: survey.uv_low.map(|low| uv.quantize(low.min(f64::MAX))),
    })
}

/// Reads every page back as clusters, with all checks of the reader; for tests and tools.
///
/// # Errors
/// Those of [`decode_pages`], and what restoring from parents says.
pub fn unpack_pages(built: &BuiltAsset) -> Result<Vec<Vec<Cluster>>, FormatError> {
    let mut reader = PageReader::new(&built.asset);
    decode_pages(built)?
        .iter()
        .map(|form| Ok(cluster_view::clusters(reader.read(form)?).collect()))
        .collect()
}

/// Reads every page back, with all checks of the reader; for tests and tools.
///
/// # Errors
/// What the readers of the frame and the disk form say; none for an asset that [`build`] gave.
pub fn decode_pages(built: &BuiltAsset) -> Result<Vec<DiskForm>, FormatError> {
    let frame_of = |page: &lodestream_format::asset::PageEntry| {
        let range = page.offset..page.offset + page.bytes as u64;
        let unreadable = |cause| FormatError::new("page frame", "inside the pack", cause);
        built.pack.read(range).map_err(unreadable)
    };
    built
        .asset
        .pages
        .iter()
        .map(|page| DiskForm::parse(frame::decode(&frame_of(page)?)?))
        .collect()
}
