//! Triangles to clusters.

use rayon::prelude::*;

use super::local::LocalMesh;
use super::meshopt_seam;
use super::quantize::{QuantizedMesh, Triangle};

/// Source triangles that are clusterized in one piece: enough that seams between pieces cost little, few enough that
/// pieces run in parallel and stay in a core's cache.
const PIECE_TRIANGLES: usize = 32 * 1024;

/// Clusters of all source triangles, in an order that depends on the mesh alone.
pub(super) fn leaves(mesh: &QuantizedMesh) -> Vec<Vec<Triangle>> {
    let centroids: Vec<[f32; 3]> = mesh
        .triangles
        .par_iter()
        .map(|triangle| {
            let corners = mesh
                .places_of(triangle)
                .map(|place| mesh.places[place as usize]);
            std::array::from_fn(|axis| corners.iter().map(|corner| corner[axis]).sum())
        })
        .collect();
    let order: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    pieces(order, &centroids)
        .par_iter()
        .map(|piece| {
            let triangles: Vec<Triangle> = piece
                .iter()
                .map(|&index| mesh.triangles[index as usize])
                .collect();
            clusterize(mesh, &triangles)
        })
        .collect::<Vec<_>>()
        .concat()
}

/// Clusters of some triangles of `mesh`.
pub(super) fn clusterize(mesh: &QuantizedMesh, triangles: &[Triangle]) -> Vec<Vec<Triangle>> {
    let local = LocalMesh::new(mesh, triangles);
    meshopt_seam::clusterize(&local.positions, &local.triangles)
        .iter()
        .map(|cluster| local.to_whole(cluster))
        .collect()
}

/// Halves along the longest side until every piece is small; inside a piece the source's order stays.
fn pieces(mut order: Vec<u32>, centroids: &[[f32; 3]]) -> Vec<Vec<u32>> {
    if order.len() <= PIECE_TRIANGLES {
        order.sort_unstable();
        return vec![order];
    }
    let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
    for &index in &order {
        for axis in 0..3 {
            low[axis] = low[axis].min(centroids[index as usize][axis]);
            high[axis] = high[axis].max(centroids[index as usize][axis]);
        }
    }
    let side = |axis: usize| high[axis] - low[axis];
    let axis = (1..3).fold(
        0,
        |best, axis| if side(axis) > side(best) { axis } else { best },
    );
    let key = |index: u32| centroids[index as usize][axis];
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| key(a).total_cmp(&key(b)).then(a.cmp(&b)));
    let upper = order.split_off(middle);
    let (mut lower, upper) = rayon::join(|| pieces(order, centroids), || pieces(upper, centroids));
    lower.extend(upper);
    lower
}
