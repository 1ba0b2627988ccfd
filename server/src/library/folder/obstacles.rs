//! Obstacles: folders in the place of files, and files in the place of folders. A write moves them
//! into `lost/`.

use std::io;
use std::path::{Path as FilePath, PathBuf};

use lodestream_format::FormatError;
use object_store::path::Path;

use super::staged::{folders, read};
use crate::library::{Library, LibraryError};

/// Folder of moved obstacles.
const LOST: &str = "lost";

impl Library {
    /// Clears `path` for a write: removes an empty folder, moves anything else to `lost/`.
    pub(in crate::library) fn clear_way(&self, path: &Path) -> Result<(), LibraryError> {
        let (Some(folder), Some(obstacle)) = (&self.folder, self.obstacle(path)) else {
            return Ok(());
        };
        if std::fs::remove_dir(&obstacle).is_ok() {
            return Ok(());
        }
        let moved = keep(folder, &obstacle).map_err(|cause| LibraryError::File {
            file: obstacle.clone(),
            cause,
        })?;
        tracing::warn!(
            "library {}: {path}: expected a file; what was there is now {}",
            self.location,
            moved.display()
        );
        Ok(())
    }

    /// Faults that no listing shows: folders and dangling links in the place of files.
    pub(crate) async fn no_files(&self) -> Result<Vec<LibraryError>, LibraryError> {
        let Some(folder) = self.folder.clone() else {
            return Ok(Vec::new());
        };
        let failed = |cause| LibraryError::File {
            file: self.location.to_string().into(),
            cause,
        };
        let listed = tokio::task::spawn_blocking(move || list(&folder));
        let listed = listed.await.map_err(|error| failed(error.into()))?;
        let fault = |path: String| {
            let found = "a folder, or a link that leads to none";
            self.damaged(path, FormatError::new("file", "a file", found))
        };
        Ok(listed.map_err(failed)?.into_iter().map(fault).collect())
    }

    pub(in crate::library) fn has_obstacle(&self, path: &Path) -> bool {
        self.obstacle(path).is_some()
    }

    /// A folder at `path`, or the first non-folder above it.
    fn obstacle(&self, path: &Path) -> Option<PathBuf> {
        let folder = self.folder.as_deref()?;
        let file = folder.join(path.as_ref());
        // A link is no obstacle: the rename replaces it.
        if file.symlink_metadata().is_ok_and(|found| found.is_dir()) {
            return Some(file);
        }
        let above = file.ancestors().skip(1).take_while(|it| *it != folder);
        let above = above.filter(|it| it.symlink_metadata().is_ok());
        let mut no_folder = above.filter(|it| !it.is_dir());
        no_folder.next().map(FilePath::to_owned)
    }
}

fn list(folder: &FilePath) -> io::Result<Vec<String>> {
    let mut found = vec![];
    for within in folders(folder)? {
        for (path, kind) in read(&within)? {
            let name = path.strip_prefix(folder).unwrap_or(&path);
            // A link counts as its target.
            if !kind.is_file() && !path.is_file() {
                found.push(name.to_string_lossy().into_owned());
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Moves `obstacle` to a free name; gives that.
fn keep(folder: &FilePath, obstacle: &FilePath) -> io::Result<PathBuf> {
    let lost = folder.join(LOST);
    std::fs::create_dir_all(&lost)?;
    let name = obstacle.file_name().unwrap_or_default().to_string_lossy();
    let free = (1..u32::MAX)
        .map(|number| lost.join(format!("{name}-{number}")))
        .find(|path| path.symlink_metadata().is_err())
        .ok_or(io::ErrorKind::AlreadyExists)?;
    std::fs::rename(obstacle, &free)?;
    Ok(free)
}
