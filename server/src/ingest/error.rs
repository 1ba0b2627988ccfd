//! Why an ingest failed, on one line.

use std::path::PathBuf;

use lodestream_format::FormatError;

use crate::build::BuildError;
use crate::import::ImportError;
use crate::library::LibraryError;

/// Why nothing was published.
#[derive(Debug, thiserror::Error)]
pub enum IngestError {
    /// An input cannot be read.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// A wrong file must not replace a scene.
    #[error(
        "{}{}: expected at least one triangle, found none (--allow-empty publishes an empty scene)",
        file.display(),
        beside(*others)
    )]
    Empty {
        /// The first input.
        file: PathBuf,
        /// Inputs beside it, as empty.
        others: usize,
    },
    /// An input is not there.
    #[error("{}: cannot read: {cause}", file.display())]
    Input {
        /// The file.
        file: PathBuf,
        /// The operating system's reason.
        cause: std::io::Error,
    },
    /// A mesh cannot be built.
    #[error("{}: {error}", file.display())]
    Build {
        /// The file that holds the mesh.
        file: PathBuf,
        /// Why.
        error: BuildError,
    },
    /// The neighbours of a plan cannot be written.
    #[error("neighbours of the meshes: cannot write: {0}")]
    Neighbours(std::io::Error),
    /// The option and the inputs do not fit.
    #[error(
        "{what}: expected at most {limit_bytes} bytes of memory (--memory-limit), found a need of about {need_bytes}"
    )]
    Memory {
        /// What needs it.
        what: String,
        /// The option.
        limit_bytes: u64,
        /// The estimate.
        need_bytes: u64,
    },
    /// The inputs have more triangles than they may.
    #[error("expected at most {most} triangles (--max-triangles), found {triangles}")]
    TooManyTriangles {
        /// The option.
        most: u64,
        /// What the inputs have.
        triangles: u64,
    },
    /// An input is not the file that was planned.
    #[error(
        "{}: expected the input as it was planned ({planned}), found {found}; ingest --plan plans anew",
        file.display()
    )]
    Changed {
        /// The file.
        file: PathBuf,
        /// What the plan says of it.
        planned: String,
        /// What is there.
        found: String,
    },
    /// A plan and what is asked of it do not fit.
    #[error("library {location}: plan of scene {scene}: expected {expected}, found {found}")]
    Plan {
        /// The library.
        location: String,
        /// The scene.
        scene: String,
        /// What would fit.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The threads cannot be started.
    #[error("threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The scene breaks the format's limits.
    #[error("scene: {0}")]
    Format(#[from] FormatError),
    /// The library failed.
    #[error(transparent)]
    Library(#[from] LibraryError),
}

fn beside(others: usize) -> String {
    match others {
        0 => String::new(),
        others => format!(" and {others} more inputs"),
    }
}
