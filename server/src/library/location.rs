//! A folder or URL becomes an object store.

use std::path::Path;
use std::sync::Arc;

use object_store::local::LocalFileSystem;
use object_store::memory::InMemory;

use super::{Library, LibraryError};

/// A library for the time of one process, for trials and measurements.
const MEMORY: &str = "memory://";

impl Library {
    /// Opens the library at `location`: an existing folder, or `memory://`.
    ///
    /// # Errors
    /// Where there is no folder, and for stores that this build cannot reach.
    pub fn open(location: &str) -> Result<Self, LibraryError> {
        if location == MEMORY {
            return Ok(Self::over(Arc::new(InMemory::new()), location));
        }
        let wrong = |expected: &str, found: String| LibraryError::Location {
            location: location.to_owned(),
            expected: expected.to_owned(),
            found,
        };
        if let Some((scheme, _)) = location.split_once("://") {
            let expected =
                "a folder or memory:// (this build has no S3 or other network store yet)";
            return Err(wrong(expected, format!("a {scheme}:// URL")));
        }
        let folder = Path::new(location);
        match folder.metadata() {
            Ok(metadata) if metadata.is_dir() => {}
            Ok(_) => return Err(wrong("a folder", "a file".to_owned())),
            Err(error) => return Err(wrong("a folder", error.to_string())),
        }
        let store = LocalFileSystem::new_with_prefix(folder)
            .map_err(|error| wrong("a folder that can be read", error.to_string()))?
            // A reference must never reach the disk before the objects that it names.
            .with_fsync(true);
        Ok(Self::over(Arc::new(store), location))
    }

    /// Like [`Library::open`], and makes the folder where there is none.
    pub fn open_or_create(location: &str) -> Result<Self, LibraryError> {
        if !location.contains("://") {
            std::fs::create_dir_all(location).map_err(|error| LibraryError::Location {
                location: location.to_owned(),
                expected: "a folder that can be made".to_owned(),
                found: error.to_string(),
            })?;
        }
        Self::open(location)
    }
}
