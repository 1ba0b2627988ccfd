//! Neighbours: the part of a mesh that the meshes beside it in a scene depend on.
//!
//! Two meshes whose open borders coincide stay closed at every level only if neither moves the
//! border; two meshes that share vertices keep them equal only on one grid.

use lodestream_format::ContentHash;
use lodestream_format::hash::ContentHasher;

use super::vertex::Grids;

/// Constraints of a mesh by its neighbours. The default is a mesh on its own.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Neighbours {
    /// Exponent of the step of the common position grid. An explicit
    /// [`PositionStep`](super::PositionStep) wins.
    pub step_exponent: Option<i32>,
    /// Vertices that stay at every level, object space: those of the common open borders.
    pub fixed: Vec<[f32; 3]>,
}

impl Neighbours {
    /// Whether the mesh is on its own.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Names the value: part of the name of a build.
    pub fn hash(&self) -> ContentHash {
        let Self {
            step_exponent,
            fixed,
        } = self;
        let mut hasher = ContentHasher::default();
        hasher.update(&[step_exponent.is_some() as u8]);
        hasher.update(&step_exponent.unwrap_or_default().to_le_bytes());
        hasher.update(bytemuck::cast_slice(fixed));
        hasher.finish()
    }
}

/// The fixed vertices on the grid of a mesh.
#[derive(Debug, Default)]
pub(super) struct FixedPlaces {
    /// Ascending.
    places: Vec<[i32; 3]>,
}

impl FixedPlaces {
    /// Rounds the fixed vertices as the mesh's own are rounded.
    pub(super) fn new(neighbours: &Neighbours, grids: &Grids) -> Self {
        let places = neighbours.fixed.iter().map(|&at| grids.place(at));
        let mut places: Vec<_> = places.collect();
        places.sort_unstable();
        places.dedup();
        Self { places }
    }

    /// Whether a vertex at `place` stays.
    pub(super) fn holds(&self, place: [i32; 3]) -> bool {
        self.places.binary_search(&place).is_ok()
    }
}
