//! Staged files: a writer renames `PATH#N` to `PATH`; a killed writer leaves `PATH#N`.
//!
//! Listings pass them over. Their like in an S3 store are incomplete multipart uploads, which a
//! lifecycle rule of the bucket removes.

use std::fs::FileType;
use std::io;
use std::path::{Path as FilePath, PathBuf};
use std::time::UNIX_EPOCH;

use lodestream_format::ContentHash;
use lodestream_format::library::{MARK, OBJECTS, SCENES, scene_path};
use object_store::path::Path;

use crate::library::notes::{BUILDS, PLANS, build_path};
use crate::library::{Library, LibraryError, object_path};

/// A staged file.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::library) struct StagedFile {
    pub file: PathBuf,
    pub bytes: u64,
    /// Last write, seconds since 1970 UTC.
    pub written_secs: i64,
}

impl Library {
    /// All staged files; none in a store other than a folder.
    pub(in crate::library) async fn staged(&self) -> Result<Vec<StagedFile>, LibraryError> {
        let Some(folder) = self.folder.clone() else {
            return Ok(Vec::new());
        };
        let failed = |cause| LibraryError::File {
            file: self.location.to_string().into(),
            cause,
        };
        let listed = tokio::task::spawn_blocking(move || list(&folder));
        let listed = listed.await.map_err(|error| failed(error.into()))?;
        listed.map_err(failed)
    }

    /// Removes a staged file; a missing one is no error.
    pub(in crate::library) fn remove_staged(
        &self,
        staged: &StagedFile,
    ) -> Result<(), LibraryError> {
        match std::fs::remove_file(&staged.file) {
            Err(cause) if cause.kind() != io::ErrorKind::NotFound => Err(LibraryError::File {
                file: staged.file.clone(),
                cause,
            }),
            _ => Ok(()),
        }
    }
}

fn list(folder: &FilePath) -> io::Result<Vec<StagedFile>> {
    let mut staged = vec![];
    let mut all = folders(folder)?;
    // Beside the mark.
    all.push(folder.to_owned());
    for within in all {
        for (file, kind) in read(&within)? {
            let of = file.strip_prefix(folder).ok().and_then(FilePath::to_str);
            if !kind.is_file() || !of.is_some_and(is_staged) {
                continue;
            }
            let found = match file.metadata() {
                // Renamed or removed since.
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                found => found?,
            };
            let written = found.modified()?.duration_since(UNIX_EPOCH);
            staged.push(StagedFile {
                file,
                bytes: found.len(),
                written_secs: written.map_or(0, |since| since.as_secs() as i64),
            });
        }
    }
    Ok(staged)
}

/// The folders that hold a library's files and nothing else.
pub(super) fn folders(folder: &FilePath) -> io::Result<Vec<PathBuf>> {
    let mut folders = vec![folder.join(SCENES), folder.join(PLANS)];
    for name in [OBJECTS, BUILDS] {
        let shards = read(&folder.join(name))?.into_iter();
        folders.extend(shards.filter(|(_, kind)| kind.is_dir()).map(|it| it.0));
    }
    Ok(folders)
}

/// Entries of a folder, links as links; none if it is missing.
pub(super) fn read(folder: &FilePath) -> io::Result<Vec<(PathBuf, FileType)>> {
    use io::ErrorKind::{NotADirectory, NotFound};
    let listed = match std::fs::read_dir(folder) {
        Err(error) if matches!(error.kind(), NotFound | NotADirectory) => return Ok(Vec::new()),
        listed => listed?,
    };
    listed
        .map(|entry| {
            let entry = entry?;
            Ok((entry.path(), entry.file_type()?))
        })
        .collect()
}

/// Whether `path` is a staged path of this program.
fn is_staged(path: &str) -> bool {
    let Some((path, number)) = path.rsplit_once('#') else {
        return false;
    };
    if number.is_empty() || !number.bytes().all(|byte| byte.is_ascii_digit()) {
        return false;
    }
    let Some((folder, name)) = path.rsplit_once('/') else {
        return path == MARK;
    };
    let named = |path_of: fn(&ContentHash) -> Path| {
        name.parse()
            .is_ok_and(|hash| path_of(&hash).as_ref() == path)
    };
    match folder {
        SCENES | PLANS => scene_path(name).is_ok(),
        _ => named(object_path) || named(build_path),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_writers_stage_is_staged() {
        let hash = ContentHash::of(b"object");
        for path in [object_path(&hash), build_path(&hash)] {
            assert!(is_staged(&format!("{path}#1")) && is_staged(&format!("{path}#20")));
            for other in [
                path.to_string(),
                format!("{path}#"),
                format!("{path}#x"),
                format!("{path}x#1"),
                format!("lost/{path}#1"),
            ] {
                assert!(!is_staged(&other), "{other}");
            }
        }
        for path in ["scenes/city#1", "plans/city#3", "library.json#1"] {
            assert!(is_staged(path), "{path}");
        }
        for path in ["scenes/.city#1", "notes#1", "other/city#1", "#1", ""] {
            assert!(!is_staged(path), "{path}");
        }
    }
}
