//! Back: how far the new surface of a group lies from the source.
//!
//! The distance from a point to the source is at most that to a cluster of any level and the
//! cluster's own error. So the way leads from the group's members down the DAG, nearest first, to
//! clusters whose error is small against what is known already. A point that is proved to be no
//! farther than that is not looked at further. Errors do not add up over the levels.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use foldhash::fast::RandomState;
use lodestream_format::cluster::NO_GROUP;

use super::dag::Dag;
use super::error::BuildError;
use super::shape::{FourBoxes, Shape};
use super::simplify::{CLOSE, STEP_MARGIN, Sample, Samples, closely, margin};
use super::vertex::Grids;

/// A cluster is looked at where its error is at most this share of what is known.
const USEFUL: f32 = 0.4;
/// Nothing finer is looked for where it is at most this share.
const FINE: f32 = 1.0 / 16.0;
/// A cluster that might bring a point nearer by less than this share is left out.
const NEARER: f32 = 1.0 / 32.0;
/// Samples that may be the farthest are measured first.
const LEADERS: usize = 8;
/// Triangles that are looked at closely.
const CLOSER_LOOKS: usize = 4;
/// Most clusters whose triangles are kept, and most boxes of clusters, by four, between points.
const MOST_SHAPES: usize = 512;
const MOST_BOXES: usize = 1 << 14;
const NONE: u32 = u32::MAX;

/// A cluster on the way down.
#[derive(Debug, Clone, Copy)]
struct Node {
    cluster: u32,
    /// Group that it was made from, or `NO_GROUP`.
    child: u32,
    /// Place of that group in `families`, once looked up.
    family: u32,
    /// Bound of its distance to the source, units.
    error: f32,
    /// Place of its triangles in `shapes`, once read.
    shape: u32,
    /// Number of the point that last looked at it.
    seen: u32,
}

/// Clusters of one group.
#[derive(Debug, Clone, Copy)]
struct Family {
    /// First and last of their boxes.
    boxes: [u32; 2],
    /// Number of the point that last looked at it.
    seen: u32,
}

/// Kept between groups; nothing of it tells of the group before.
#[derive(Debug, Default)]
pub(super) struct Back {
    boxes: Vec<FourBoxes>,
    /// Four for each of the boxes.
    nodes: Vec<Node>,
    families: Vec<Family>,
    family_of: HashMap<u32, u32, RandomState>,
    /// The first `read` hold clusters of this group.
    shapes: Vec<Shape>,
    read: usize,
    /// Clusters that wait, by the distance that each promises.
    queue: BinaryHeap<Reverse<(u32, u32, u32)>>,
    /// The node that was nearest last.
    near: u32,
    point: u32,
    /// Largest errors of clusters that are looked at, and that are fine enough, units.
    useful: f32,
    fine: f32,
    indices: Vec<[i32; 3]>,
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u8; 4]>,
}

/// Inputs of the way down.
#[derive(Clone, Copy)]
struct Below<'a> {
    dag: &'a Dag,
    members: &'a [u32],
    samples: &'a Samples,
    metres_a_unit: f64,
}

impl Back {
    /// Distance of the new surface from the source, metres, with what lies between the samples; 0
    /// where it is not above `known_metres`, to which the replacement's error comes anyway.
    pub fn measure(
        &mut self,
        dag: &Dag,
        grids: &Grids,
        members: &[u32],
        samples: &Samples,
        known_metres: f64,
    ) -> Result<f64, BuildError> {
        if samples.points.is_empty() {
            return Ok(0.0);
        }
        let metres_a_unit = samples.unit as f64 * grids.step_metres();
        let below = Below {
            dag,
            members,
            samples,
            metres_a_unit,
        };
        let known = (known_metres / metres_a_unit / STEP_MARGIN) as f32;
        self.useful = USEFUL * known;
        self.fine = FINE * known;
        self.start(below);
        let farthest = self.farthest(below, known)?;
        match farthest > known {
            true => Ok(margin(farthest as f64, STEP_MARGIN) * metres_a_unit),
            false => Ok(0.0),
        }
    }

    /// Largest distance of the samples and of points round the farthest ones, or `known`.
    fn farthest(&mut self, below: Below, known: f32) -> Result<f32, BuildError> {
        let Samples {
            points, triangles, ..
        } = below.samples;
        let mut first: Vec<u32> = (0..points.len() as u32).collect();
        let key = |&number: &u32| (Reverse(points[number as usize].most.to_bits()), number);
        let leaders = LEADERS.min(first.len());
        first.select_nth_unstable_by_key(leaders - 1, key);
        first.truncate(leaders);
        first.sort_unstable_by_key(key);
        let others = (0..points.len() as u32).filter(|number| !first.contains(number));
        let mut worst = known;
        let mut highest: Vec<(f32, u32)> = Vec::new();
        for number in first.iter().copied().chain(others) {
            let Sample { at, most, triangle } = points[number as usize];
            if most <= CLOSE * worst {
                continue;
            }
            let distance = self.distance(below, at, most, CLOSE * worst)?;
            worst = worst.max(distance);
            match highest.last_mut().filter(|last| last.1 == triangle) {
                Some(last) => last.0 = last.0.max(distance),
                None => highest.push((distance, triangle)),
            }
        }
        highest.retain(|&(distance, _)| distance > CLOSE * worst);
        highest
            .sort_unstable_by_key(|&(distance, triangle)| (Reverse(distance.to_bits()), triangle));
        for &(_, triangle) in highest.iter().take(CLOSER_LOOKS) {
            for at in closely(triangles[triangle as usize]) {
                worst = worst.max(self.distance(below, at, f32::INFINITY, worst)?);
            }
        }
        Ok(worst)
    }

    /// Forgets everything but the group's members.
    fn start(&mut self, below: Below) {
        self.boxes.clear();
        self.nodes.clear();
        self.families.clear();
        self.family_of.clear();
        self.read = 0;
        self.near = NONE;
        self.point = 0;
        self.add_family(below, below.members);
    }

    /// Adds the clusters of a group; gives their number.
    fn add_family(&mut self, below: Below, members: &[u32]) -> u32 {
        let first = self.boxes.len() as u32;
        for four in members.chunks(4) {
            let mut boxes = FourBoxes::NOTHING;
            for lane in 0..4 {
                let cluster = four.get(lane).copied().unwrap_or(NONE);
                let mut node = Node {
                    cluster,
                    child: NO_GROUP,
                    family: NONE,
                    error: 0.0,
                    shape: NONE,
                    seen: 0,
                };
                if cluster != NONE {
                    let info = &below.dag.clusters[cluster as usize];
                    let [low, high] = [info.low, info.high].map(|at| below.samples.local(at));
                    boxes.set(lane, low, high);
                    node.child = info.child_group;
                    if node.child != NO_GROUP {
                        let group = &below.dag.groups[node.child as usize];
                        node.error = (group.surface_metres as f64 / below.metres_a_unit) as f32;
                    }
                }
                self.nodes.push(node);
            }
            self.boxes.push(boxes);
        }
        let boxes = [first, self.boxes.len() as u32];
        self.families.push(Family { boxes, seen: 0 });
        self.families.len() as u32 - 1
    }

    /// Distance of a point to the source, units: never below it. One that is not above `enough`
    /// stands for every other such one. `most` is known of it.
    fn distance(
        &mut self,
        below: Below,
        at: [f32; 3],
        most: f32,
        enough: f32,
    ) -> Result<f32, BuildError> {
        if self.boxes.len() > MOST_BOXES {
            self.start(below);
        }
        self.point += 1;
        self.queue.clear();
        let mut best = most;
        if self.near != NONE {
            best = best.min(self.look_at(below, self.near, at, best, enough)?.1);
            if best <= enough {
                return Ok(best);
            }
        }
        self.enqueue(0, at, best);
        while let Some(Reverse((_, distance, number))) = self.queue.pop() {
            let mut nearest = f32::from_bits(distance);
            let Node { error, child, .. } = self.nodes[number as usize];
            if nearest - error >= best * (1.0 - NEARER) {
                continue;
            }
            if error <= self.useful || child == NO_GROUP {
                let (surface, bound) = self.look_at(below, number, at, best, enough)?;
                best = best.min(bound);
                if best <= enough {
                    return Ok(best);
                }
                nearest = nearest.max(surface);
            }
            let is_fine = error <= self.fine || child == NO_GROUP;
            if is_fine || nearest - error >= best * (1.0 - NEARER) {
                continue;
            }
            let family = self.family(below, number);
            self.enqueue(family, at, best);
        }
        Ok(best)
    }

    /// Number of the clusters that a node's cluster stands for.
    fn family(&mut self, below: Below, number: u32) -> u32 {
        let Node { child, family, .. } = self.nodes[number as usize];
        if family != NONE {
            return family;
        }
        let known = self.family_of.get(&child).copied();
        let family = known.unwrap_or_else(|| {
            let members = &below.dag.groups[child as usize].members;
            let family = self.add_family(below, members);
            self.family_of.insert(child, family);
            family
        });
        self.nodes[number as usize].family = family;
        family
    }

    /// Queues the clusters of a family that may be nearer than `best`.
    fn enqueue(&mut self, family: u32, at: [f32; 3], best: f32) {
        let family = &mut self.families[family as usize];
        if std::mem::replace(&mut family.seen, self.point) == self.point {
            return;
        }
        for four in family.boxes[0]..family.boxes[1] {
            let squared = self.boxes[four as usize].squared(at);
            for (number, squared) in (4 * four..).zip(squared) {
                let (distance, error) = (squared.sqrt(), self.nodes[number as usize].error);
                if distance.is_finite() && distance - error < best {
                    let promised = (distance + error).to_bits();
                    self.queue
                        .push(Reverse((promised, distance.to_bits(), number)));
                }
            }
        }
    }

    /// Distance of a point to a cluster, units, or one that is enough, and to the source through
    /// it.
    fn look_at(
        &mut self,
        below: Below,
        number: u32,
        at: [f32; 3],
        best: f32,
        enough: f32,
    ) -> Result<(f32, f32), BuildError> {
        let node = &mut self.nodes[number as usize];
        if std::mem::replace(&mut node.seen, self.point) == self.point {
            return Ok((0.0, f32::INFINITY));
        }
        if node.shape == NONE {
            self.read(below, number)?;
        }
        let Node { error, shape, .. } = self.nodes[number as usize];
        let [enough, most] = [enough, best].map(|own| (own - error).max(0.0).powi(2));
        let surface = self.shapes[shape as usize].nearest(at, enough, most).sqrt();
        let bound = surface + error;
        if bound < best {
            self.near = number;
        }
        Ok((surface, bound))
    }

    /// Reads the triangles of a cluster.
    fn read(&mut self, below: Below, number: u32) -> Result<(), BuildError> {
        if self.read == MOST_SHAPES {
            self.read = 0;
            self.nodes.iter_mut().for_each(|node| node.shape = NONE);
        }
        if self.read == self.shapes.len() {
            self.shapes.push(Shape::default());
        }
        let node = &mut self.nodes[number as usize];
        below
            .dag
            .shape(node.cluster, &mut self.indices, &mut self.triangles)?;
        self.positions.clear();
        let local = |&index: &[i32; 3]| below.samples.local(index);
        self.positions.extend(self.indices.iter().map(local));
        self.shapes[self.read].set(&self.positions, &self.triangles);
        node.shape = self.read as u32;
        self.read += 1;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
