//! Vertex clustering (Rossignac and Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993):
//! the last resort where edges cannot collapse, for loose parts and tangled topology. All vertices of a grid cell move onto
//! one of them. It is a map of vertices, so the boundary chain is kept whatever it does, as long as fixed vertices stay.

use std::collections::HashMap;

use super::local::LocalMesh;

/// Cells a unit at most.
const FINEST: u32 = 1024;

/// Merges vertices until at most `target` triangles are left, on the finest grid that does it. `fixed` vertices stay.
/// Opposite triangles at one place cancel. `places` gives the place of each local vertex.
pub(super) fn merge(
    local: &LocalMesh,
    places: &[u32],
    fixed: &[bool],
    target: usize,
) -> Vec<[u32; 3]> {
    let survivors = |cells: u32| {
        let cell_of = cells_of(local, fixed, cells);
        let distinct = |corners: &&[u32; 3]| {
            let [a, b, c] = corners.map(|vertex| cell_of[vertex as usize]);
            a != b && b != c && c != a
        };
        local.triangles.iter().filter(distinct).count()
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
    let cell_of = cells_of(local, fixed, coarse);
    let moved_to = representatives(local, &cell_of);
    let moved = local
        .triangles
        .iter()
        .map(|corners| corners.map(|vertex| moved_to[cell_of[vertex as usize] as usize]));
    let at = |corners: &[u32; 3]| corners.map(|vertex| places[vertex as usize]);
    cancel(
        moved.filter(|corners| {
            let [a, b, c] = at(corners);
            a != b && b != c && c != a
        }),
        at,
    )
}

/// Number of the cell of each vertex, in order of first sight. A fixed vertex is a cell of its own.
fn cells_of(local: &LocalMesh, fixed: &[bool], cells: u32) -> Vec<u32> {
    let mut numbers: HashMap<[u32; 4], u32> = HashMap::new();
    (0..local.positions.len())
        .map(|vertex| {
            let key = if fixed[vertex] {
                [u32::MAX, vertex as u32, 0, 0]
            } else {
                let [x, y, z] =
                    local.positions[vertex].map(|value| ((value + 0.5) * cells as f32) as u32);
                [local.materials[vertex] as u32, x, y, z]
            };
            let next = numbers.len() as u32;
            *numbers.entry(key).or_insert(next)
        })
        .collect()
}

/// The vertex of each cell that lies nearest to the cell's mean.
fn representatives(local: &LocalMesh, cell_of: &[u32]) -> Vec<u32> {
    let count = cell_of
        .iter()
        .max()
        .map_or(0, |&largest| largest as usize + 1);
    let mut sums = vec![([0.0f64; 3], 0.0f64); count];
    for (position, &cell) in local.positions.iter().zip(cell_of) {
        let (sum, number) = &mut sums[cell as usize];
        (0..3).for_each(|axis| sum[axis] += position[axis] as f64);
        *number += 1.0;
    }
    let mut best = vec![(f64::INFINITY, 0u32); count];
    for (vertex, &cell) in cell_of.iter().enumerate() {
        let (sum, number) = &sums[cell as usize];
        let away: f64 = (0..3)
            .map(|axis| (local.positions[vertex][axis] as f64 - sum[axis] / number).powi(2))
            .sum();
        if away < best[cell as usize].0 {
            best[cell as usize] = (away, vertex as u32);
        }
    }
    best.into_iter().map(|(_, vertex)| vertex).collect()
}

/// Drops pairs of triangles at the same three places that face opposite ways: together they bound nothing.
fn cancel(
    triangles: impl Iterator<Item = [u32; 3]>,
    at: impl Fn(&[u32; 3]) -> [u32; 3],
) -> Vec<[u32; 3]> {
    let mut keyed: Vec<([u32; 3], bool, [u32; 3])> = triangles
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
