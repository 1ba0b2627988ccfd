//! Simplify: a group's triangles to fewer, as far as its budget goes, what it shares with other
//! groups untouched.

mod attributes;
mod budget;
mod collapse;
mod cost;
mod group;
mod material;
mod merge;
mod nearest;
mod pairs;
mod parts;
mod placement;
mod quadric;
mod queue;
mod samples;
mod setup;
mod witness;

use super::back::Back;
use super::borders::OPEN;
use super::cluster::{ClusterView, Witness};
use super::clusterize::{Clusterizer, Clusters, Surface};
use super::measure;
use super::vertex::Grids;
use collapse::Collapser;
use group::{GroupMesh, Weights, attribute_count};
pub(super) use nearest::{Four, gather, to_triangles};
use parts::{Limits, Thinner};
use quadric::{cross, dot, sub};
pub(super) use samples::{CLOSE, Sample, Samples, closely};
pub(super) use witness::HANDED_ON;
use witness::{Court, Testimony};

/// A result with more of the triangles left is not worth a level.
const MOST_LEFT: f64 = 0.85;
/// Share of the triangles that a round leaves at least.
const LEAST_LEFT: f64 = 0.25;
/// Sweeps over the edges of a group at most.
const MOST_SWEEPS: usize = 4;
/// Another sweep follows one that left at most this share of the triangles.
const WORTH_A_SWEEP: f64 = 0.98;
/// What the farthest witness stands for: some point between the witnesses lies farther.
const MARGIN: f64 = 1.25;
/// The same for the new surface, which is sampled where it is loose.
pub(super) const STEP_MARGIN: f64 = 1.25;
/// Share of the group's size that rounding in f32 may hide.
const ROUNDING: f64 = 1.0 / (1 << 22) as f64;
/// Triangles of a full cluster.
const FULL: usize = lodestream_format::limits::MAX_CLUSTER_TRIANGLES;

/// Where the vertices of coarser levels may lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Placement {
    /// Where their quadric is least: fewer triangles for an error.
    #[default]
    Optimal,
    /// On vertices of the source: they compress to less.
    Subset,
}

impl Placement {
    /// Its name as an option.
    pub fn name(self) -> &'static str {
        match self {
            Self::Optimal => "optimal",
            Self::Subset => "subset",
        }
    }
}

impl std::str::FromStr for Placement {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        [Self::Optimal, Self::Subset]
            .into_iter()
            .find(|placement| placement.name() == name)
            .ok_or_else(|| format!("expected optimal or subset, found {name:?}"))
    }
}

/// A group's replacement.
#[derive(Debug)]
pub(super) struct Simplified {
    pub clusters: Clusters,
    /// Distance of the source from the new surface, metres.
    pub distance_metres: f64,
    /// Points of the new surface that may be farther from the source than that.
    pub samples: Samples,
    /// Distance of parts of the group that vanished from what is left, metres.
    pub lost_metres: f64,
    /// Error of normals, texture coordinates and colours, metres.
    pub attribute_metres: f64,
    /// Error of materials, metres.
    pub material_metres: f64,
    /// Whether open edges of the surface moved.
    pub open_edges_moved: bool,
}

/// What a simplification needs beside the group.
#[derive(Debug, Clone, Copy)]
pub(super) struct Job<'a> {
    pub grids: &'a Grids,
    pub placement: Placement,
    /// Level of the clusters that come out.
    pub level: u8,
    /// Distance that each cluster may have from the source, metres.
    pub members_metres: &'a [f32],
    /// Vertex clustering is allowed where collapses do not get further.
    pub merge: bool,
    /// Distance that the source may have from the result, metres; infinite where any is allowed.
    pub budget_metres: f64,
}

/// Everything that is kept between groups of a thread.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    mesh: GroupMesh,
    plain: Collapser<0>,
    four: Collapser<1>,
    eight: Collapser<2>,
    twelve: Collapser<3>,
    court: Court,
    thinner: Thinner,
    origins: Vec<[f32; 3]>,
    clusterizer: Clusterizer,
    /// Measures what comes out.
    pub back: Back,
}

impl Workspace {
    /// Distance, metres, that nine tenths of the places of a group keep to when half of its
    /// triangles go.
    pub fn typical_metres<'a>(
        &mut self,
        job: &Job,
        clusters: impl Iterator<Item = (ClusterView<'a>, &'a [u8])> + Clone,
    ) -> f64 {
        self.mesh.gather(clusters);
        let (mesh, court) = (&mut self.mesh, &mut self.court);
        let target = target(mesh.triangles.len(), job.budget_metres);
        let distance = match attribute_count(job.grids.attributes) {
            0 => typical(&mut self.plain, mesh, court, job, target),
            1..=4 => typical(&mut self.four, mesh, court, job, target),
            5..=8 => typical(&mut self.eight, mesh, court, job, target),
            _ => typical(&mut self.twelve, mesh, court, job, target),
        };
        distance * mesh.unit as f64 * job.grids.step_metres()
    }

    /// Triangles of a group, and those left within its budget.
    pub fn counts<'a>(
        &mut self,
        job: &Job,
        clusters: impl Iterator<Item = (ClusterView<'a>, &'a [u8])> + Clone,
    ) -> [usize; 2] {
        let start = self.start(job, clusters);
        let limits = start.limits(job);
        let mesh = &self.mesh;
        let left = match attribute_count(job.grids.attributes) {
            0 => left(&mut self.plain, mesh, job, &limits),
            1..=4 => left(&mut self.four, mesh, job, &limits),
            5..=8 => left(&mut self.eight, mesh, job, &limits),
            _ => left(&mut self.twelve, mesh, job, &limits),
        };
        [mesh.gathered.len(), left]
    }

    /// Gathers a group and lets its small parts stand for each other.
    fn start<'a>(
        &mut self,
        job: &Job,
        clusters: impl Iterator<Item = (ClusterView<'a>, &'a [u8])> + Clone,
    ) -> Start {
        self.mesh.gather(clusters);
        let metres = self.mesh.unit as f64 * job.grids.step_metres();
        let members = job.members_metres.iter();
        let start = Start {
            metres,
            members: members.map(|&own| (own as f64 / metres) as f32).collect(),
            target: target(self.mesh.triangles.len(), job.budget_metres),
        };
        self.origins.clear();
        self.origins.extend_from_slice(&self.mesh.positions);
        let limits = start.limits(job);
        self.thinner.start(&self.mesh, limits.budget);
        let attributes = job.grids.attributes;
        self.thinner.thin(&mut self.mesh, &limits, attributes);
        start
    }

    /// Halves a group, or gives `None` where nothing allowed removes enough.
    pub fn simplify<'a>(
        &mut self,
        job: &Job,
        clusters: impl Iterator<Item = (ClusterView<'a>, &'a [u8])> + Clone,
    ) -> Option<Simplified> {
        let start = self.start(job, clusters.clone());
        let limits = start.limits(job);
        let Self {
            mesh,
            plain,
            four,
            eight,
            twelve,
            court,
            thinner,
            origins,
            clusterizer,
            ..
        } = self;
        let result = match attribute_count(job.grids.attributes) {
            0 => collapse(plain, mesh, court, thinner, origins, job, &limits),
            1..=4 => collapse(four, mesh, court, thinner, origins, job, &limits),
            5..=8 => collapse(eight, mesh, court, thinner, origins, job, &limits),
            _ => collapse(twelve, mesh, court, thinner, origins, job, &limits),
        };
        let result = match result {
            Some(result) => result,
            None if job.merge => {
                // Cells take parts as they were.
                mesh.gather(clusters);
                merged(mesh, limits.members, limits.target)?
            }
            None => return None,
        };
        let surface = Surface {
            vertices: &mesh.welder.vertices,
            place_of: &mesh.welder.place_of,
            place_count: mesh.welder.place_count(),
            triangles: &result.triangles,
            witnesses: &result.witnesses,
        };
        Some(Simplified {
            clusters: clusterizer.clusterize(&surface, job.level),
            distance_metres: result.distance * start.metres,
            samples: result.samples,
            lost_metres: result.lost * start.metres,
            attribute_metres: result.attribute * start.metres,
            material_metres: result.material * start.metres,
            open_edges_moved: result.open_edges_moved,
        })
    }
}

/// Triangles at which the collapses end: half of all, or a quarter where a budget ends most of them
/// earlier, as a number of full clusters where one is near.
fn target(triangles: usize, budget_metres: f64) -> usize {
    let share = match budget_metres.is_finite() {
        true => LEAST_LEFT,
        false => 0.5,
    };
    let wanted = triangles as f64 * share;
    let full = (wanted / FULL as f64).round().max(1.0) * FULL as f64;
    match full <= 1.15 * wanted {
        true => full as usize,
        false => (wanted as usize).max(1),
    }
}

/// Triangles over the group's vertices, lengths in units.
struct Outcome {
    triangles: Vec<[u32; 3]>,
    witnesses: Vec<Witness>,
    distance: f64,
    samples: Samples,
    lost: f64,
    attribute: f64,
    material: f64,
    open_edges_moved: bool,
}

/// A measured distance with what the samples may have missed, `share` of it.
pub(super) fn margin(distance: f64, share: f64) -> f64 {
    match distance > 0.0 {
        true => distance * share + ROUNDING,
        false => 0.0,
    }
}

fn typical<const L: usize>(
    state: &mut Collapser<L>,
    mesh: &mut GroupMesh,
    court: &mut Court,
    job: &Job,
    target: usize,
) -> f64 {
    let edge = mesh.typical_edge(&mesh.triangles);
    let weights = mesh.weights(job.grids, edge);
    state.start(mesh, job.grids, &weights);
    state.budget.start(mesh, f32::INFINITY);
    state.run(mesh, target, true);
    let mut distances = court.distances(state, mesh);
    distances.sort_by(f32::total_cmp);
    let at = distances.len() * 9 / 10;
    distances.get(at).copied().unwrap_or(0.0) as f64
}

/// A group's scale and the limits of its simplification.
struct Start {
    /// Metres of a unit.
    metres: f64,
    /// Distance that each cluster may have from the source, units.
    members: Vec<f32>,
    target: usize,
}

impl Start {
    fn limits(&self, job: &Job) -> Limits<'_> {
        Limits {
            budget: job.budget_metres / self.metres,
            members: &self.members,
            target: self.target,
        }
    }
}

/// Collapses within the limits until a sweep brings little.
fn sweep<const L: usize>(
    state: &mut Collapser<L>,
    mesh: &GroupMesh,
    job: &Job,
    limits: &Limits,
) -> Weights {
    let edge = mesh.typical_edge(&mesh.triangles);
    let weights = mesh.weights(job.grids, edge);
    state.start(mesh, job.grids, &weights);
    state.budget.start(mesh, limits.budget as f32);
    let mut left = mesh.triangles.len();
    // Within a budget another sweep finds next to nothing: its place is the next round.
    let sweeps = if state.budget.is_limited() {
        1
    } else {
        MOST_SWEEPS
    };
    for sweep in 0..sweeps {
        state.run(mesh, limits.target, sweep == 0);
        // A refused collapse may be allowed now that its neighbours have moved.
        if state.live <= limits.target || state.live as f64 > WORTH_A_SWEEP * left as f64 {
            break;
        }
        left = state.live;
    }
    weights
}

/// Triangles left within the limits.
fn left<const L: usize>(
    state: &mut Collapser<L>,
    mesh: &GroupMesh,
    job: &Job,
    limits: &Limits,
) -> usize {
    sweep(state, mesh, job, limits);
    state.live
}

fn collapse<const L: usize>(
    state: &mut Collapser<L>,
    mesh: &mut GroupMesh,
    court: &mut Court,
    thinner: &mut Thinner,
    origins: &[[f32; 3]],
    job: &Job,
    limits: &Limits,
) -> Option<Outcome> {
    let before = mesh.triangles.len();
    let weights = sweep(state, mesh, job, limits);
    if state.live as f64 > MOST_LEFT * mesh.gathered.len() as f64 || state.live == 0 {
        return None;
    }
    if job.placement == Placement::Optimal {
        placement::place(state, mesh, job.grids, &weights);
    }
    thinner.regrow(mesh, state, limits);
    let Testimony {
        distance,
        samples,
        lost,
        mut witnesses,
    } = court.hear(state, mesh, origins, limits.members);
    thinner.hand_on(mesh, state, &mut witnesses);
    let live: Vec<[u16; 3]> = (0..before)
        .filter(|&triangle| state.alive[triangle])
        .map(|triangle| state.corners[triangle])
        .collect();
    let moved = material::outlines_moved(mesh, origins, &live, mesh.typical_edge(&live));
    let lost_material = material::lost(mesh, origins, &live);
    let attribute = attributes::deviation(state, mesh, &live);
    Some(Outcome {
        triangles: live.iter().map(|corners| corners.map(u32::from)).collect(),
        witnesses,
        distance: margin(distance as f64, MARGIN),
        samples,
        lost: margin(f64::max(lost as f64, thinner.lost), MARGIN),
        attribute: attribute as f64,
        material: moved.max(lost_material) as f64,
        open_edges_moved: state.open_moved || thinner.open_moved,
    })
}

/// Vertex clustering, for loose parts and tangled topology. It knows nothing of
/// attributes and materials: all of them may be wrong, over a triangle each.
fn merged(mesh: &GroupMesh, members: &[f32], target: usize) -> Option<Outcome> {
    let (triangles, moved_to) = merge::merge(mesh, target);
    if triangles.is_empty() || triangles.len() as f64 > MOST_LEFT * mesh.triangles.len() as f64 {
        return None;
    }
    let at = |triangles: &[[u16; 3]]| -> Vec<[u32; 3]> {
        triangles
            .iter()
            .map(|&triangle| mesh.places(triangle).map(|place| place as u32))
            .collect()
    };
    let after = at(&triangles);
    let step = measure::distance(&mesh.positions, &at(&mesh.triangles), &after, 0.0);
    let (witnesses, farthest) = witness::after_merge(mesh, &after, &moved_to);
    let most = members.iter().copied().fold(0.0, f32::max);
    let size = mesh.typical_edge(&triangles) as f64;
    let open_moved = |(vertex, &to): (usize, &u16)| {
        to as usize != vertex && mesh.rules[mesh.welder.place_of[vertex] as usize] == OPEN
    };
    Some(Outcome {
        attribute: size,
        material: size,
        distance: margin(step.max(farthest), MARGIN),
        samples: Samples::of(mesh, &triangles, step as f32 + most),
        lost: margin(step, MARGIN),
        witnesses,
        triangles: triangles
            .iter()
            .map(|corners| corners.map(u32::from))
            .collect(),
        open_edges_moved: moved_to.iter().enumerate().any(open_moved),
    })
}
