//! A scene that a library holds, measured against its own source clusters: promises, levels, open edges. For assets that
//! are too large to build twice in one process.

use lodestream_format::disk_form::DiskForm;
use lodestream_format::page_reader::PageReader;
use lodestream_format::{Asset, FormatError, Hierarchy, frame};
use lodestream_server::library::{Library, LibraryError};
use serde::Serialize;

use super::curves::{CutFigures, Measuring, SourceSurface};
use super::dag::ClusterDag;
use super::edges::SourceBorder;
use super::groups;
use super::rows::Shape;
use super::study::Promises;

/// Groups of an asset that are measured, evenly spread.
const MOST_GROUPS: usize = 400;
/// Samples each way a group.
const GROUP_SAMPLES: usize = 30_000;

/// Why a stored scene could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum StoredError {
    /// The library, or an object of it.
    #[error(transparent)]
    Library(#[from] LibraryError),
    /// An asset that breaks the format.
    #[error("{asset}: {source}")]
    Format {
        /// Its name in the scene.
        asset: String,
        /// What the reader said.
        source: FormatError,
    },
}

/// An asset of the scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StoredRow {
    /// Its name in the scene.
    pub input: String,
    /// Its clusters.
    #[serde(flatten)]
    pub shape: Shape,
    /// Mean triangles of a cluster.
    pub fill: f64,
    /// The same at level 0.
    pub fill_source: f64,
    /// The same above; NaN without levels above.
    pub fill_above: f64,
    /// Bytes of the pack over triangles of level 0.
    pub stored_bytes_per_triangle: f64,
    /// Open edges of level 0.
    pub source_open_edges: u64,
    /// Most edges that a level opens.
    pub opened_edges: u64,
    /// Each level above the source.
    pub level_cuts: Vec<CutFigures>,
}

/// A scene, measured.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Stored {
    /// Samples each way a cut, at most about.
    pub samples: usize,
    /// Its assets.
    pub rows: Vec<StoredRow>,
    /// Their groups.
    pub promises: Vec<Promises>,
}

/// Measures the assets of a scene, the largest `most` of them.
///
/// # Errors
/// What cannot be read, or breaks the format.
pub async fn measure(
    library: &Library,
    scene: &str,
    most: usize,
    samples: usize,
) -> Result<Stored, StoredError> {
    let reference = library.reference(scene).await?;
    let scene = library.scene(&reference.scene).await?;
    let mut assets = Vec::new();
    for entry in &scene.assets {
        assets.push((entry.name.clone(), library.asset(&entry.asset).await?));
    }
    assets.sort_by_key(|(_, asset)| std::cmp::Reverse(asset.source_triangles));
    let mut stored = Stored {
        samples,
        ..Stored::default()
    };
    for (name, asset) in assets.into_iter().take(most) {
        let wrong = |source| StoredError::Format {
            asset: name.clone(),
            source,
        };
        let hierarchy = library.hierarchy(&asset).await?;
        let mut dag = ClusterDag::default();
        let mut places = Default::default();
        let mut reader = PageReader::new(&asset);
        for entry in &asset.pages {
            let range = entry.offset..entry.offset + u64::from(entry.bytes);
            let bytes = library.object_range(&asset.pack, range).await?;
            let form = frame::decode(&bytes).and_then(DiskForm::parse);
            let form = form.map_err(wrong)?;
            hierarchy.check_page(&form).map_err(wrong)?;
            let words = reader.read(&form).map_err(wrong)?;
            dag.add_page(words, asset.position_grid.step(), &mut places);
        }
        drop(places);
        dag.finish(&hierarchy);
        stored.add(&name, &asset, &hierarchy, &dag);
    }
    Ok(stored)
}

impl Stored {
    fn add(&mut self, name: &str, asset: &Asset, hierarchy: &Hierarchy, dag: &ClusterDag) {
        tracing::info!(asset = name, groups = hierarchy.groups.len(), "measuring");
        let step_metres = asset.position_grid.step();
        let errors = groups::measure(dag, MOST_GROUPS, GROUP_SAMPLES);
        self.promises.push(Promises {
            input: name.into(),
            figures: groups::figures(dag, &errors, step_metres),
        });
        let source = dag.gather(dag.level_cut(0));
        let source = SourceSurface::new((dag.places.clone(), source));
        let measuring = Measuring {
            dag,
            source: &source,
            border: SourceBorder::new(dag),
            step_metres,
            most_samples: self.samples,
        };
        let shape = Shape::of(dag);
        let [fill, fill_source, fill_above] = shape.fill();
        let levels = measuring.levels();
        self.rows.push(StoredRow {
            input: name.into(),
            shape,
            fill,
            fill_source,
            fill_above,
            stored_bytes_per_triangle: asset
                .pages
                .iter()
                .map(|it| f64::from(it.bytes))
                .sum::<f64>()
                / asset.source_triangles as f64,
            source_open_edges: measuring.border.open.len() as u64,
            opened_edges: levels.iter().map(|it| it.opened_edges).max().unwrap_or(0),
            level_cuts: levels,
        });
    }
}
