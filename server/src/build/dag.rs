//! The loop: group, simplify to half, split, until one cluster is left.

use lodestream_format::Sphere;
use lodestream_format::cluster::NO_GROUP;
use lodestream_format::hierarchy::ROOT_ERROR;
use lodestream_format::limits::MAX_LEVELS;
use rayon::prelude::*;

use super::boundary::OpenEdges;
use super::bounds;
use super::clusterize::{self, clusterize};
use super::partition::{LARGE_GROUP_CLUSTERS, USUAL_GROUP_CLUSTERS, partition, shared_places};
use super::quantize::{QuantizedMesh, Triangle};
use super::seams::Seams;
use super::simplify::{Locks, Simplified, simplify};

/// A round that leaves more of the triangles than this made no headway.
const NO_HEADWAY: f64 = 0.95;

/// A mesh that is stuck with no more clusters than this is coarse enough: more effort would move its open edges for little.
const FEW_ROOT_CLUSTERS: usize = 4;

/// At most 128 triangles, with what they were born with.
#[derive(Debug)]
pub(super) struct Cluster {
    pub triangles: Vec<Triangle>,
    /// Group whose simplification made it, or `NO_GROUP`.
    pub child_group: u32,
    /// 0 for source triangles, else one more than that of the group.
    pub level: u8,
    /// Error of that group's replacement, metres; 0 for source triangles.
    pub error_metres: f32,
    /// Lod sphere of that group; around the triangles themselves for source triangles.
    pub lod_sphere: Sphere,
}

/// Clusters that are refined together.
#[derive(Debug)]
pub(super) struct Group {
    pub members: Vec<u32>,
    /// Largest level of its clusters.
    pub level: u8,
    /// Number of the round that made it. Groups that hold what this one became have larger numbers.
    pub round: u32,
    pub lod_sphere: Sphere,
    pub parent_error_metres: f32,
}

/// Every cluster and every group of an asset.
#[derive(Debug, Default)]
pub(super) struct Dag {
    pub clusters: Vec<Cluster>,
    pub groups: Vec<Group>,
    /// Groups whose replacement moved open edges of the source.
    pub groups_with_moved_open_edges: usize,
}

/// What a round may do. Each is tried only after the one before made no headway.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Effort {
    Usual,
    /// Other, larger groups: what is stuck at one border may be free inside another.
    LargeGroups,
    /// Open edges may move: a mesh of thousands of loose sheets has no other coarser form.
    ReleaseOpenEdges,
}

impl Effort {
    fn next(self) -> Option<Self> {
        match self {
            Self::Usual => Some(Self::LargeGroups),
            Self::LargeGroups => Some(Self::ReleaseOpenEdges),
            Self::ReleaseOpenEdges => None,
        }
    }
}

/// Builds the DAG of a mesh. The same mesh gives the same DAG, whatever the thread count.
pub(super) fn build(mesh: &QuantizedMesh) -> Dag {
    let mut dag = Dag::default();
    let seams = Seams::of(mesh);
    let mut open = OpenEdges::of(mesh, mesh.triangles.iter());
    let mut pool = dag.add_leaves(mesh);
    let mut effort = Effort::Usual;
    let mut round = 0;
    while pool.len() > 1 {
        let target = if effort == Effort::Usual {
            USUAL_GROUP_CLUSTERS
        } else {
            LARGE_GROUP_CLUSTERS
        };
        let groups = partition(mesh, &dag.clusters, &pool, target);
        let shared = shared_places(mesh, &dag.clusters, &groups);
        let release_open_edges = effort == Effort::ReleaseOpenEdges;
        if release_open_edges {
            open = OpenEdges::of(mesh, dag.triangles_of(&pool));
        }
        let locks = Locks {
            shared: &shared,
            open: &open,
            release_open_edges,
            seams: &seams,
        };
        let replacements: Vec<_> = groups
            .par_iter()
            .map(|members| dag.replacement(mesh, members, locks))
            .collect();
        let before = dag.triangles_of(&pool).count();
        pool = dag.advance(groups, replacements, round);
        let after = dag.triangles_of(&pool).count();
        round += 1;
        if after as f64 > before as f64 * NO_HEADWAY {
            match effort.next() {
                Some(next) if pool.len() > FEW_ROOT_CLUSTERS => effort = next,
                _ => break,
            }
        }
    }
    dag.add_roots(mesh, &pool, round);
    dag
}

/// Clusters that replace a group.
struct Replacement {
    simplified: Simplified,
    clusters: Vec<Vec<Triangle>>,
}

impl Dag {
    fn add_leaves(&mut self, mesh: &QuantizedMesh) -> Vec<u32> {
        self.clusters = clusterize::leaves(mesh)
            .into_par_iter()
            .map(|triangles| Cluster {
                lod_sphere: bounds::around(mesh, &triangles),
                triangles,
                child_group: NO_GROUP,
                level: 0,
                error_metres: 0.0,
            })
            .collect();
        (0..self.clusters.len() as u32).collect()
    }

    /// Triangles of the clusters of `pool`, which cover the surface.
    fn triangles_of<'a>(&'a self, pool: &'a [u32]) -> impl Iterator<Item = &'a Triangle> {
        self.members(pool).flat_map(|cluster| &cluster.triangles)
    }

    fn members<'a>(&'a self, members: &'a [u32]) -> impl Iterator<Item = &'a Cluster> {
        members
            .iter()
            .map(|&cluster| &self.clusters[cluster as usize])
    }

    fn replacement(
        &self,
        mesh: &QuantizedMesh,
        members: &[u32],
        locks: Locks,
    ) -> Option<Replacement> {
        let level = self.members(members).map(|cluster| cluster.level).max()?;
        if level as usize + 1 >= MAX_LEVELS {
            return None;
        }
        let triangles: Vec<Triangle> = self.triangles_of(members).copied().collect();
        let floor = bounds::largest_error(self.members(members)) as f64;
        let simplified = simplify(mesh, &triangles, locks, floor)?;
        let clusters = clusterize(mesh, &simplified.triangles);
        Some(Replacement {
            simplified,
            clusters,
        })
    }

    /// Makes groups of those that have a replacement; gives the replacements and the clusters that wait for the next round.
    fn advance(
        &mut self,
        groups: Vec<Vec<u32>>,
        replacements: Vec<Option<Replacement>>,
        round: u32,
    ) -> Vec<u32> {
        let mut pool = Vec::new();
        for (members, replacement) in groups.into_iter().zip(replacements) {
            let Some(Replacement {
                simplified,
                clusters,
            }) = replacement
            else {
                pool.extend(members);
                continue;
            };
            self.groups_with_moved_open_edges += usize::from(simplified.open_edges_moved);
            let members_error = bounds::largest_error(self.members(&members));
            let lod_sphere = bounds::lod_sphere(self.members(&members));
            let error_metres = bounds::parent_error(members_error, &simplified, &lod_sphere);
            let child_group = self.groups.len() as u32;
            let level = self.add_group(members, round, lod_sphere, error_metres) + 1;
            for triangles in clusters {
                pool.push(self.clusters.len() as u32);
                self.clusters.push(Cluster {
                    triangles,
                    child_group,
                    level,
                    error_metres,
                    lod_sphere,
                });
            }
        }
        pool
    }

    /// Gives the group's level.
    fn add_group(
        &mut self,
        members: Vec<u32>,
        round: u32,
        lod_sphere: Sphere,
        parent_error_metres: f32,
    ) -> u8 {
        let level = self
            .members(&members)
            .map(|cluster| cluster.level)
            .max()
            .unwrap_or(0);
        self.groups.push(Group {
            members,
            level,
            round,
            lod_sphere,
            parent_error_metres,
        });
        level
    }

    fn add_roots(&mut self, mesh: &QuantizedMesh, pool: &[u32], round: u32) {
        for members in partition(mesh, &self.clusters, pool, LARGE_GROUP_CLUSTERS) {
            let lod_sphere = bounds::lod_sphere(self.members(&members));
            self.add_group(members, round, lod_sphere, ROOT_ERROR);
        }
    }
}
