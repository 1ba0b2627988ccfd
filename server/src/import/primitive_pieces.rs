//! Primitive pieces: a glTF mesh that stays in its file, read by ranges of its primitives' triangles.

use std::collections::HashMap;

use super::Document;
use super::attributes::{Attributes, Present};
use super::error::{Read, malformed};
use super::mesh::Slots;
use super::opened::{PIECE_TRIANGLES, Piece, Pieces, StreamedMesh};
use super::pose::Pose;
use super::primitive::TrianglePrimitive;
use super::scene::Mesh;
use super::used::Used;
use super::warnings::Warnings;

/// A primitive with its open accessors.
struct OpenPrimitive {
    primitive: TrianglePrimitive,
    attributes: Attributes,
    slot: u16,
    /// A number for its source of vertices.
    array: u32,
    /// The mesh's first piece that is of this primitive.
    first_piece: usize,
}

struct PrimitivePieces {
    /// At least one; each of at least one triangle.
    primitives: Vec<OpenPrimitive>,
    present: Present,
    piece_count: usize,
}

/// Opens the accessors of `primitives`, which have at least one triangle each. Slots hold indices into the document's
/// materials; their number stands for the default material.
pub(super) fn open(
    document: &Document,
    name: String,
    primitives: Vec<TrianglePrimitive>,
    present: Present,
    pose: Option<&Pose>,
    place: &str,
) -> Read<StreamedMesh> {
    let mut slots = Slots::default();
    let mut pieces = PrimitivePieces {
        primitives: Vec::with_capacity(primitives.len()),
        present,
        piece_count: 0,
    };
    let mut triangle_count = 0;
    let mut arrays = HashMap::new();
    for primitive in primitives {
        let material = primitive.material.unwrap_or(document.root.materials.len());
        let next_array = arrays.len() as u32;
        pieces.primitives.push(OpenPrimitive {
            attributes: Attributes::open(document, &primitive.source, pose, &primitive.place)?,
            slot: slots.slot(material as u32, place)?,
            array: *arrays.entry(primitive.source.clone()).or_insert(next_array),
            first_piece: pieces.piece_count,
            primitive,
        });
        let count = pieces
            .primitives
            .last()
            .map_or(0, |it| it.primitive.triangle_count);
        pieces.piece_count += count.div_ceil(PIECE_TRIANGLES) as usize;
        triangle_count += count;
    }
    Ok(StreamedMesh::new(
        name,
        slots.materials,
        triangle_count,
        Box::new(pieces),
    ))
}

impl Pieces for PrimitivePieces {
    fn count(&self) -> usize {
        self.piece_count
    }

    fn read(&self, index: usize, warnings: &mut Warnings) -> Read<Piece> {
        let after = self
            .primitives
            .partition_point(|it| it.first_piece <= index);
        let open = after.checked_sub(1).and_then(|at| self.primitives.get(at));
        let Some(open) = open.filter(|_| index < self.piece_count) else {
            let expected = format!("a piece below {}", self.piece_count);
            return Err(malformed("mesh", expected, index));
        };
        let primitive = &open.primitive;
        let start = (index - open.first_piece) as u64 * PIECE_TRIANGLES;
        let end = (start + PIECE_TRIANGLES).min(primitive.triangle_count);
        let mut triangles = primitive.triangles(start..end, warnings)?;
        let used = Used::by_first_use(&mut triangles);
        let mut mesh = Mesh {
            triangle_materials: vec![open.slot; triangles.len()],
            triangles,
            ..Mesh::default()
        };
        let attributes = &open.attributes;
        attributes.read(&used, self.present, &mut mesh, &primitive.place, warnings)?;
        Ok(Piece {
            mesh,
            array: open.array,
            used: Some(used),
        })
    }
}
