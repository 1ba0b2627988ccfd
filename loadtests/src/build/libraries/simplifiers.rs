//! Groups to half: ours, and meshoptimizer's simplifier in its two ways, on the groups of level 0 at the count that ours reached.
//!
//! Theirs see positions alone, with the group's border locked; ours weighed normals and texture coordinates too.

use std::collections::HashMap;
use std::time::Instant;

use lodestream_server::build::TriangleTree;
use meshopt::{SimplifyOptions, SimplifyVertex, VertexDataAdapter};
use serde::Serialize;

#[cfg(test)]
use super::clusters::edges;
use crate::build::dag::ClusterDag;
use crate::build::distance::{Distance, one_way};

/// Groups that are measured, evenly spread.
const MOST_GROUPS: usize = 200;

/// Groups thinned out by one library.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SimplifierRow {
    /// The input.
    pub input: String,
    /// Who thinned them out.
    pub by: &'static str,
    /// Groups.
    pub groups: u64,
    /// Their triangles.
    pub triangles: u64,
    /// Triangles that were left.
    pub left: u64,
    /// Geometric mean over groups of the largest distance to the group's source over ours, both ways; what is less than a
    /// position step counts as one.
    pub max_ratio: f64,
    /// The same for the root mean square.
    pub rms_ratio: f64,
    /// Seconds on one thread. Of ours the share by triangles of all levels' time, with partition, bounds and clusters in it.
    pub secs: f64,
}

struct Group {
    places: Vec<[f32; 3]>,
    source: Vec<[u32; 3]>,
    ours: Vec<[u32; 3]>,
    /// On the border to other groups.
    locked: Vec<bool>,
}

/// Triangles of another surface, over places of its own.
type Surface = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// A simplifier, and its name.
type Simplifier = (&'static str, fn(&Group) -> Surface);

/// Ours, then theirs; `grow_secs` is what all our levels took together.
pub fn rows(input: &str, dag: &ClusterDag, step_metres: f64, grow_secs: f64) -> Vec<SimplifierRow> {
    let groups = groups(dag);
    let triangles: usize = groups.iter().map(|group| group.source.len()).sum();
    let simplified = dag.clusters.iter().filter(|cluster| {
        let group = &dag.groups[cluster.group as usize];
        !group.is_root()
    });
    let simplified: u64 = simplified.map(|cluster| u64::from(cluster.count)).sum();
    let ours: Vec<Distance> = groups
        .iter()
        .map(|group| group.distance(&(group.places.clone(), group.ours.clone())))
        .collect();
    let of = |by, left: usize, distances: &[Distance], secs| SimplifierRow {
        input: input.into(),
        by,
        groups: groups.len() as u64,
        triangles: triangles as u64,
        left: left as u64,
        max_ratio: mean_ratio(distances, &ours, |it| it.max_metres, step_metres),
        rms_ratio: mean_ratio(distances, &ours, |it| it.rms_metres, step_metres),
        secs,
    };
    let kept = groups.iter().map(|group| group.ours.len()).sum();
    let own_secs = grow_secs * triangles as f64 / simplified.max(1) as f64;
    let mut rows = vec![of("lodestream", kept, &ours, own_secs)];
    let theirs: [Simplifier; 2] = [("meshopt subset", subset), ("meshopt update", update)];
    for (by, simplify) in theirs {
        let start = Instant::now();
        let made: Vec<Surface> = groups.iter().map(simplify).collect();
        let secs = start.elapsed().as_secs_f64();
        let all = groups.iter().zip(&made);
        let distances: Vec<Distance> = all
            .map(|(group, surface)| group.distance(surface))
            .collect();
        let left = made.iter().map(|(_, triangles)| triangles.len()).sum();
        rows.push(of(by, left, &distances, secs));
    }
    match groups.is_empty() {
        true => Vec::new(),
        false => rows,
    }
}

/// Groups of source clusters that have a replacement, with places of their own.
fn groups(dag: &ClusterDag) -> Vec<Group> {
    let chosen: Vec<usize> = (0..dag.groups.len())
        .filter(|&group| {
            let group = &dag.groups[group];
            let mut members = group.members.iter();
            !group.replacement.is_empty()
                && members.all(|&it| dag.clusters[it as usize].child_group.is_none())
        })
        .collect();
    let stride = chosen.len().div_ceil(MOST_GROUPS).max(1);
    let mut used: HashMap<u32, u32> = HashMap::new();
    for cluster in dag.level_cut(0) {
        let group = dag.clusters[cluster as usize].group;
        for &place in dag.triangles_of(cluster).as_flattened() {
            // A place of several groups belongs to none.
            let owner = used.entry(place).or_insert(group);
            *owner = if *owner == group { group } else { u32::MAX };
        }
    }
    let mut groups = Vec::new();
    for index in chosen.into_iter().step_by(stride) {
        let group = &dag.groups[index];
        let mut local: HashMap<u32, u32> = HashMap::new();
        let (mut places, mut locked) = (Vec::new(), Vec::new());
        let mut localised = |clusters: &[u32]| -> Vec<[u32; 3]> {
            let triangles = dag.gather(clusters.iter().copied()).into_iter();
            triangles
                .map(|corners| {
                    corners.map(|place| {
                        *local.entry(place).or_insert_with(|| {
                            places.push(dag.places[place as usize]);
                            locked.push(used.get(&place) == Some(&u32::MAX));
                            places.len() as u32 - 1
                        })
                    })
                })
                .collect()
        };
        let (source, ours) = (localised(&group.members), localised(&group.replacement));
        groups.push(Group {
            places,
            source,
            ours,
            locked,
        });
    }
    groups
}

impl Group {
    fn distance(&self, (places, triangles): &Surface) -> Distance {
        let source = TriangleTree::new(&self.places, &self.source);
        let there = one_way(places, triangles, &source, usize::MAX);
        let surface = TriangleTree::new(places, triangles);
        let back = one_way(&self.places, &self.source, &surface, usize::MAX);
        there.worse(back)
    }
}

fn subset(group: &Group) -> Surface {
    let positions = meshopt::typed_to_bytes(&group.places);
    let Ok(vertices) = VertexDataAdapter::new(positions, size_of::<[f32; 3]>(), 0) else {
        unreachable!("twelve bytes a place")
    };
    let left = meshopt::simplify_with_locks(
        group.source.as_flattened(),
        &vertices,
        &group.locked,
        3 * group.ours.len(),
        f32::MAX,
        SimplifyOptions::ErrorAbsolute,
        None,
    );
    (group.places.clone(), left.as_chunks::<3>().0.to_vec())
}

fn update(group: &Group) -> Surface {
    let mut places = group.places.clone();
    let mut indices = group.source.as_flattened().to_vec();
    let locks: Vec<SimplifyVertex> = group
        .locked
        .iter()
        .map(|&locked| match locked {
            true => SimplifyVertex::Lock,
            false => SimplifyVertex::None,
        })
        .collect();
    let left = meshopt::simplify_with_update(
        &mut indices,
        &mut places,
        &mut [],
        &[],
        0,
        Some(&locks),
        3 * group.ours.len(),
        f32::MAX,
        SimplifyOptions::ErrorAbsolute,
        None,
    );
    indices.truncate(left);
    (places, indices.as_chunks::<3>().0.to_vec())
}

fn mean_ratio(
    theirs: &[Distance],
    ours: &[Distance],
    of: fn(&Distance) -> f64,
    step_metres: f64,
) -> f64 {
    let logs = theirs.iter().zip(ours).map(|(theirs, ours)| {
        let [theirs, ours] = [theirs, ours].map(|it| of(it).max(step_metres));
        (theirs / ours).ln()
    });
    (logs.sum::<f64>() / ours.len().max(1) as f64).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::inputs::Generated;
    use lodestream_server::build::{BuildOptions, build};

    #[test]
    fn theirs_keep_the_border_and_reach_the_count() {
        let Ok(torus) = "torus:8000".parse::<Generated>() else {
            panic!("a shape and a count");
        };
        let built = build(torus.mesh(), &BuildOptions::default()).unwrap();
        let dag = ClusterDag::of_asset(&built).unwrap();
        let groups = groups(&dag);
        assert!(groups.len() > 1);
        for group in &groups {
            assert!(group.locked.contains(&true) && group.locked.contains(&false));
            for simplify in [subset, update] {
                let (places, triangles) = simplify(group);
                assert!(triangles.len() <= group.ours.len() + 2);
                let used: Vec<u32> = triangles.as_flattened().to_vec();
                let border = edges(&group.source)
                    .filter(|edge| edge.iter().all(|&it| group.locked[it as usize]));
                for place in border.flatten().filter(|place| used.contains(place)) {
                    let (now, before) = (places[place as usize], group.places[place as usize]);
                    assert_eq!(now, before);
                }
            }
        }
        let rows = rows("torus", &dag, built.asset.position_grid.step(), 1.0);
        assert_eq!((rows[0].max_ratio, rows[0].rms_ratio), (1.0, 1.0));
        assert!(rows.iter().all(|row| row.rms_ratio > 0.3), "{rows:?}");
    }
}
