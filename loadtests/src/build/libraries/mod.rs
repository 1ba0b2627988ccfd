//! Which library does what, by measurement: the stages of a build that a library could do, ours and theirs on the same input.
//!
//! `clusters` cuts the source, `partitions` groups clusters, `simplifiers` thins groups out. Each takes what our own build had at
//! that stage, so that only the one stage differs. Whole builds are held against clusterlod in [`super::study`].

pub mod clusters;
pub mod partitions;
pub mod simplifiers;

use lodestream_server::build::{BuildOptions, build};
use serde::Serialize;

use super::dag::ClusterDag;
use super::memory::thread_pool;
use super::target::{MeshesOf, StudyError};
use clusters::ClusterRow;
use partitions::PartitionRow;
use simplifiers::SimplifierRow;

/// Levels whose clusters are partitioned: the source, and one whose borders were locked before.
const PARTITIONED_LEVELS: [u32; 2] = [0, 2];

/// Ours and theirs, stage by stage.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Libraries {
    /// Triangles to clusters.
    pub clusters: Vec<ClusterRow>,
    /// Clusters to groups.
    pub partitions: Vec<PartitionRow>,
    /// Groups to half of their triangles.
    pub simplifiers: Vec<SimplifierRow>,
}

/// Measures the stages on the largest mesh of each input, on one thread where it is a time; `each` hears of every input
/// before it starts.
///
/// # Errors
/// The first input that cannot be read, or is refused by the build.
pub fn study(inputs: &[MeshesOf], mut each: impl FnMut(&str)) -> Result<Libraries, StudyError> {
    let mut libraries = Libraries::default();
    let one = thread_pool(1)?;
    for input in inputs {
        let name = input.short_name();
        each(&name);
        let meshes = input.load()?;
        let Some(mesh) = meshes.first() else {
            continue;
        };
        let built = one.install(|| build(mesh, &BuildOptions::default()));
        let built = built.map_err(|error| StudyError::Refused {
            input: name.clone(),
            reason: error.to_string(),
        })?;
        let dag = ClusterDag::of_asset(&built).map_err(|source| StudyError::Format {
            input: name.clone(),
            source,
        })?;
        let seconds = built.report.seconds;
        let step_metres = built.asset.position_grid.step();
        libraries
            .clusters
            .extend(clusters::rows(&name, &dag, seconds.leaves));
        for level in PARTITIONED_LEVELS {
            libraries
                .partitions
                .extend(partitions::rows(&name, &dag, level));
        }
        let grow_secs = seconds.build - seconds.leaves;
        let rows = simplifiers::rows(&name, &dag, step_metres, grow_secs);
        libraries.simplifiers.extend(rows);
    }
    Ok(libraries)
}
