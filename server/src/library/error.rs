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
    /// A local file, of a library or on its way to one, cannot be read, moved or removed.
    #[error("{}: {cause}", file.display())]
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
    /// Whether stored bytes are wrong or a file is unreadable for good: a retry does not help,
    /// replacing the file does.
    pub fn is_damage(&self) -> bool {
        match self {
            Self::Damaged { .. } => true,
            Self::Store {
                location, source, ..
            } if !location.starts_with(super::location::S3) => is_unreadable(source.as_ref()),
            _ => false,
        }
    }

    /// The object that the error is about, where it is about one.
    pub(super) fn object(&self) -> Option<ContentHash> {
        match self {
            Self::Damaged { path, .. } | Self::Store { path, .. } | Self::NoObject { path, .. } => {
                path.rsplit('/').next()?.parse().ok()
            }
            _ => None,
        }
    }

    /// Whether nothing of that name is there: asking again is useless.
    pub fn is_missing(&self) -> bool {
        matches!(
            self,
            Self::NoScene { .. } | Self::NoObject { .. } | Self::NoPlan { .. } | Self::Name(_)
        )
    }
}

/// Whether the cause is one of a single file; too many open files is not.
fn is_unreadable(error: &object_store::Error) -> bool {
    let mut cause: Option<&dyn std::error::Error> = Some(error);
    while let Some(error) = cause {
        if let Some(error) = error.downcast_ref::<std::io::Error>() {
            return is_lasting(error);
        }
        cause = error.source();
    }
    false
}

fn is_lasting(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{IsADirectory, NotADirectory, PermissionDenied};
    #[cfg(unix)]
    {
        use rustix::io::Errno;
        let broken = [Errno::IO, Errno::LOOP].map(|errno| Some(errno.raw_os_error()));
        if broken.contains(&error.raw_os_error()) {
            return true;
        }
    }
    matches!(
        error.kind(),
        PermissionDenied | IsADirectory | NotADirectory
    )
}

/// What an object whose bytes do not hash to its name is.
pub(super) fn wrong_hash(expected: &ContentHash, found: &ContentHash, bytes: u64) -> FormatError {
    FormatError::new(
        "object hash",
        expected,
        format!("{found} over {bytes} bytes"),
    )
}
