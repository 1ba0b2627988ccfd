//! The pieces of a binary file whose vertices have a fixed stride.

use super::body::LeftOut;
use super::faces::{FaceLayout, FaceRow};
use super::header::Header;
use super::list::TriangleList;
use super::surface;
use super::values::Values;
use super::vertices::Table;
use crate::import::error::{Read, malformed};
use crate::import::file::Extent;
use crate::import::opened::{PIECE_TRIANGLES, Piece, Pieces};
use crate::import::polygons::MOST_CORNERS;
use crate::import::warnings::Warnings;

/// Where a piece starts.
#[derive(Clone, Copy)]
pub(super) struct PieceStart {
    /// Of its first face in the file.
    pub(super) offset: u64,
    pub(super) face: u64,
    /// Triangles of that face that the piece before has.
    pub(super) skip: u64,
}

/// Whether a face stays the fan that it is, and need not be held as a whole.
pub(super) fn is_long(corners: u64) -> bool {
    corners > MOST_CORNERS as u64
}

/// Says how many faces are long; the pieces do not.
pub(super) fn note_long(count: u64, warnings: &mut Warnings) {
    let what = format!("polygons of more than {MOST_CORNERS} corners cut into fans");
    warnings.add(what, count, "element face");
}

/// Faces that stay in their file.
pub(super) struct FilePieces {
    pub(super) file: Extent,
    pub(super) header: Header,
    pub(super) table: Table,
    pub(super) left_out: Option<LeftOut>,
    pub(super) layout: Option<FaceLayout>,
    pub(super) starts: Vec<PieceStart>,
    pub(super) triangle_count: u64,
    /// Numbers of the textures that faces use: a slot each.
    pub(super) textures: Vec<u16>,
}

impl Pieces for FilePieces {
    fn count(&self) -> usize {
        self.starts.len()
    }

    fn read(&self, index: usize, warnings: &mut Warnings) -> Read<Piece> {
        let (Some(start), Some(layout)) = (self.starts.get(index), &self.layout) else {
            let expected = format!("a piece below {}", self.starts.len());
            return Err(malformed("element face", expected, index));
        };
        let before = index as u64 * PIECE_TRIANGLES;
        let count = (self.triangle_count - before).min(PIECE_TRIANGLES) as usize;
        let mut values = Values::new(&self.file, self.header.encoding, start.offset);
        let with_textures = layout.has_textures() && !self.header.textures.is_empty();
        let mut list = TriangleList::new(layout.has_uvs(), with_textures);
        let mut row = FaceRow::default();
        let mut skip = start.skip as usize;
        let mut face = start.face;
        while list.len() < skip + count && face < layout.count {
            let first = list.len();
            let mut is_left_out = false;
            layout.read(&mut values, face, &mut row, &mut |corners, triangle| {
                let left_out = self.left_out.as_ref();
                is_left_out |= left_out.is_some_and(|it| it.has(triangle));
                if !is_long(corners) {
                    list.triangles.push(triangle);
                } else if skip > 0 {
                    skip -= 1;
                } else if list.len() < count {
                    list.triangles.push(triangle);
                }
            })?;
            face += 1;
            if is_left_out {
                // No piece begins in one of these.
                list.triangles.truncate(first);
                continue;
            }
            match is_long(row.corners) {
                true => list.end_strips(),
                false => list.end_face(first, &row, surface::number(row.texture, &self.header)),
            }
        }
        list.cut(&self.table, warnings)?;
        list.keep(skip, count);
        let (mesh, used) = list.into_mesh(&self.table, &self.textures, warnings)?;
        Ok(Piece {
            mesh,
            array: 0,
            used: Some(used),
        })
    }
}
