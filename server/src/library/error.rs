//! What can go wrong in a library, said once, on one line.

use lodestream_format::{ContentHash, FormatError};

/// A failed operation on a library.
#[derive(Debug, thiserror::Error)]
pub enum LibraryError {
    /// The library itself cannot be opened.
    #[error("library {location}: expected {expected}, found {found}")]
    Location {
        /// The folder or URL as it was given.
        location: String,
        /// What can be opened.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A scene name that no library can hold.
    #[error(transparent)]
    Name(FormatError),
    /// No reference of this name.
    #[error("library {location}: scene {name}: expected a published scene, found none")]
    NoScene {
        /// The library.
        location: String,
        /// The scene.
        name: String,
    },
    /// A name points at something else than what was to be replaced.
    #[error("library {location}: scene {name}: expected to replace {expected}, found {found}")]
    Changed {
        /// The library.
        location: String,
        /// The scene's name.
        name: String,
        /// The scene that was to be replaced, or `none`.
        expected: String,
        /// What is there.
        found: String,
    },
    /// No object of this name.
    #[error("library {location}: {path}: expected an object, found none")]
    NoObject {
        /// The library.
        location: String,
        /// Its place in the library.
        path: String,
    },
    /// Jobs of a scene that nobody planned.
    #[error(
        "library {location}: scene {scene}: expected a plan, found none (ingest --plan makes one)"
    )]
    NoPlan {
        /// The library.
        location: String,
        /// The scene.
        scene: String,
    },
    /// A local file that is to become an object cannot be read.
    #[error("{}: cannot read: {cause}", file.display())]
    File {
        /// The file.
        file: std::path::PathBuf,
        /// The operating system's reason.
        cause: std::io::Error,
    },
    /// What is to be sent cannot be compressed.
    #[error("cannot compress an answer: {0}")]
    Compress(std::io::Error),
    /// Bytes are there, and are not what their name or the format promises.
    #[error("library {location}: {path}: {error}")]
    Damaged {
        /// The library.
        location: String,
        /// The place in it.
        path: String,
        /// What was expected and found.
        error: FormatError,
    },
    /// The store failed.
    #[error("library {location}: {path}: {source}")]
    Store {
        /// The library.
        location: String,
        /// The place in it.
        path: String,
        /// The store's own words.
        source: Box<object_store::Error>,
    },
}

impl LibraryError {
    /// Whether nothing of that name is there: asking again is useless.
    pub fn is_missing(&self) -> bool {
        matches!(
            self,
            Self::NoScene { .. } | Self::NoObject { .. } | Self::NoPlan { .. } | Self::Name(_)
        )
    }
}

/// What an object whose bytes do not hash to its name is.
pub(super) fn wrong_hash(expected: &ContentHash, found: &ContentHash, bytes: u64) -> FormatError {
    FormatError::new(
        "object hash",
        expected,
        format!("{found} over {bytes} bytes"),
    )
}
