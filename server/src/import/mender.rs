//! Mender: normals of no length in a mesh that is read in pieces, made from all triangles around them, so that every piece
//! gets the same and the loaded mesh, too.

use std::collections::HashMap;

use glam::DVec3;

use super::error::Read;
use super::normals::{NO_FACE, angle, face_normal, unit};
use super::opened::{Piece, Pieces};
use super::warnings::Warnings;

/// More than so many in a mesh are not worth their memory: such normals were never meant.
const MOST_MENDED: usize = 1 << 18;

/// A vertex of the file: its array, and its place there.
type Vertex = (u32, u32);

/// The normals that the pieces lack.
pub(super) struct Mender {
    /// `None`: more than [`MOST_MENDED`].
    normals: Option<HashMap<Vertex, [f32; 3]>>,
}

/// The vertices of a piece whose normals have no length, by slot.
fn lacking(piece: &Piece) -> HashMap<u32, Vertex> {
    let (Some(normals), Some(used)) = (&piece.mesh.normals, &piece.used) else {
        return HashMap::new();
    };
    let places = used.ascending.iter().enumerate();
    let vertices = places.map(|(place, &vertex)| (used.slot(place), vertex));
    vertices
        .filter(|(slot, _)| normals[*slot] == [0.0; 3])
        .map(|(slot, vertex)| (slot as u32, (piece.array, vertex)))
        .collect()
}

impl Mender {
    /// Whether a piece needs one.
    pub(super) fn is_needed(piece: &Piece) -> bool {
        let normals = piece.mesh.normals.iter().flatten();
        piece.used.is_some() && normals.into_iter().any(|it| *it == [0.0; 3])
    }

    /// Reads all pieces once.
    pub(super) fn new(pieces: &dyn Pieces) -> Read<Self> {
        // The sum, and one face in case the sum cancels.
        let mut around: HashMap<Vertex, (DVec3, DVec3)> = HashMap::new();
        for index in 0..pieces.count() {
            let piece = pieces.read(index, &mut Warnings::default())?;
            let lacking = lacking(&piece);
            if lacking.is_empty() {
                continue;
            }
            let positions = &piece.mesh.positions;
            for triangle in &piece.mesh.triangles {
                for corner in 0..3 {
                    let Some(vertex) = lacking.get(&triangle[corner]) else {
                        continue;
                    };
                    let (sum, any) = around.entry(*vertex).or_default();
                    let face = DVec3::from(face_normal(positions, triangle).map(f64::from));
                    *sum += face * angle(positions, triangle, corner);
                    *any = if *any == DVec3::ZERO { face } else { *any };
                }
            }
            if around.len() > MOST_MENDED {
                return Ok(Self { normals: None });
            }
        }
        let mend = |(sum, any)| unit(if sum == DVec3::ZERO { any } else { sum });
        let normals = around
            .into_iter()
            .map(|(vertex, sums)| (vertex, mend(sums)));
        Ok(Self {
            normals: Some(normals.collect()),
        })
    }

    /// Fills the normals of no length in `piece`.
    pub(super) fn mend(&self, piece: &mut Piece, warnings: &mut Warnings) {
        let lacking = lacking(piece);
        let place = "pieces";
        let what = match &self.normals {
            Some(_) => "normals of no length made anew",
            None => "normals of no length, too many to make anew, set to +Z",
        };
        warnings.add(what, lacking.len() as u64, place);
        for (slot, vertex) in lacking {
            let mended = self
                .normals
                .as_ref()
                .and_then(|it| it.get(&vertex))
                .copied();
            if let Some(normals) = &mut piece.mesh.normals {
                normals[slot as usize] = mended.unwrap_or(NO_FACE);
            }
        }
    }
}
