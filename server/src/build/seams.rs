//! Places of the source where something jumps from triangle to triangle.

use super::quantize::QuantizedMesh;

/// Flags of every place.
#[derive(Debug)]
pub(super) struct Seams {
    /// Vertices with different texture coordinates meet.
    pub uv: Vec<bool>,
    /// Triangles of different materials meet.
    pub material: Vec<bool>,
}

impl Seams {
    /// Finds the seams of a mesh.
    pub fn of(mesh: &QuantizedMesh) -> Self {
        let mut seams = Self {
            uv: vec![false; mesh.places.len()],
            material: vec![false; mesh.places.len()],
        };
        let mut first_uv = vec![None; mesh.places.len()];
        for (vertex, &place) in mesh.vertices.iter().zip(&mesh.place_of) {
            let first = first_uv[place as usize].get_or_insert(vertex.uv);
            seams.uv[place as usize] |= *first != vertex.uv;
        }
        let mut first_material = vec![None; mesh.places.len()];
        for triangle in &mesh.triangles {
            for place in mesh.places_of(triangle) {
                let first = first_material[place as usize].get_or_insert(triangle.material);
                seams.material[place as usize] |= *first != triangle.material;
            }
        }
        seams
    }
}
