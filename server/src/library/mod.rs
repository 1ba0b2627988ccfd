//! The library: immutable objects named by their hash, and scene names that point at them, in one object store.
//!
//! ```text
//! library.json       that this is a library         (`mark`)
//! objects/ab/ab12…   put once, never changed        (`objects`)
//! scenes/NAME        swapped atomically             (`scenes`)
//! builds/ab/ab12…    which asset a mesh became      (`notes`, for ingest alone)
//! plans/NAME         which job builds which mesh    (`notes`, for ingest alone)
//! ```
//!
//! Everything that a scene needs hangs on its reference (`reach`): scene -> assets -> packs and hierarchies, and textures.
//! `gc` sweeps what hangs on none. Any number of servers and one or more writers may share a library.

mod copy;
mod error;
mod files;
mod folder;
mod gc;
mod location;
mod mark;
mod notes;
mod objects;
mod reach;
mod repair;
mod scenes;

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use lodestream_format::{ContentHash, FormatError, library};
use object_store::ObjectStore;
use object_store::path::Path as StorePath;

pub use copy::{CopyOptions, CopyReport};
pub use error::LibraryError;
pub use gc::{GcOptions, GcReport};
pub use notes::{BuildRecord, Check, PlanNote};
pub use objects::{ObjectEntry, Put};
pub use reach::Reach;
pub use repair::Repaired;
pub(crate) use scenes::ListedScene;
pub use scenes::Replaces;

/// A handle on a library; clones share the store.
#[derive(Debug, Clone)]
pub struct Library {
    store: Arc<dyn ObjectStore>,
    location: Arc<str>,
    /// Where the store is a folder of this machine.
    folder: Option<Arc<Path>>,
}

/// File of a folder that whoever replaces a scene in it holds locked.
const LOCK: &str = ".lock";

impl Library {
    /// A library over any store; `location` names it in errors.
    pub fn over(store: Arc<dyn ObjectStore>, location: &str) -> Self {
        Self {
            store,
            location: location.into(),
            folder: None,
        }
    }

    /// The folder or URL as it was given.
    pub fn location(&self) -> &str {
        &self.location
    }

    /// Whether a network lies before the bytes.
    pub fn is_remote(&self) -> bool {
        self.location.starts_with(location::S3)
    }

    /// The folder, where the library is one of this machine.
    pub(crate) fn folder(&self) -> Option<&Arc<Path>> {
        self.folder.as_ref()
    }

    /// In a folder: waits until nobody else replaces a scene in it, as long as the file lives.
    async fn lock_folder(&self) -> Result<Option<File>, LibraryError> {
        let Some(folder) = &self.folder else {
            return Ok(None);
        };
        let path = folder.join(LOCK);
        let failed = |cause| LibraryError::File {
            file: path.clone(),
            cause,
        };
        let lock = File::create(&path).map_err(failed)?;
        let waits = tokio::task::spawn_blocking(move || lock.lock().map(|()| lock));
        let locked = waits.await.map_err(|error| failed(error.into()))?;
        locked.map(Some).map_err(failed)
    }

    /// The library's bytes that are not what `path` promises.
    pub(crate) fn damaged(&self, path: impl Into<String>, error: FormatError) -> LibraryError {
        LibraryError::Damaged {
            location: self.location.to_string(),
            path: path.into(),
            error,
        }
    }

    fn no_object(&self, path: &StorePath) -> LibraryError {
        LibraryError::NoObject {
            location: self.location.to_string(),
            path: path.to_string(),
        }
    }

    /// A store's error at `path`; a missing object becomes [`LibraryError::NoObject`].
    fn store_error(&self, path: &StorePath, source: object_store::Error) -> LibraryError {
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
fn object_path(hash: &ContentHash) -> StorePath {
    StorePath::from(library::object_path(hash))
}
