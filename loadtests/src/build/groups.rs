//! Each group's promise against the truth: its stored error against the measured distance, both ways, between the
//! clusters that replace it and the source triangles that they stand for.
//!
//! Those are found by following child groups down. A child group is simplified as a whole, so the way down also reaches source
//! triangles that clusters outside the group cover: a source sample counts for the group only where no such
//! cluster is nearer than its own.

use lodestream_server::build::TriangleTree;
use rayon::prelude::*;
use serde::Serialize;

use super::dag::ClusterDag;
use super::distance::{SAMPLES, samples, stride};
use super::process::{median, quantile};

/// A stored error is an f32 that was rounded.
const ROUNDING: f64 = 1e-6;

/// One group, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroupError {
    /// Index of the group.
    pub group: u32,
    /// What the hierarchy promises.
    pub stored_metres: f64,
    /// The largest distance that was found.
    pub measured_metres: f64,
}

impl GroupError {
    /// Whether the promise holds.
    pub fn is_bounded(&self) -> bool {
        self.measured_metres <= self.stored_metres * (1.0 + ROUNDING)
    }
}

/// The groups of an asset together.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct GroupFigures {
    /// Groups with a replacement.
    pub groups: u64,
    /// Those that were measured; evenly spread where not all.
    pub measured: u64,
    /// Share of the measured groups whose stored error is at least the measured one.
    pub bounded_share: f64,
    /// Groups whose stored error is less.
    pub unbounded: u64,
    /// Largest measured / stored of those.
    pub worst_excess: f64,
    /// Groups measured below a position step: left out of the quantiles.
    pub below_step: u64,
    /// Median of stored / measured.
    pub ratio_p50: f64,
    /// 95th percentile of it.
    pub ratio_p95: f64,
}

/// Measures at most `most_groups` groups with at most about `most_samples` samples each way a group.
pub fn measure(dag: &ClusterDag, most_groups: usize, most_samples: usize) -> Vec<GroupError> {
    let replaced: Vec<u32> = (0..dag.groups.len() as u32)
        .filter(|&group| !dag.groups[group as usize].is_root())
        .collect();
    let stride = replaced.len().div_ceil(most_groups.max(1)).max(1);
    let chosen: Vec<u32> = replaced.into_iter().step_by(stride).collect();
    chosen
        .par_iter()
        .map(|&group| GroupError {
            group,
            stored_metres: dag.groups[group as usize].parent_error_metres,
            measured_metres: distance(dag, group, most_samples),
        })
        .collect()
}

/// Sums up what [`measure`] gave; `step_metres` is the position step.
pub fn figures(dag: &ClusterDag, errors: &[GroupError], step_metres: f64) -> GroupFigures {
    let unbounded: Vec<&GroupError> = errors.iter().filter(|it| !it.is_bounded()).collect();
    let ratios: Vec<f64> = errors
        .iter()
        .filter(|it| it.measured_metres >= step_metres)
        .map(|it| it.stored_metres / it.measured_metres)
        .collect();
    GroupFigures {
        groups: dag.groups.iter().filter(|it| !it.is_root()).count() as u64,
        measured: errors.len() as u64,
        bounded_share: 1.0 - unbounded.len() as f64 / errors.len().max(1) as f64,
        unbounded: unbounded.len() as u64,
        worst_excess: unbounded
            .iter()
            .map(|it| it.measured_metres / it.stored_metres)
            .fold(0.0, f64::max),
        below_step: (errors.len() - ratios.len()) as u64,
        ratio_p50: median(ratios.iter().copied()),
        ratio_p95: quantile(ratios, 0.95),
    }
}

/// Largest distance between what replaces `group` and the source below it, both ways, metres.
fn distance(dag: &ClusterDag, group: u32, most_samples: usize) -> f64 {
    let below = Below::new(dag, group);
    let own = dag.gather(dag.groups[group as usize].replacement.iter().copied());
    let (own_tree, source_tree, other_tree) = (
        TriangleTree::new(&dag.places, &own),
        TriangleTree::new(&dag.places, &below.source),
        TriangleTree::new(&dag.places, &below.others),
    );
    let points = |triangles: &[[u32; 3]]| {
        let stride = stride(triangles.len(), most_samples);
        let mut points = Vec::with_capacity(SAMPLES * triangles.len() / stride);
        for corners in triangles.iter().step_by(stride) {
            let corners = corners.map(|place| dag.places[place as usize].map(f64::from));
            points.extend(samples(&corners).map(|(point, _)| point));
        }
        points
    };
    let mut worst = 0.0f64;
    for point in points(&own) {
        // A sample that is nearer than the worst so far needs no exact distance.
        worst = worst.max(source_tree.distance_squared(point, worst));
    }
    for point in points(&below.source) {
        let squared = own_tree.distance_squared(point, worst);
        // A search may stop at `enough`, and places on the shared border are as near to both.
        if squared > worst && other_tree.distance_squared(point, squared.next_down()) >= squared {
            worst = squared;
        }
    }
    worst.sqrt()
}

/// What lies below a group.
struct Below {
    /// Source triangles of the group and of all groups below.
    source: Vec<[u32; 3]>,
    /// Triangles of clusters outside the group that replace a part of a group below.
    others: Vec<[u32; 3]>,
}

impl Below {
    fn new(dag: &ClusterDag, group: u32) -> Self {
        let mut inside = vec![false; dag.groups.len()];
        let mut waiting = vec![group];
        let mut visited = Vec::new();
        inside[group as usize] = true;
        while let Some(next) = waiting.pop() {
            visited.push(next);
            for &member in &dag.groups[next as usize].members {
                let child = dag.clusters[member as usize].child_group;
                if let Some(child) = child.filter(|&child| !inside[child as usize]) {
                    inside[child as usize] = true;
                    waiting.push(child);
                }
            }
        }
        // The order of the walk must not show in which triangles are sampled.
        visited.sort_unstable();
        let groups = || visited.iter().map(|&it| &dag.groups[it as usize]);
        let leaves = groups().flat_map(|it| &it.members).copied();
        let leaves = leaves.filter(|&it| dag.clusters[it as usize].child_group.is_none());
        let others = visited
            .iter()
            .filter(|&&it| it != group)
            .flat_map(|&it| &dag.groups[it as usize].replacement)
            .filter(|&&it| !inside[dag.clusters[it as usize].group as usize]);
        Self {
            source: dag.gather(leaves),
            others: dag.gather(others.copied()),
        }
    }
}
