//! The loop: group, simplify as far as the round's budget goes, split, until one cluster is left.

use lodestream_format::Sphere;
use lodestream_format::bounds::round_up;
use lodestream_format::cluster::NO_GROUP;
use lodestream_format::hierarchy::ROOT_ERROR;
use lodestream_format::limits::MAX_LEVELS;
use lodestream_format::proxy::Proxy;
use rayon::prelude::*;

use super::borders::{Borders, ChunkBounds};
use super::bounds::{self, Term, Terms};
use super::budgets::Budgets;
use super::cluster::{self, Birth, ClusterInfo, ClusterView};
use super::error::BuildError;
use super::neighbours::FixedPlaces;
use super::packed::{Packed, unpack, unpack_shape};
use super::partition::{self, LARGE_GROUP_CLUSTERS, USUAL_GROUP_CLUSTERS, chunks};
use super::proxy;
use super::simplify::{Job, Placement, Workspace};
use super::store::Store;
use super::vertex::Grids;

/// A round that leaves more of the triangles than this made no headway.
const NO_HEADWAY: f64 = 0.95;
/// Triangles of the coarsest cut: levels go on below one cluster, so that a far instance of a few
/// pixels costs as many triangles.
const COARSEST_TRIANGLES: u64 = 16;
/// Clusters read at a time where the look of a cut is measured.
const PROXY_CHUNK: usize = 256;
/// A group whose error is more than this times its budget waits for a larger one.
const MOST_OVER: f64 = 3.0;

/// Clusters that are refined together.
#[derive(Debug)]
pub(super) struct Group {
    /// Clusters that it holds.
    pub members: Vec<u32>,
    /// Largest level of its clusters.
    pub level: u8,
    /// Number of the round that made it. Groups that hold what this one became have larger numbers.
    pub round: u32,
    pub lod_sphere: Sphere,
    pub parent_error_metres: f32,
    /// Distance of the group's replacement from the source at most, metres.
    pub surface_metres: f32,
    /// Largest term of the error; `None` where nothing replaces the group.
    pub term: Option<Term>,
}

/// Every cluster and every group of an asset.
#[derive(Debug)]
pub(super) struct Dag {
    pub store: Store,
    pub clusters: Vec<ClusterInfo>,
    pub groups: Vec<Group>,
    /// Groups whose replacement moved open edges of the source.
    pub groups_with_moved_open_edges: usize,
}

/// What a round may do. Each is tried only after the one before made no headway.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Effort {
    Usual,
    /// Other, larger groups: what is stuck at one border may be free inside another. Near parts may merge.
    LargeGroups,
}

/// What stays the same over all rounds.
#[derive(Clone, Copy)]
pub(super) struct Plan<'a> {
    pub grids: &'a Grids,
    pub placement: Placement,
    /// Places that other meshes share.
    pub fixed: &'a FixedPlaces,
    /// Called with the source triangles' worth of work that is done.
    pub on_triangles: &'a (dyn Fn(u64) + Sync),
}

impl Dag {
    /// No cluster yet.
    pub fn new(store: Store) -> Self {
        Self {
            store,
            clusters: Vec::new(),
            groups: Vec::new(),
            groups_with_moved_open_edges: 0,
        }
    }

    /// Appends clusters; gives the number of the first.
    pub fn add(&mut self, made: Packed, child_group: u32) -> Result<u32, BuildError> {
        let first = self.clusters.len() as u32;
        let blob = self.store.put(made.words)?;
        self.clusters
            .extend(made.infos.into_iter().map(|info| ClusterInfo {
                blob,
                child_group,
                ..info
            }));
        Ok(first)
    }

    /// Adds levels over the leaves until one small cluster is left or nothing gets further. The same
    /// leaves give the same DAG, whatever the thread count. Returns the proxy of the first cut that
    /// is coarse enough for it.
    pub fn grow(&mut self, plan: Plan) -> Result<Proxy, BuildError> {
        let mut pool: Vec<u32> = (0..self.clusters.len() as u32).collect();
        let mut effort = Effort::Usual;
        let mut round = 0;
        let mut budgets = Budgets::of(self, plan, &pool)?;
        let mut look: Option<Proxy> = None;
        while pool.len() > 1 || self.triangles_of(&pool) > COARSEST_TRIANGLES {
            let before = self.triangles_of(&pool);
            if before <= proxy::MOST_TRIANGLES && look.is_none() {
                look = Some(self.proxy(plan, &pool)?);
            }
            let first_group = self.groups.len();
            pool = self.round(plan, &pool, round, effort, budgets.metres())?;
            if let Some(look) = &look {
                let cover_metres = proxy::cover_metres(look, &self.proxy(plan, &pool)?);
                for group in &mut self.groups[first_group..] {
                    group.parent_error_metres = group.parent_error_metres.max(cover_metres);
                }
            }
            round += 1;
            let left = self.triangles_of(&pool) as f64 / before as f64;
            if budgets.is_limited() {
                budgets.advance(left);
                continue;
            }
            if left > NO_HEADWAY {
                if effort == Effort::LargeGroups {
                    break;
                }
                effort = Effort::LargeGroups;
            }
        }
        let look = match look {
            Some(look) => look,
            None => self.proxy(plan, &pool)?,
        };
        self.add_roots(plan, &pool, round)?;
        for group in &mut self.groups {
            let error_metres = &mut group.parent_error_metres;
            *error_metres = bounds::with_rounding(*error_metres, plan.grids);
        }
        Ok(look)
    }

    fn proxy(&self, plan: Plan, pool: &[u32]) -> Result<Proxy, BuildError> {
        let mut triangles = Vec::new();
        for some in pool.chunks(PROXY_CHUNK) {
            for part in self.parts(some)? {
                triangles.extend(proxy::triangles(plan.grids, ClusterView::new(&part)));
            }
        }
        Ok(proxy::measure(&triangles))
    }

    fn triangles_of(&self, pool: &[u32]) -> u64 {
        let count = |&cluster: &u32| self.clusters[cluster as usize].triangle_count as u64;
        pool.iter().map(count).sum()
    }

    /// Groups the clusters of `pool` and replaces what can be replaced; gives the clusters of the next round.
    fn round(
        &mut self,
        plan: Plan,
        pool: &[u32],
        round: u32,
        effort: Effort,
        budget_metres: f64,
    ) -> Result<Vec<u32>, BuildError> {
        let chunks = chunks(&self.clusters, pool, round);
        let bounds: Vec<ChunkBounds> = chunks
            .iter()
            .map(|chunk| partition::bounds(&self.clusters, chunk))
            .collect();
        let mut next = Vec::new();
        let numbered: Vec<usize> = (0..chunks.len()).collect();
        // A few at a time: what is in memory does not grow with the mesh.
        for window in numbered.chunks(2 * rayon::current_num_threads()) {
            let replaced: Vec<_> = window
                .par_iter()
                .map(|&number| {
                    let others: Vec<ChunkBounds> = (0..bounds.len())
                        .filter(|&other| other != number && bounds[other].meets(&bounds[number]))
                        .map(|other| bounds[other])
                        .collect();
                    self.chunk(plan, &chunks[number], &others, effort, budget_metres)
                })
                .collect::<Result<_, _>>()?;
            for (members, replacement) in replaced.into_iter().flatten() {
                self.advance(members, replacement, round, &mut next)?;
            }
        }
        Ok(next)
    }

    /// Groups of a chunk with their replacements, where they have one.
    fn chunk(
        &self,
        plan: Plan,
        chunk: &[u32],
        others: &[ChunkBounds],
        effort: Effort,
        budget_metres: f64,
    ) -> Result<Vec<(Vec<u32>, Option<Replacement>)>, BuildError> {
        let parts = self.parts(chunk)?;
        let views: Vec<ClusterView> = parts.iter().map(|part| ClusterView::new(part)).collect();
        let borders = Borders::new(&views);
        let target = match effort {
            Effort::Usual => USUAL_GROUP_CLUSTERS,
            Effort::LargeGroups => LARGE_GROUP_CLUSTERS,
        };
        let groups = partition::partition(&views, &borders, target);
        let rules = borders.rules(&groups, others, plan.fixed);
        let done = groups
            .into_par_iter()
            .map_init(Workspace::default, |workspace, group| {
                let members: Vec<u32> = group.iter().map(|&local| chunk[local as usize]).collect();
                let rules: Vec<Vec<u8>> = group
                    .iter()
                    .map(|&local| borders.rules_of(local as usize, &views[local as usize], &rules))
                    .collect();
                let views = group
                    .iter()
                    .zip(&rules)
                    .map(|(&local, rules)| (views[local as usize], &rules[..]));
                let replacement =
                    self.replacement(plan, &members, views, effort, budget_metres, workspace)?;
                Ok((members, replacement))
            });
        done.collect()
    }

    fn replacement<'a>(
        &self,
        plan: Plan,
        members: &[u32],
        views: impl Iterator<Item = (ClusterView<'a>, &'a [u8])> + Clone,
        effort: Effort,
        budget_metres: f64,
        workspace: &mut Workspace,
    ) -> Result<Option<Replacement>, BuildError> {
        let level = self.level(members);
        if level as usize + 1 >= MAX_LEVELS {
            return Ok(None);
        }
        let births: Vec<Birth> = members
            .iter()
            .map(|&member| self.birth(plan, member))
            .collect();
        let members_metres: Vec<f32> = births.iter().map(|birth| birth.surface_metres).collect();
        let job = Job {
            grids: plan.grids,
            placement: plan.placement,
            level: level + 1,
            members_metres: &members_metres,
            merge: effort == Effort::LargeGroups,
            budget_metres,
        };
        let Some(simplified) = workspace.simplify(&job, views) else {
            return Ok(None);
        };
        let lod_sphere = bounds::lod_sphere(&births);
        let lod_sphere = bounds::grown(lod_sphere, plan.grids, &simplified.clusters);
        let mut terms = Terms::new(&births, &simplified);
        let (samples, known_metres) = (&simplified.samples, terms.surface_metres());
        terms.back = workspace
            .back
            .measure(self, plan.grids, members, samples, known_metres)?;
        let error_metres = terms.error_metres(&lod_sphere);
        if budget_metres.is_finite() && error_metres > MOST_OVER * budget_metres {
            return Ok(None);
        }
        (plan.on_triangles)(self.triangles_of(members));
        Ok(Some(Replacement {
            clusters: Packed::new(&simplified.clusters),
            open_edges_moved: simplified.open_edges_moved,
            term: terms.largest(),
            birth: Birth {
                error_metres: round_up(error_metres),
                surface_metres: round_up(terms.surface_metres()),
                lod_sphere,
            },
        }))
    }

    /// Words of some clusters, as [`ClusterView`] reads them.
    pub fn parts(&self, clusters: &[u32]) -> Result<Vec<Vec<u32>>, BuildError> {
        let part = |&cluster: &u32| {
            let info = &self.clusters[cluster as usize];
            let (first, words) = (info.first_word as usize, info.words as usize);
            let packed = self.store.part(info.blob, first, words)?;
            Ok(unpack(&packed, cluster::RECORD_WORDS))
        };
        clusters.iter().map(part).collect()
    }

    /// Positions and triangles of a cluster.
    pub fn shape(
        &self,
        cluster: u32,
        positions: &mut Vec<[i32; 3]>,
        triangles: &mut Vec<[u8; 4]>,
    ) -> Result<(), BuildError> {
        let info = &self.clusters[cluster as usize];
        let (first, words) = (info.first_word as usize, info.words as usize);
        let packed = self.store.part(info.blob, first, words)?;
        unpack_shape(&packed, cluster::RECORD_WORDS, positions, triangles);
        Ok(())
    }

    /// What a cluster was born with.
    fn birth(&self, plan: Plan, cluster: u32) -> Birth {
        let info = &self.clusters[cluster as usize];
        match info.child_group {
            NO_GROUP => Birth {
                error_metres: 0.0,
                surface_metres: 0.0,
                lod_sphere: bounds::around(plan.grids, info),
            },
            child => {
                let group = &self.groups[child as usize];
                Birth {
                    error_metres: group.parent_error_metres,
                    surface_metres: group.surface_metres,
                    lod_sphere: group.lod_sphere,
                }
            }
        }
    }

    fn level(&self, members: &[u32]) -> u8 {
        let levels = members
            .iter()
            .map(|&member| self.clusters[member as usize].level);
        levels.max().unwrap_or(0)
    }

    /// Makes a group of those with a replacement; the others wait for the next round.
    fn advance(
        &mut self,
        members: Vec<u32>,
        replacement: Option<Replacement>,
        round: u32,
        next: &mut Vec<u32>,
    ) -> Result<(), BuildError> {
        let Some(replacement) = replacement else {
            next.extend(members);
            return Ok(());
        };
        self.groups_with_moved_open_edges += usize::from(replacement.open_edges_moved);
        let child_group = self.groups.len() as u32;
        self.groups.push(Group {
            level: self.level(&members),
            members,
            round,
            lod_sphere: replacement.birth.lod_sphere,
            parent_error_metres: replacement.birth.error_metres,
            surface_metres: replacement.birth.surface_metres,
            term: Some(replacement.term),
        });
        let first = self.add(replacement.clusters, child_group)?;
        next.extend(first..self.clusters.len() as u32);
        Ok(())
    }

    /// Makes groups of what is left.
    fn add_roots(&mut self, plan: Plan, pool: &[u32], round: u32) -> Result<(), BuildError> {
        for chunk in chunks(&self.clusters, pool, round) {
            let parts = self.parts(&chunk)?;
            let views: Vec<ClusterView> = parts.iter().map(|part| ClusterView::new(part)).collect();
            let groups = partition::partition(&views, &Borders::new(&views), LARGE_GROUP_CLUSTERS);
            for group in groups {
                let members: Vec<u32> = group.iter().map(|&local| chunk[local as usize]).collect();
                let births: Vec<Birth> = members
                    .iter()
                    .map(|&member| self.birth(plan, member))
                    .collect();
                self.groups.push(Group {
                    level: self.level(&members),
                    members,
                    round,
                    lod_sphere: bounds::lod_sphere(&births),
                    parent_error_metres: ROOT_ERROR,
                    term: None,
                    surface_metres: ROOT_ERROR,
                });
            }
        }
        Ok(())
    }
}

/// Clusters that replace a group.
struct Replacement {
    clusters: Packed,
    open_edges_moved: bool,
    term: Term,
    birth: Birth,
}
