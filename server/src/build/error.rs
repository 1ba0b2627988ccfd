//! Why a mesh could not be built.

use lodestream_format::FormatError;

/// What [`super::build`] refuses. A mesh whose triangles all collapse on the position grid is not refused: one of them
/// is kept, so that the asset has its one cluster, and a warning says so.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BuildError {
    /// There is nothing to build.
    #[error("mesh {mesh:?}: expected at least one triangle, found none")]
    NoTriangles {
        /// Name of the mesh.
        mesh: String,
    },
    /// The arrays of the mesh disagree with each other.
    #[error("mesh {mesh:?} {at}: expected {expected}, found {found}")]
    InvalidMesh {
        /// Name of the mesh.
        mesh: String,
        /// The array and the index.
        at: String,
        /// What a valid mesh has there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The position step is not a length.
    #[error("position step: expected a positive number of metres, found {found}")]
    InvalidStep {
        /// The option's value.
        found: f64,
    },
    /// No step that the format allows spans the mesh.
    #[error(
        "mesh {mesh:?}: expected an extent of at most 2^123 metres, found {extent_metres} metres"
    )]
    TooLarge {
        /// Name of the mesh.
        mesh: String,
        /// Longest side of the bounding box, metres.
        extent_metres: f64,
    },
    /// The source could not be read again.
    #[error("{0}")]
    Source(String),
    /// The scratch file failed.
    #[error("scratch file in {}: {cause}", path.display())]
    Scratch {
        /// The folder.
        path: std::path::PathBuf,
        /// The operating system's reason.
        cause: String,
    },
    /// What was built breaks the format: a fault of the builder, found by the format's own checks.
    #[error("built asset: {0}")]
    Format(#[from] FormatError),
}
