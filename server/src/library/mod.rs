//! The library: immutable objects named by their hash, and scene names that point at them, in one object store.
//!
//! ```text
//! objects/ab/ab12…   put once, never changed        (`objects`)
//! scenes/NAME        swapped atomically             (`scenes`)
//! builds/ab/ab12…    which asset a mesh became      (`builds`, for ingest alone)
//! plans/NAME         which job builds which mesh    (`plans`, for ingest alone)
//! ```
//!
//! Everything that a scene needs hangs on its reference (`reach`): scene -> assets -> packs and hierarchies, and textures.
//! `gc` sweeps what hangs on none. Any number of servers and one or more writers may share a library.

mod builds;
mod copy;
mod error;
mod files;
mod gc;
mod location;
mod notes;
mod objects;
mod plans;
mod reach;
mod scenes;

use std::sync::Arc;

use lodestream_format::{ContentHash, FormatError, library};
use object_store::ObjectStore;
use object_store::path::Path;

pub use builds::BuildRecord;
pub use copy::CopyReport;
pub use error::LibraryError;
pub use gc::{GcOptions, GcReport};
pub use objects::{ObjectEntry, Put};
pub use plans::PlanNote;
pub use reach::Reach;

/// A handle on a library; clones share the store.
#[derive(Debug, Clone)]
pub struct Library {
    store: Arc<dyn ObjectStore>,
    location: Arc<str>,
}

impl Library {
    /// A library over any store; `location` names it in errors.
    pub fn over(store: Arc<dyn ObjectStore>, location: &str) -> Self {
        Self {
            store,
            location: location.into(),
        }
    }

    /// The folder or URL as it was given.
    pub fn location(&self) -> &str {
        &self.location
    }

    /// The library's bytes that are not what `path` promises.
    pub(crate) fn damaged(&self, path: impl Into<String>, error: FormatError) -> LibraryError {
        LibraryError::Damaged {
            location: self.location.to_string(),
            path: path.into(),
            error,
        }
    }

    fn no_object(&self, path: &Path) -> LibraryError {
        LibraryError::NoObject {
            location: self.location.to_string(),
            path: path.to_string(),
        }
    }

    /// A store's error at `path`; a missing object becomes [`LibraryError::NoObject`].
    fn store_error(&self, path: &Path, source: object_store::Error) -> LibraryError {
        match source {
            object_store::Error::NotFound { .. } => self.no_object(path),
            source => LibraryError::Store {
                location: self.location.to_string(),
                path: path.to_string(),
                source: Box::new(source),
            },
        }
    }
}

/// Where an object lies; 64 hexadecimal digits cannot leave the folder.
fn object_path(hash: &ContentHash) -> Path {
    Path::from(library::object_path(hash))
}
