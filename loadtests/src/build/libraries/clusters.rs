//! Triangles to clusters: ours, and the three ways of meshoptimizer, on the triangles of level 0.

use std::collections::HashSet;
use std::time::Instant;

use meshopt::{Meshlets, VertexDataAdapter};
use serde::Serialize;

use crate::build::dag::ClusterDag;
use crate::build::process::median;

/// Limits of a cluster, as ours.
const MAX_VERTICES: usize = 256;
const MAX_TRIANGLES: usize = 128;
/// Where the flexible ways may stop early: a third, in fours, as clusterlod does.
const MIN_TRIANGLES: usize = 40;
/// clusterlod's: bounds may exceed the expected ones by this before a cluster is split.
const SPLIT_FACTOR: f32 = 2.0;
/// clusterlod's: fill against tight bounds.
const FILL_WEIGHT: f32 = 0.5;

/// Clusters by one builder.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ClusterRow {
    /// The input.
    pub input: String,
    /// Who made them.
    pub by: &'static str,
    /// Clusters.
    pub clusters: u64,
    /// Mean triangles of one.
    pub fill: f64,
    /// Places over triangles, each counted in every cluster that has it.
    pub places_per_triangle: f64,
    /// Share of the triangles' edges whose other side lies in another cluster.
    pub border_share: f64,
    /// Median radius of a sphere around a cluster's box over the one that its area would fill as a disk.
    pub radius_ratio: f64,
    /// Seconds on one thread. Ours read, welded and ordered the source too.
    pub secs: f64,
}

/// Ours, as the DAG holds them, then theirs; `leaves_secs` is what ours took.
pub fn rows(input: &str, dag: &ClusterDag, leaves_secs: f64) -> Vec<ClusterRow> {
    let ours: Vec<Vec<[u32; 3]>> = (0..dag.clusters.len() as u32)
        .filter(|&cluster| dag.clusters[cluster as usize].child_group.is_none())
        .map(|cluster| dag.triangles_of(cluster).to_vec())
        .collect();
    let source = ours.concat();
    let indices = source.as_flattened();
    let positions = meshopt::typed_to_bytes(&dag.places);
    let Ok(vertices) = VertexDataAdapter::new(positions, size_of::<[f32; 3]>(), 0) else {
        unreachable!("twelve bytes a place")
    };
    let mut rows = vec![row(input, "lodestream", &dag.places, &ours, leaves_secs)];
    let mut theirs = |by, make: &dyn Fn() -> Meshlets| {
        let start = Instant::now();
        let made = make();
        let secs = start.elapsed().as_secs_f64();
        rows.push(row(input, by, &dag.places, &unpacked(&made), secs));
    };
    theirs("meshopt", &|| {
        meshopt::build_meshlets(indices, &vertices, MAX_VERTICES, MAX_TRIANGLES, 0.0)
    });
    theirs("meshopt flex", &|| {
        meshopt::build_meshlets_flex(
            indices,
            &vertices,
            MAX_VERTICES,
            MIN_TRIANGLES,
            MAX_TRIANGLES,
            0.0,
            SPLIT_FACTOR,
        )
    });
    theirs("meshopt spatial", &|| {
        meshopt::build_meshlets_spatial(
            indices,
            &vertices,
            MAX_VERTICES,
            MIN_TRIANGLES,
            MAX_TRIANGLES,
            FILL_WEIGHT,
        )
    });
    rows
}

fn unpacked(made: &Meshlets) -> Vec<Vec<[u32; 3]>> {
    let places = |meshlet: meshopt::Meshlet<'_>| {
        let triangles = meshlet.triangles.as_chunks::<3>().0.iter();
        triangles
            .map(|corners| corners.map(|corner| meshlet.vertices[usize::from(corner)]))
            .collect()
    };
    made.iter().map(places).collect()
}

fn row(
    input: &str,
    by: &'static str,
    places: &[[f32; 3]],
    clusters: &[Vec<[u32; 3]>],
    secs: f64,
) -> ClusterRow {
    let triangles: usize = clusters.iter().map(Vec::len).sum();
    let (mut used, mut borders) = (0, 0);
    for cluster in clusters {
        used += cluster.as_flattened().iter().collect::<HashSet<_>>().len();
        let edges: HashSet<[u32; 2]> = edges(cluster).collect();
        borders += edges
            .iter()
            .filter(|&&[a, b]| !edges.contains(&[b, a]))
            .count();
    }
    let ratios = clusters.iter().map(|cluster| radius_ratio(places, cluster));
    ClusterRow {
        input: input.into(),
        by,
        clusters: clusters.len() as u64,
        fill: triangles as f64 / clusters.len() as f64,
        places_per_triangle: used as f64 / triangles as f64,
        border_share: borders as f64 / (3 * triangles) as f64,
        radius_ratio: median(ratios.filter(|ratio| ratio.is_finite())),
        secs,
    }
}

/// Directed edges of some triangles.
pub(super) fn edges(triangles: &[[u32; 3]]) -> impl Iterator<Item = [u32; 2]> {
    triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
}

fn radius_ratio(places: &[[f32; 3]], cluster: &[[u32; 3]]) -> f64 {
    let at = |&place: &u32| glam::DVec3::from(places[place as usize].map(f64::from));
    let (mut low, mut high) = (glam::DVec3::MAX, glam::DVec3::MIN);
    let mut area = 0.0;
    for corners in cluster {
        let [a, b, c] = [&corners[0], &corners[1], &corners[2]].map(at);
        low = low.min(a).min(b).min(c);
        high = high.max(a).max(b).max(c);
        area += 0.5 * (b - a).cross(c - a).length();
    }
    let middle = 0.5 * (low + high);
    let corners = cluster.as_flattened().iter().map(at);
    let radius = corners
        .map(|corner| corner.distance(middle))
        .fold(0.0, f64::max);
    radius / (area / std::f64::consts::PI).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_count_borders_and_places() {
        // Two right triangles of a unit square, in one cluster and in two.
        let places = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let square = [[0, 1, 2], [0, 2, 3]];
        let one = row("i", "b", &places, &[square.to_vec()], 0.0);
        assert_eq!((one.clusters, one.fill), (1, 2.0));
        assert_eq!(
            (one.places_per_triangle, one.border_share),
            (2.0, 4.0 / 6.0)
        );
        let half_diagonal = 0.5f64.sqrt();
        let disk = (1.0 / std::f64::consts::PI).sqrt();
        assert!((one.radius_ratio - half_diagonal / disk).abs() < 1e-9);
        let two = row("i", "b", &places, &square.map(|it| vec![it]), 0.0);
        assert_eq!((two.clusters, two.border_share), (2, 1.0));
        assert_eq!(two.places_per_triangle, 3.0);
    }
}
