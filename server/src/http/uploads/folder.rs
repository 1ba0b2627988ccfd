//! Folders of uploads: one a server, and in it one an upload, all for this user alone.
//!
//! A server holds a lock on its folder. A folder without one is left over from a server that was
//! killed, and the next server on the same scratch folder removes it.

use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use tempfile::{Builder, TempDir};

/// Begin of the names of servers' folders.
const PREFIX: &str = "lodestream-uploads-";
/// Servers that start at the same time may remove each other's new folder; then the name is drawn
/// again.
const TRIES: usize = 8;

/// Folder of one server's uploads; removed when this is dropped.
#[derive(Debug)]
pub struct UploadsFolder {
    folder: TempDir,
    /// Held while the folder is in use.
    _lock: File,
}

/// Folder of one upload; removed when this is dropped.
#[derive(Debug)]
pub(super) struct UploadFolder(TempDir);

impl UploadsFolder {
    /// Removes what killed servers left in `scratch`, and makes a folder there.
    ///
    /// # Errors
    /// A scratch folder that cannot be read or written.
    pub fn new(scratch: &Path) -> io::Result<Self> {
        sweep(scratch)?;
        for _ in 0..TRIES {
            let folder = private(PREFIX, scratch)?;
            match lock(folder.path()) {
                Ok(Some(lock)) => {
                    return Ok(Self {
                        folder,
                        _lock: lock,
                    });
                }
                // A sweep took it between the two lines above.
                Ok(None) => {}
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
        Err(io::Error::other(
            "other servers remove every folder that is made here",
        ))
    }

    /// Makes the folder of an upload.
    pub(super) fn upload(&self) -> io::Result<UploadFolder> {
        let folder = UploadFolder(private("upload-", self.folder.path())?);
        std::fs::create_dir(folder.scratch())?;
        // The confined build may write this file, and make no other beside it.
        File::create(folder.report())?;
        Ok(folder)
    }
}

impl UploadFolder {
    /// The folder.
    pub(super) fn path(&self) -> &Path {
        self.0.path()
    }

    /// The model, by a name that says nothing but its kind.
    pub(super) fn model(&self, kind: &str) -> PathBuf {
        self.0.path().join(format!("model.{kind}"))
    }

    /// Folder for parts that do not fit memory.
    pub(super) fn scratch(&self) -> PathBuf {
        self.0.path().join("scratch")
    }

    /// Report of the build.
    pub(super) fn report(&self) -> PathBuf {
        self.0.path().join("report.json")
    }
}

/// A new folder that only this user may enter.
fn private(prefix: &str, within: &Path) -> io::Result<TempDir> {
    let mut builder = Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
    builder.prefix(prefix).tempdir_in(within)
}

/// Locks a folder; `None` where it is locked already, or gone since it was opened.
fn lock(folder: &Path) -> io::Result<Option<File>> {
    let file = OpenOptions::new().read(true).open(folder)?;
    match file.try_lock() {
        Ok(()) => Ok(folder.try_exists()?.then_some(file)),
        Err(TryLockError::WouldBlock) => Ok(None),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

/// Removes the folders of servers that are gone.
fn sweep(scratch: &Path) -> io::Result<()> {
    for entry in std::fs::read_dir(scratch)? {
        let entry = entry?;
        let named = entry.file_name().to_string_lossy().starts_with(PREFIX);
        if !named || !is_own_folder(&entry)? {
            continue;
        }
        let path = entry.path();
        let removed = lock(&path).and_then(|lock| match lock {
            Some(_lock) => std::fs::remove_dir_all(&path).map(|()| true),
            None => Ok(false),
        });
        match removed {
            Ok(true) => tracing::info!("removed {}, left by a killed server", path.display()),
            Ok(false) => {}
            // Another server that starts now was faster.
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => tracing::warn!("{}: cannot remove: {error}", path.display()),
        }
    }
    Ok(())
}

/// In a folder that is everybody's, anybody may make such a name, or a link of it.
#[cfg(unix)]
fn is_own_folder(entry: &std::fs::DirEntry) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    match entry.metadata() {
        Ok(metadata) => {
            let own = metadata.uid() == rustix::process::geteuid().as_raw();
            Ok(metadata.is_dir() && own)
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

#[cfg(not(unix))]
fn is_own_folder(entry: &std::fs::DirEntry) -> io::Result<bool> {
    entry.file_type().map(|kind| kind.is_dir())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn folders_are_private_and_go_with_their_owner() {
        let scratch = tempfile::tempdir().expect("a folder");
        let server = UploadsFolder::new(scratch.path()).expect("a server's folder");
        let upload = server.upload().expect("an upload's folder");
        let mode = |path: &Path| path.metadata().expect("is there").permissions().mode() & 0o777;
        assert_eq!(mode(server.folder.path()), 0o700);
        assert_eq!(mode(upload.path()), 0o700);
        std::fs::write(upload.model("obj"), "v").expect("writes");
        drop(upload);
        let left = std::fs::read_dir(server.folder.path()).expect("reads");
        assert_eq!(left.count(), 0);
        drop(server);
        assert_eq!(std::fs::read_dir(scratch.path()).expect("reads").count(), 0);
    }

    #[test]
    fn a_start_removes_the_folders_of_killed_servers_alone() {
        let scratch = tempfile::tempdir().expect("a folder");
        let alive = UploadsFolder::new(scratch.path()).expect("a server's folder");
        let left = scratch.path().join(format!("{PREFIX}left"));
        std::fs::create_dir_all(left.join("upload-1/scratch")).expect("makes");
        std::fs::write(left.join("upload-1/model.obj"), "v").expect("writes");
        let elsewhere = tempfile::tempdir().expect("a folder");
        let link = scratch.path().join(format!("{PREFIX}link"));
        std::os::unix::fs::symlink(elsewhere.path(), &link).expect("links");
        let other = scratch.path().join("other");
        std::fs::create_dir(&other).expect("makes");
        let next = UploadsFolder::new(scratch.path()).expect("another server's folder");
        assert!(!left.exists());
        assert!(alive.folder.path().is_dir() && next.folder.path().is_dir());
        assert!(elsewhere.path().is_dir() && link.is_symlink() && other.is_dir());
    }
}
