//! What a build did, in the keys of `ingest --report`.

use super::bounds::Term;
use super::dag::Dag;
use super::encode::Encoded;
use super::paginate::Pages;
use super::vertex::Grids;

/// Figures of one asset. Serializes to the report keys of `ingest`.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct BuildReport {
    /// Triangles on the grid: those of the mesh less those that collapsed.
    pub triangles: u64,
    /// Triangles of all clusters.
    pub dag_triangles: u64,
    /// Clusters.
    pub clusters: u64,
    /// Groups.
    pub groups: u64,
    /// Groups whose replacement moved open edges of the source.
    pub groups_with_moved_open_edges: u64,
    /// Groups by the largest term of their error.
    pub groups_by_term: GroupsByTerm,
    /// Levels, the source included.
    pub levels: u32,
    /// Pages.
    pub pages: u64,
    /// Sizes.
    pub bytes: BuildBytes,
    /// Mean triangles of a cluster.
    pub cluster_fill: f64,
    /// One row a level, the source first.
    pub levels_table: Vec<LevelRow>,
    /// Wall-clock time.
    pub seconds: BuildSeconds,
    /// One line for each thing that was changed or left out.
    pub warnings: Vec<String>,
}

/// Groups by the term that decides their error. Groups of roots, which nothing replaces, have none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroupsByTerm {
    /// Distance of the source from the replacement.
    pub source: u64,
    /// Distance of the replacement from the source.
    pub surface: u64,
    /// A member's error.
    pub members: u64,
    /// Distance of parts that vanished from what is left.
    pub lost: u64,
    /// Normals, texture coordinates and colours.
    pub attributes: u64,
    /// Materials.
    pub materials: u64,
}

impl GroupsByTerm {
    fn of(dag: &Dag) -> Self {
        let mut counts = Self::default();
        for term in dag.groups.iter().filter_map(|group| group.term) {
            *match term {
                Term::Source => &mut counts.source,
                Term::Surface => &mut counts.surface,
                Term::Members => &mut counts.members,
                Term::Lost => &mut counts.lost,
                Term::Attributes => &mut counts.attributes,
                Term::Materials => &mut counts.materials,
            } += 1;
        }
        counts
    }

    /// Adds the counts of another asset.
    pub fn add(&mut self, other: &Self) {
        self.source += other.source;
        self.surface += other.surface;
        self.members += other.members;
        self.lost += other.lost;
        self.attributes += other.attributes;
        self.materials += other.materials;
    }
}

/// Bytes of the parts of an asset.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct BuildBytes {
    /// All pages in memory form.
    pub memory_form: u64,
    /// All pages in disk form, before compression.
    pub disk_form: u64,
    /// The pack.
    pub stored: u64,
    /// The hierarchy object.
    pub hierarchy: u64,
    /// Frames of the root pages.
    pub root_pages: u64,
}

/// One level of the DAG.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct LevelRow {
    /// 0 holds the source triangles.
    pub level: u32,
    /// Triangles.
    pub triangles: u64,
    /// Clusters.
    pub clusters: u64,
    /// Groups whose coarsest clusters are of this level.
    pub groups: u64,
    /// Largest stored error, metres.
    pub error_max: f64,
    /// Largest measured distance to the source, metres, where it was measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured_error_max: Option<f64>,
}

/// Wall-clock seconds of the stages.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct BuildSeconds {
    /// Mesh to the clusters of level 0; a part of `build`.
    pub leaves: f64,
    /// Mesh to pages.
    pub build: f64,
    /// Pages to bytes.
    pub encode: f64,
}

/// Sums up a build.
pub(super) fn report(
    warnings: Vec<String>,
    grids: &Grids,
    dag: &Dag,
    pages: &Pages,
    encoded: &Encoded,
    seconds: BuildSeconds,
) -> BuildReport {
    let asset = &encoded.asset;
    let mut levels_table: Vec<LevelRow> = (0..asset.levels)
        .map(|level| LevelRow {
            level,
            error_max: grids.rounding_metres(),
            ..LevelRow::default()
        })
        .collect();
    for cluster in &dag.clusters {
        let row = &mut levels_table[cluster.level as usize];
        row.triangles += cluster.triangle_count as u64;
        row.clusters += 1;
        if let Some(group) = dag.groups.get(cluster.child_group as usize) {
            row.error_max = row.error_max.max(group.parent_error_metres as f64);
        }
    }
    for group in &dag.groups {
        levels_table[group.level as usize].groups += 1;
    }
    let roots = &asset.pages[..asset.root_page_count as usize];
    BuildReport {
        triangles: asset.source_triangles,
        dag_triangles: asset.dag_triangles,
        clusters: asset.clusters,
        groups: dag.groups.len() as u64,
        groups_with_moved_open_edges: dag.groups_with_moved_open_edges as u64,
        groups_by_term: GroupsByTerm::of(dag),
        levels: asset.levels,
        pages: pages.pages.len() as u64,
        bytes: BuildBytes {
            memory_form: asset
                .pages
                .iter()
                .map(|page| 4 * page.memory_words as u64)
                .sum(),
            disk_form: encoded.disk_form_bytes,
            stored: asset.pack_bytes(),
            hierarchy: encoded.hierarchy_bytes.len() as u64,
            root_pages: roots.iter().map(|page| page.bytes as u64).sum(),
        },
        cluster_fill: asset.dag_triangles as f64 / asset.clusters as f64,
        levels_table,
        seconds,
        warnings,
    }
}
