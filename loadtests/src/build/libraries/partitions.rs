//! Clusters to groups: meshoptimizer's partition (ours to choose, and chosen), METIS in both of its ways, and cuts at the
//! median along the longest side, which need no graph.

use std::collections::{BTreeMap, HashMap};
use std::time::Instant;

use meshopt::VertexDataAdapter;
use serde::Serialize;

use super::clusters::edges;
use crate::build::dag::ClusterDag;

/// What a partition aims at, and the most that a group may have, as our build.
const TARGET: usize = 16;
const MOST: usize = 32;
/// METIS balances parts to this, so that few exceed [`MOST`].
const IMBALANCE: f32 = 1.3;

/// Groups by one library.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct PartitionRow {
    /// The input.
    pub input: String,
    /// Level of the clusters.
    pub level: u32,
    /// Clusters.
    pub clusters: u64,
    /// Who grouped them.
    pub by: &'static str,
    /// Groups.
    pub groups: u64,
    /// Mean clusters of one.
    pub mean: f64,
    /// Clusters of the largest; more than 32 have to be split again.
    pub largest: u64,
    /// Groups of fewer than eight clusters: they lock much for what they hold.
    pub small: u64,
    /// Edges between groups over triangles: what a simplifier must leave alone.
    pub locked_per_triangle: f64,
    /// Seconds on one thread, the graph of the clusters aside.
    pub secs: f64,
}

/// Clusters of a level and how they meet.
struct Neighbours<'a> {
    places: &'a [[f32; 3]],
    /// Places where border edges start, cluster after cluster; at least one each.
    border: Vec<u32>,
    border_counts: Vec<u32>,
    /// Shared edges by neighbour.
    shared: Vec<BTreeMap<u32, i32>>,
    middles: Vec<[f32; 3]>,
    triangles: usize,
}

/// All libraries on the clusters of `level`; none where there are fewer than two groups' worth.
pub fn rows(input: &str, dag: &ClusterDag, level: u32) -> Vec<PartitionRow> {
    let clusters: Vec<u32> = (0..dag.clusters.len() as u32)
        .filter(|&cluster| dag.clusters[cluster as usize].level == level)
        .collect();
    if clusters.len() < 2 * MOST {
        return Vec::new();
    }
    let neighbours = Neighbours::new(dag, &clusters);
    type Partition = fn(&Neighbours) -> Vec<u32>;
    let all: [(&str, Partition); 4] = [
        ("meshopt", meshoptimizer),
        ("METIS k-way", |it| it.metis(true)),
        ("METIS recursive", |it| it.metis(false)),
        ("median cuts", median_cuts),
    ];
    all.into_iter()
        .map(|(by, partition)| {
            let start = Instant::now();
            let groups = partition(&neighbours);
            let secs = start.elapsed().as_secs_f64();
            PartitionRow {
                input: input.into(),
                level,
                by,
                secs,
                ..neighbours.row(&groups)
            }
        })
        .collect()
}

impl<'a> Neighbours<'a> {
    fn new(dag: &'a ClusterDag, clusters: &[u32]) -> Self {
        let mut owners: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
        for (index, &cluster) in (0..).zip(clusters) {
            for edge in edges(dag.triangles_of(cluster)) {
                owners.entry(edge).or_default().push(index);
            }
        }
        let mut this = Self {
            places: &dag.places,
            border: Vec::new(),
            border_counts: Vec::new(),
            shared: vec![BTreeMap::new(); clusters.len()],
            middles: Vec::new(),
            triangles: 0,
        };
        for (index, &cluster) in (0..).zip(clusters) {
            let triangles = dag.triangles_of(cluster);
            let before = this.border.len();
            for [a, b] in edges(triangles) {
                let others = owners.get(&[b, a]).map_or(&[][..], Vec::as_slice);
                let outside = others.iter().filter(|&&other| other != index);
                let mut any = others.is_empty();
                for &other in outside {
                    *this.shared[index as usize].entry(other).or_default() += 1;
                    any = true;
                }
                if any {
                    this.border.push(a);
                }
            }
            if this.border.len() == before {
                this.border.push(triangles[0][0]);
            }
            this.border_counts.push((this.border.len() - before) as u32);
            this.triangles += triangles.len();
            let corners = triangles.as_flattened().iter();
            let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
            for place in corners.map(|&place| dag.places[place as usize]) {
                for axis in 0..3 {
                    low[axis] = low[axis].min(place[axis]);
                    high[axis] = high[axis].max(place[axis]);
                }
            }
            this.middles
                .push(std::array::from_fn(|axis| 0.5 * (low[axis] + high[axis])));
        }
        // Both sides count the same, whatever a non-manifold edge did.
        for index in 0..clusters.len() {
            for (other, count) in this.shared[index].clone() {
                let back = this.shared[other as usize].entry(index as u32).or_default();
                *back = (*back).max(count);
            }
        }
        this
    }

    fn row(&self, groups: &[u32]) -> PartitionRow {
        let mut sizes: HashMap<u32, usize> = HashMap::new();
        for &group in groups {
            *sizes.entry(group).or_default() += 1;
        }
        let between = |(index, shared): (usize, &BTreeMap<u32, i32>)| {
            let apart = shared
                .iter()
                .filter(|&(&other, _)| groups[other as usize] != groups[index]);
            apart.map(|(_, &count)| i64::from(count)).sum::<i64>()
        };
        let locked: i64 = self.shared.iter().enumerate().map(between).sum();
        PartitionRow {
            clusters: groups.len() as u64,
            groups: sizes.len() as u64,
            mean: groups.len() as f64 / sizes.len() as f64,
            largest: sizes.values().max().map_or(0, |&it| it as u64),
            small: sizes.values().filter(|&&it| it < TARGET / 2).count() as u64,
            // Counted from both sides.
            locked_per_triangle: locked as f64 / 2.0 / self.triangles as f64,
            ..PartitionRow::default()
        }
    }

    /// `k_way`, or recursive bisection. Islands have no edge: METIS puts them where there is room.
    fn metis(&self, k_way: bool) -> Vec<u32> {
        let mut starts = vec![0];
        let (mut ends, mut weights) = (Vec::new(), Vec::new());
        for shared in &self.shared {
            ends.extend(shared.keys().map(|&other| other as metis::Idx));
            weights.extend(shared.values().map(|&count| count as metis::Idx));
            starts.push(ends.len() as metis::Idx);
        }
        let parts = self.shared.len().div_ceil(TARGET) as metis::Idx;
        let mut groups = vec![0; self.shared.len()];
        let graph = metis::Graph::new(1, parts, &starts, &ends)
            .expect("lists as METIS wants them")
            .set_adjwgt(&weights)
            .set_ubvec(&[IMBALANCE]);
        let cut = match k_way {
            true => graph.part_kway(&mut groups),
            false => graph.part_recursive(&mut groups),
        };
        cut.expect("memory for METIS");
        groups.into_iter().map(|group| group as u32).collect()
    }
}

fn meshoptimizer(neighbours: &Neighbours) -> Vec<u32> {
    let positions = meshopt::typed_to_bytes(neighbours.places);
    let Ok(vertices) = VertexDataAdapter::new(positions, size_of::<[f32; 3]>(), 0) else {
        unreachable!("twelve bytes a place")
    };
    let mut groups = vec![0; neighbours.border_counts.len()];
    // Places come from the DAG, so every index is inside, and the counts were taken from the list.
    meshopt::partition_clusters_with_positions(
        &mut groups,
        &neighbours.border,
        &neighbours.border_counts,
        &vertices,
        TARGET,
    );
    groups
}

fn median_cuts(neighbours: &Neighbours) -> Vec<u32> {
    fn cut(middles: &[[f32; 3]], pool: &mut [u32], groups: &mut [u32], next: &mut u32) {
        // Halves of what is just too large for one have about two thirds of the most.
        if pool.len() <= TARGET * 4 / 3 {
            for &cluster in pool.iter() {
                groups[cluster as usize] = *next;
            }
            *next += 1;
            return;
        }
        let side = |axis: usize| {
            let along = pool.iter().map(|&it| middles[it as usize][axis]);
            along.clone().fold(f32::MIN, f32::max) - along.fold(f32::MAX, f32::min)
        };
        let axis = (1..3).fold(0, |best, axis| match side(axis) > side(best) {
            true => axis,
            false => best,
        });
        let half = pool.len() / 2;
        pool.select_nth_unstable_by(half, |&a, &b| {
            let along = |it: u32| middles[it as usize][axis];
            along(a).total_cmp(&along(b)).then(a.cmp(&b))
        });
        let (lower, upper) = pool.split_at_mut(half);
        cut(middles, lower, groups, next);
        cut(middles, upper, groups, next);
    }
    let count = neighbours.middles.len();
    let mut groups = vec![0; count];
    let mut pool: Vec<u32> = (0..count as u32).collect();
    cut(&neighbours.middles, &mut pool, &mut groups, &mut 0);
    groups
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::inputs::Generated;
    use lodestream_server::build::{BuildOptions, build};

    #[test]
    fn every_library_puts_every_cluster_in_a_group_of_neighbours() {
        let Ok(torus) = "torus:20000".parse::<Generated>() else {
            panic!("a shape and a count");
        };
        let built = build(torus.mesh(), &BuildOptions::default()).unwrap();
        let dag = ClusterDag::of_asset(&built).unwrap();
        let rows = rows("torus", &dag, 0);
        assert_eq!(rows.len(), 4);
        let source: Vec<u32> = (0..dag.clusters.len() as u32)
            .filter(|&cluster| dag.clusters[cluster as usize].level == 0)
            .collect();
        let each_alone: Vec<u32> = (0..source.len() as u32).collect();
        let alone = Neighbours::new(&dag, &source).row(&each_alone);
        for row in rows {
            assert!(row.mean > 8.0 && row.largest < 40, "{row:?}");
            // Groups of sixteen have about a quarter of the border of their clusters.
            let share = row.locked_per_triangle / alone.locked_per_triangle;
            assert!((0.1..0.5).contains(&share), "{row:?}: {share}");
        }
    }
}
