//! What an ingest did: the JSON of `--report`.

use std::collections::BTreeMap;
use std::sync::Arc;

use lodestream_format::{ContentHash, Scene};

use super::records::StoredAsset;
use crate::build::{GroupsByTerm, LevelRow};
use crate::library::Repaired;

/// Figures of a scene; sums are over its assets, each once.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct IngestReport {
    /// Triangles of the inputs' meshes, each mesh once.
    pub input_triangles: u64,
    /// Instances.
    pub instances: u64,
    /// Assets.
    pub assets: u64,
    /// Assets built by this run.
    pub built: u64,
    /// Assets found in the library, built with the same options by an earlier run.
    pub reused: u64,
    /// Objects that were damaged or missing in the library, stored anew.
    pub repaired: Repaired,
    /// Triangles of all clusters.
    pub dag_triangles: u64,
    /// Clusters.
    pub clusters: u64,
    /// Groups.
    pub groups: u64,
    /// Groups by the largest term of their error.
    pub groups_by_term: GroupsByTerm,
    /// Levels of the deepest asset.
    pub levels: u32,
    /// Pages.
    pub pages: u64,
    /// Sizes.
    pub bytes: IngestBytes,
    /// Packs and hierarchies over input triangles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes_per_input_triangle: Option<f64>,
    /// Packs and hierarchies over the triangles of all clusters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes_per_dag_triangle: Option<f64>,
    /// Wall-clock time.
    pub seconds: IngestSeconds,
    /// Largest resident set of the process, where the system tells.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak_rss_bytes: Option<u64>,
    /// Mean triangles of a cluster.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cluster_fill: Option<f64>,
    /// Rows of all assets added up by level.
    pub levels_table: Vec<LevelRow>,
    /// What was left out or changed.
    pub warnings: Vec<String>,
}

/// Bytes of the scene's parts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct IngestBytes {
    /// All pages in memory form.
    pub memory_form: u64,
    /// All pages in disk form, before compression.
    pub disk_form: u64,
    /// Packs.
    pub stored: u64,
    /// Hierarchies.
    pub hierarchy: u64,
    /// Frames of the root pages.
    pub root_pages: u64,
    /// Image files.
    pub textures: u64,
}

/// Wall-clock seconds of this run; what it reused cost it nothing but the looking up, which counts as storing. Meshes are built,
/// encoded and stored side by side: that time is shared out as the threads spent it.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct IngestSeconds {
    /// Everything.
    pub total: f64,
    /// Files to meshes.
    pub import: f64,
    /// Meshes to pages.
    pub build: f64,
    /// Pages to bytes.
    pub encode: f64,
    /// Bytes into the library, and the publishing.
    pub store: f64,
}

/// Wall-clock seconds as the stages can measure them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    pub total: f64,
    pub import: f64,
    /// Build, encode and store of all meshes.
    pub meshes: f64,
    /// Build records, textures, scene and publishing.
    pub rest: f64,
}

impl Clock {
    /// `stored` are the assets that the run stored or reused.
    pub(super) fn seconds<'a>(
        &self,
        stored: impl Iterator<Item = &'a StoredAsset>,
    ) -> IngestSeconds {
        let mut spent = [0.0; 3];
        for asset in stored.filter(|asset| !asset.reused) {
            spent[0] += asset.report.seconds.build;
            spent[1] += asset.report.seconds.encode;
            spent[2] += asset.store_secs;
        }
        let all = spent.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let [build, encode, store] = spent.map(|seconds| self.meshes * seconds / all);
        IngestSeconds {
            total: self.total,
            import: self.import,
            build,
            encode,
            store: store + self.rest,
        }
    }
}

/// Each asset once; one that was built now where equal ones were both built and reused.
pub(super) fn unique(stored: &[Arc<StoredAsset>]) -> BTreeMap<ContentHash, &StoredAsset> {
    let built = stored.iter().filter(|asset| !asset.reused);
    let reused = stored.iter().filter(|asset| asset.reused);
    let both = reused.chain(built);
    both.map(|asset| (asset.asset, &**asset)).collect()
}

/// Adds up; `repaired` counts objects beside the assets.
pub(super) fn report(
    scene: &Scene,
    stored: &[Arc<StoredAsset>],
    repaired: Repaired,
    clock: Clock,
) -> IngestReport {
    let assets = unique(stored);
    let mut report = IngestReport {
        input_triangles: scene.source_triangles,
        instances: scene.instances.len() as u64,
        assets: assets.len() as u64,
        built: assets.values().filter(|asset| !asset.reused).count() as u64,
        reused: assets.values().filter(|asset| asset.reused).count() as u64,
        repaired,
        seconds: clock.seconds(assets.values().copied()),
        warnings: scene.warnings.clone(),
        peak_rss_bytes: peak_rss_bytes(),
        ..IngestReport::default()
    };
    for asset in assets.values() {
        let built = &asset.report;
        report.repaired.merge(asset.repaired);
        report.dag_triangles += built.dag_triangles;
        report.clusters += built.clusters;
        report.groups += built.groups;
        report.groups_by_term.add(&built.groups_by_term);
        report.levels = report.levels.max(built.levels);
        report.pages += built.pages;
        report.bytes.memory_form += built.bytes.memory_form;
        report.bytes.disk_form += built.bytes.disk_form;
        report.bytes.stored += built.bytes.stored;
        report.bytes.hierarchy += built.bytes.hierarchy;
        report.bytes.root_pages += built.bytes.root_pages;
    }
    let objects: BTreeMap<_, _> = scene
        .textures
        .iter()
        .map(|texture| (texture.object, texture.bytes))
        .collect();
    report.bytes.textures = objects.values().sum();
    let bytes = (report.bytes.stored + report.bytes.hierarchy) as f64;
    let over = |value: f64, count: u64| (count > 0).then(|| value / count as f64);
    report.bytes_per_input_triangle = over(bytes, report.input_triangles);
    report.bytes_per_dag_triangle = over(bytes, report.dag_triangles);
    report.cluster_fill = over(report.dag_triangles as f64, report.clusters);
    report.levels_table = levels_table(assets.values().map(|asset| &asset.report.levels_table[..]));
    report
}

/// Rows by level; a measured error only where every asset with that level measured it.
fn levels_table<'a>(tables: impl Iterator<Item = &'a [LevelRow]>) -> Vec<LevelRow> {
    let mut all: BTreeMap<u32, LevelRow> = BTreeMap::new();
    for row in tables.flatten() {
        match all.get_mut(&row.level) {
            None => {
                all.insert(row.level, *row);
            }
            Some(sum) => {
                sum.triangles += row.triangles;
                sum.clusters += row.clusters;
                sum.groups += row.groups;
                sum.error_max = sum.error_max.max(row.error_max);
                let both = sum.measured_error_max.zip(row.measured_error_max);
                sum.measured_error_max = both.map(|(a, b)| a.max(b));
            }
        }
    }
    all.into_values().collect()
}

/// `VmHWM` of Linux' `/proc/self/status`.
pub(super) fn peak_rss_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}
