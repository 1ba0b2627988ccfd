//! One row of the table: a builder on an input.

use lodestream_server::build::{BuildOptions, BuiltAsset, build};
use lodestream_server::import::Mesh;
use rayon::ThreadPool;
use serde::Serialize;

use super::clusterlod::{Prepared, Preset};
use super::dag::ClusterDag;
use super::process::spent;

/// Whose builder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Builder {
    /// Ours.
    Lodestream,
    /// The rival.
    Clusterlod(Preset),
}

impl Builder {
    /// Name in tables and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lodestream => "lodestream",
            Self::Clusterlod(Preset::Default) => "clusterlod",
            Self::Clusterlod(Preset::Spatial) => "clusterlod-rt",
        }
    }

    /// All of them, ours first.
    pub const ALL: [Self; 3] = [
        Self::Lodestream,
        Self::Clusterlod(Preset::Default),
        Self::Clusterlod(Preset::Spatial),
    ];
}

/// The shape of one DAG or several added up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Shape {
    /// Levels of the deepest, the source included.
    pub levels: u32,
    /// Groups.
    pub groups: u64,
    /// Clusters.
    pub clusters: u64,
    /// Triangles of all clusters.
    pub dag_triangles: u64,
    /// Clusters of level 0.
    pub source_clusters: u64,
    /// Triangles of level 0.
    pub source_triangles: u64,
    /// Clusters that nothing replaces.
    pub root_clusters: u64,
    /// Their triangles.
    pub root_triangles: u64,
    /// Most vertices of a cluster.
    pub max_vertices: u32,
}

impl Shape {
    /// Of one DAG.
    pub fn of(dag: &ClusterDag) -> Self {
        let mut shape = Self {
            levels: dag.levels(),
            groups: dag.groups.len() as u64,
            clusters: dag.clusters.len() as u64,
            dag_triangles: dag.triangles.len() as u64,
            ..Self::default()
        };
        for cluster in &dag.clusters {
            let triangles = u64::from(cluster.count);
            if cluster.child_group.is_none() {
                shape.source_clusters += 1;
                shape.source_triangles += triangles;
            }
            if dag.groups[cluster.group as usize].is_root() {
                shape.root_clusters += 1;
                shape.root_triangles += triangles;
            }
            shape.max_vertices = shape.max_vertices.max(cluster.vertices);
        }
        shape
    }

    /// Both added up.
    pub fn plus(self, other: Self) -> Self {
        Self {
            levels: self.levels.max(other.levels),
            groups: self.groups + other.groups,
            clusters: self.clusters + other.clusters,
            dag_triangles: self.dag_triangles + other.dag_triangles,
            source_clusters: self.source_clusters + other.source_clusters,
            source_triangles: self.source_triangles + other.source_triangles,
            root_clusters: self.root_clusters + other.root_clusters,
            root_triangles: self.root_triangles + other.root_triangles,
            max_vertices: self.max_vertices.max(other.max_vertices),
        }
    }

    /// Mean triangles of a cluster: of all, of level 0, of the levels above (NaN without).
    pub fn fill(&self) -> [f64; 3] {
        let of = |triangles: u64, clusters: u64| triangles as f64 / clusters as f64;
        [
            of(self.dag_triangles, self.clusters),
            of(self.source_triangles, self.source_clusters),
            of(
                self.dag_triangles - self.source_triangles,
                self.clusters - self.source_clusters,
            ),
        ]
    }
}

/// One timed run over all meshes of a part.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Run {
    /// Mesh to DAG (ours: to pages, before they are encoded), seconds.
    pub build_secs: f64,
    /// Mesh to bytes; the rival makes none.
    pub total_secs: f64,
    /// Processor seconds of the total.
    pub total_cpu_secs: Option<f64>,
    /// Meshes that were refused, with the reason.
    pub refused: Vec<String>,
}

impl Run {
    /// Processor seconds of the build: the total's, shared out as wall-clock time is.
    pub fn build_cpu_secs(&self) -> Option<f64> {
        let cpu = self.total_cpu_secs?;
        Some(match self.total_secs > 0.0 {
            true => cpu * self.build_secs / self.total_secs,
            false => cpu,
        })
    }
}

/// Builds all meshes with ours on the threads of `pool`; `each` gets every asset outside the measured time.
pub fn run_ours(
    meshes: &[Mesh],
    options: &BuildOptions,
    pool: &ThreadPool,
    mut each: impl FnMut(BuiltAsset),
) -> Run {
    let mut run = Run::default();
    for mesh in meshes {
        let (built, cost) = spent(|| pool.install(|| build(mesh, options)));
        run.add(cost.wall_secs, cost.cpu_secs);
        match built {
            Ok(built) => {
                run.build_secs += built.report.seconds.build;
                each(built);
            }
            Err(error) => run.refused.push(error.to_string()),
        }
    }
    run
}

/// Builds all meshes with the rival and counts its clusters, so that nothing is left out by the compiler; keeps nothing.
pub fn run_clusterlod(meshes: &[Mesh], preset: Preset) -> Run {
    let mut run = Run::default();
    for mesh in meshes {
        let prepared = Prepared::new(mesh);
        let (clusters, cost) = spent(|| {
            let mut clusters = 0;
            prepared.build(preset, |_, group| clusters += group.len());
            clusters
        });
        if clusters == 0 {
            run.refused
                .push(format!("mesh {:?}: no cluster", mesh.name));
        }
        run.build_secs += cost.wall_secs;
        run.add(cost.wall_secs, cost.cpu_secs);
    }
    run
}

impl Run {
    fn add(&mut self, wall_secs: f64, cpu_secs: Option<f64>) {
        let before = if self.total_secs == 0.0 {
            Some(0.0)
        } else {
            self.total_cpu_secs
        };
        self.total_cpu_secs = before.zip(cpu_secs).map(|(before, cpu)| before + cpu);
        self.total_secs += wall_secs;
    }
}
