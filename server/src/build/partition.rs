//! Clusters to groups, and the places that groups share.

use super::dag::Cluster;
use super::meshopt_seam;
use super::quantize::QuantizedMesh;

/// Most clusters of a group.
pub(super) const MAX_GROUP_CLUSTERS: usize = 32;
/// What a partition aims at: up to a third more come out, and small ones stay where nothing is near.
pub(super) const USUAL_GROUP_CLUSTERS: usize = 16;
/// The same for a second try: as large as the limit allows, so that borders lie elsewhere and lock less.
pub(super) const LARGE_GROUP_CLUSTERS: usize = 24;

/// Splits `pool` into groups of about `target` clusters (at most [`MAX_GROUP_CLUSTERS`]) that share many places.
pub(super) fn partition(
    mesh: &QuantizedMesh,
    clusters: &[Cluster],
    pool: &[u32],
    target: usize,
) -> Vec<Vec<u32>> {
    if pool.len() <= MAX_GROUP_CLUSTERS {
        return vec![pool.to_vec()];
    }
    let mut places = Vec::new();
    let mut counts = Vec::with_capacity(pool.len());
    for &cluster in pool {
        let triangles = &clusters[cluster as usize].triangles;
        places.extend(
            triangles
                .iter()
                .flat_map(|triangle| mesh.places_of(triangle)),
        );
        counts.push(3 * triangles.len() as u32);
    }
    let partitions = meshopt_seam::partition(&places, &counts, &mesh.places, target);
    let count = partitions
        .iter()
        .max()
        .map_or(0, |&largest| largest as usize + 1);
    let mut groups = vec![Vec::new(); count];
    for (&cluster, &partition) in pool.iter().zip(&partitions) {
        groups[partition as usize].push(cluster);
    }
    debug_assert!(
        groups
            .iter()
            .all(|group| (1..=MAX_GROUP_CLUSTERS).contains(&group.len()))
    );
    groups
}

/// Whether each place lies in more than one of `groups`. Simplifying a group must leave such places alone, for each
/// group is replaced without its neighbours knowing. By place, not by vertex: the vertices of a seam are several.
pub(super) fn shared_places(
    mesh: &QuantizedMesh,
    clusters: &[Cluster],
    groups: &[Vec<u32>],
) -> Vec<bool> {
    const NOBODY: u32 = u32::MAX;
    let mut owner = vec![NOBODY; mesh.places.len()];
    let mut shared = vec![false; mesh.places.len()];
    for (group, members) in groups.iter().enumerate() {
        for &cluster in members {
            for triangle in &clusters[cluster as usize].triangles {
                for place in mesh.places_of(triangle) {
                    let owner = &mut owner[place as usize];
                    if *owner == NOBODY {
                        *owner = group as u32;
                    } else if *owner != group as u32 {
                        shared[place as usize] = true;
                    }
                }
            }
        }
    }
    shared
}
