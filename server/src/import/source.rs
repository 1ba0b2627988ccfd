//! Mesh source: a mesh read piece by piece, so that a build needs memory for one piece and not for the mesh.

use std::borrow::{Borrow, Cow};

use super::{ImportError, Mesh};

/// A mesh in pieces. The same piece is the same each time it is read; together, in order, they are the mesh. A piece has
/// its own vertex array; vertices on the border of two pieces stand in both, bit by bit equal.
pub trait MeshSource: Sync {
    /// The mesh's name.
    fn name(&self) -> &str;

    /// Slots that `triangle_materials` of the pieces name; at least one counts as one.
    fn material_slot_count(&self) -> usize;

    /// Number of pieces.
    fn piece_count(&self) -> usize;

    /// Reads a piece. All pieces have the same attributes. A piece may be without triangles.
    ///
    /// # Errors
    /// What reading its file says.
    fn piece(&self, index: usize) -> Result<Cow<'_, Mesh>, ImportError>;
}

/// A mesh in memory, owned or borrowed, is one piece.
impl<M: Borrow<Mesh> + Sync> MeshSource for M {
    fn name(&self) -> &str {
        &self.borrow().name
    }

    fn material_slot_count(&self) -> usize {
        self.borrow().material_slots.len()
    }

    fn piece_count(&self) -> usize {
        1
    }

    fn piece(&self, _index: usize) -> Result<Cow<'_, Mesh>, ImportError> {
        Ok(Cow::Borrowed(self.borrow()))
    }
}
