//! Partition: the clusters of a level to chunks, and the clusters of a chunk to groups.

use super::borders::{Borders, ChunkBounds};
use super::cluster::{ClusterInfo, ClusterView};
use super::meshopt_seam;
use super::split::ascending;

/// Most clusters of a group.
pub(super) const MAX_GROUP_CLUSTERS: usize = 32;
/// What a partition aims at: up to a third more come out, and small ones stay where nothing is near.
pub(super) const USUAL_GROUP_CLUSTERS: usize = 16;
/// The same for a second try: as large as the limit allows, so that borders lie elsewhere and lock less.
pub(super) const LARGE_GROUP_CLUSTERS: usize = 24;
/// Most clusters of a chunk: what is in memory at a time.
const CHUNK_CLUSTERS: usize = 2048;
/// Where the longest side is cut, of 16, one after another by level: a border of chunks that stayed where it is would lock
/// the same edges on every level.
const CUTS: [usize; 5] = [8, 6, 9, 7, 10];

/// Clusters of `pool` in chunks that are compact in space.
pub(super) fn chunks(infos: &[ClusterInfo], pool: &[u32], round: u32) -> Vec<Vec<u32>> {
    let mut chunks = Vec::new();
    let mut pool = pool.to_vec();
    cut(infos, &mut pool, round as usize, &mut chunks);
    chunks
}

fn cut(infos: &[ClusterInfo], pool: &mut [u32], turn: usize, chunks: &mut Vec<Vec<u32>>) {
    if pool.len() <= CHUNK_CLUSTERS {
        // In the order they were made, so that reading runs forward.
        pool.sort_unstable();
        chunks.push(pool.to_vec());
        return;
    }
    let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
    for &cluster in pool.iter() {
        let middle = infos[cluster as usize].middle();
        for axis in 0..3 {
            low[axis] = low[axis].min(middle[axis]);
            high[axis] = high[axis].max(middle[axis]);
        }
    }
    let axis = (1..3).fold(0, |best, axis| {
        let side = |axis: usize| high[axis] - low[axis];
        if side(axis) > side(best) { axis } else { best }
    });
    let at = pool.len() * CUTS[turn % CUTS.len()] / 16;
    let key = |&cluster: &u32| (ascending(infos[cluster as usize].middle()[axis]), cluster);
    pool.select_nth_unstable_by_key(at, key);
    let (lower, upper) = pool.split_at_mut(at);
    cut(infos, lower, turn + 1, chunks);
    cut(infos, upper, turn + 1, chunks);
}

/// Bounds of a chunk.
pub(super) fn bounds(infos: &[ClusterInfo], chunk: &[u32]) -> ChunkBounds {
    let mut bounds = ChunkBounds {
        low: [i32::MAX; 3],
        high: [i32::MIN; 3],
    };
    for &cluster in chunk {
        let info = &infos[cluster as usize];
        for axis in 0..3 {
            bounds.low[axis] = bounds.low[axis].min(info.low[axis]);
            bounds.high[axis] = bounds.high[axis].max(info.high[axis]);
        }
    }
    bounds
}

/// Splits the clusters of a chunk into groups of about `target` (at most [`MAX_GROUP_CLUSTERS`]) that share many border
/// places, or are near where they share none. Gives indices into `clusters`.
pub(super) fn partition(
    clusters: &[ClusterView],
    borders: &Borders,
    target: usize,
) -> Vec<Vec<u32>> {
    if clusters.len() <= MAX_GROUP_CLUSTERS {
        return vec![(0..clusters.len() as u32).collect()];
    }
    let mut positions: Vec<[f32; 3]> = borders
        .places()
        .iter()
        .map(|place| place.map(|q| q as f32))
        .collect();
    let mut places = Vec::new();
    let mut counts = Vec::with_capacity(clusters.len());
    for (index, cluster) in clusters.iter().enumerate() {
        let edges = borders.edges_of(index);
        if edges.is_empty() {
            // A closed shell on its own: no neighbour, but a place.
            places.push(positions.len() as u32);
            positions.push(cluster.vertices[0].position.map(|q| q as f32));
        }
        places.extend(edges.iter().map(|edge| edge[0]));
        counts.push(edges.len().max(1) as u32);
    }
    let partitions = meshopt_seam::partition(&places, &counts, &positions, target);
    let count = partitions
        .iter()
        .max()
        .map_or(0, |&largest| largest as usize + 1);
    let mut groups = vec![Vec::new(); count];
    for (cluster, &partition) in partitions.iter().enumerate() {
        groups[partition as usize].push(cluster as u32);
    }
    debug_assert!(
        groups
            .iter()
            .all(|group| (1..=MAX_GROUP_CLUSTERS).contains(&group.len()))
    );
    groups
}
