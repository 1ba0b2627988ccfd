//! Vertex clustering (Rossignac and Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993):
//! the last resort where edges cannot collapse, for loose parts and tangled topology. All vertices of a grid cell move onto
//! one of them. It is a map of places, so edges stay closed whatever it does, as long as locked places stay.

use std::collections::HashMap;

use super::super::borders::LOCKED;
use super::group::GroupMesh;

/// Cells a unit at most.
const FINEST: u32 = 1024;

/// Merges vertices until at most `target` triangles are left, on the finest grid that does it. Opposite triangles at one
/// place cancel. Gives the triangles, and where each vertex went.
pub(super) fn merge(mesh: &GroupMesh, target: usize) -> (Vec<[u16; 3]>, Vec<u16>) {
    let survivors = |cells: u32| {
        let cell_of = cells_of(mesh, cells);
        let distinct = |corners: &&[u16; 3]| {
            let [a, b, c] = corners.map(|vertex| cell_of[vertex as usize]);
            a != b && b != c && c != a
        };
        mesh.triangles.iter().filter(distinct).count()
    };
    let (mut coarse, mut fine) = (1, FINEST);
    while fine - coarse > 1 {
        let middle = (coarse + fine) / 2;
        if survivors(middle) <= target {
            coarse = middle;
        } else {
            fine = middle;
        }
    }
    let cell_of = cells_of(mesh, coarse);
    let nearest = representatives(mesh, &cell_of);
    let moved_to: Vec<u16> = cell_of.iter().map(|&cell| nearest[cell as usize]).collect();
    let moved = mesh
        .triangles
        .iter()
        .map(|corners| corners.map(|vertex| moved_to[vertex as usize]));
    let triangles = cancel(
        moved.filter(|&corners| {
            let [a, b, c] = mesh.places(corners);
            a != b && b != c && c != a
        }),
        |&corners| mesh.places(corners),
    );
    (triangles, moved_to)
}

/// Number of the cell of each vertex, in order of first sight. Vertices of different materials never share one; places that
/// are locked or where materials meet are cells of their own.
fn cells_of(mesh: &GroupMesh, cells: u32) -> Vec<u32> {
    let vertices = &mesh.welder.vertices;
    let fixed: Vec<bool> = (0..mesh.positions.len() as u32)
        .map(|place| {
            let mut slots = mesh
                .welder
                .vertices_at(place)
                .map(|v| vertices[v as usize].1);
            let first = slots.next();
            mesh.rules[place as usize] == LOCKED || slots.any(|slot| Some(slot) != first)
        })
        .collect();
    let mut numbers: HashMap<[u32; 4], u32> = HashMap::new();
    (0..vertices.len())
        .map(|vertex| {
            let place = mesh.welder.place_of[vertex] as usize;
            let key = if fixed[place] {
                [u32::MAX, vertex as u32, 0, 0]
            } else {
                let [x, y, z] =
                    mesh.positions[place].map(|value| ((value + 0.5) * cells as f32) as u32);
                [vertices[vertex].1 as u32, x, y, z]
            };
            let next = numbers.len() as u32;
            *numbers.entry(key).or_insert(next)
        })
        .collect()
}

/// The vertex of each cell that lies nearest to the cell's mean.
fn representatives(mesh: &GroupMesh, cell_of: &[u32]) -> Vec<u16> {
    let count = cell_of
        .iter()
        .max()
        .map_or(0, |&largest| largest as usize + 1);
    let position = |vertex: usize| mesh.positions[mesh.welder.place_of[vertex] as usize];
    let mut sums = vec![([0.0f64; 3], 0.0f64); count];
    for (vertex, &cell) in cell_of.iter().enumerate() {
        let (sum, number) = &mut sums[cell as usize];
        (0..3).for_each(|axis| sum[axis] += position(vertex)[axis] as f64);
        *number += 1.0;
    }
    let mut best = vec![(f64::INFINITY, 0u16); count];
    for (vertex, &cell) in cell_of.iter().enumerate() {
        let (sum, number) = &sums[cell as usize];
        let away: f64 = (0..3)
            .map(|axis| (position(vertex)[axis] as f64 - sum[axis] / number).powi(2))
            .sum();
        if away < best[cell as usize].0 {
            best[cell as usize] = (away, vertex as u16);
        }
    }
    best.into_iter().map(|(_, vertex)| vertex).collect()
}

/// Drops pairs of triangles at the same three places that face opposite ways: together they bound nothing.
fn cancel(
    triangles: impl Iterator<Item = [u16; 3]>,
    at: impl Fn(&[u16; 3]) -> [usize; 3],
) -> Vec<[u16; 3]> {
    let mut keyed: Vec<([usize; 3], bool, [u16; 3])> = triangles
        .map(|corners| {
            let places = at(&corners);
            let mut sorted = places;
            sorted.sort_unstable();
            let turned = [[0, 1, 2], [1, 2, 0], [2, 0, 1]]
                .iter()
                .all(|order| order.map(|corner| places[corner]) != sorted);
            (sorted, turned, corners)
        })
        .collect();
    keyed.sort_unstable();
    let mut kept = Vec::with_capacity(keyed.len());
    for run in keyed.chunk_by(|a, b| a.0 == b.0) {
        let (straight, turned) = run.split_at(run.partition_point(|&(_, turned, _)| !turned));
        let pairs = straight.len().min(turned.len());
        let left = straight[pairs..].iter().chain(&turned[pairs..]);
        kept.extend(left.map(|&(_, _, corners)| corners));
    }
    kept
}
