//! Attributes: how far normals, texture coordinates and colours are off where the surface itself is not.

use super::collapse::Collapser;
use super::group::GroupMesh;
use super::quadric::{dot, sub};

/// Largest root mean square of the attributes' error round a vertex, units. What is wrong with a triangle's normal or texture
/// is wrong over that triangle and no farther: it cannot be seen from where the triangle is smaller than the error allowed,
/// so round each place it counts for no more than the triangles of `live` are large there.
pub(super) fn deviation<const L: usize>(
    state: &Collapser<L>,
    mesh: &GroupMesh,
    live: &[[u16; 3]],
) -> f32 {
    if L == 0 {
        return 0.0;
    }
    // Sum of the squares of the edges round each place, and their number.
    let mut sizes = vec![(0.0f32, 0u32); mesh.positions.len()];
    for &corners in live {
        let places = mesh.places(corners);
        for side in 0..3 {
            let (a, b) = (places[side], places[(side + 1) % 3]);
            let edge = sub(mesh.positions[b], mesh.positions[a]);
            let square = dot(edge, edge);
            for place in [a, b] {
                sizes[place].0 += square;
                sizes[place].1 += 1;
            }
        }
    }
    let mut most = 0.0f32;
    for (vertex, quadric) in state.attribute_quadrics.iter().enumerate() {
        let base = &quadric.base;
        let (sum, edges) = sizes[state.place_of[vertex] as usize];
        if state.uses[vertex] > 0 && base.weight > 0.0 && edges > 0 {
            most = most.max((base.c / base.weight).min(sum / edges as f32));
        }
    }
    most.sqrt()
}
