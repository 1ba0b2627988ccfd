//! Files too large for memory become objects, read and sent part by part.

use std::fs::File;
use std::io;
use std::path::{Path as FilePath, PathBuf};
use std::sync::Arc;

use bytes::Bytes;
use futures_util::{Stream, TryStreamExt};
use lodestream_format::ContentHash;
use lodestream_format::hash::ContentHasher;
use object_store::path::Path;
use object_store::{ObjectStoreExt, WriteMultipart};

use super::error::wrong_hash;
use super::{Library, LibraryError, Put, object_path};

/// Bytes of a part unless the file is so large that there would be too many.
const PART_BYTES: u64 = 8 * 1024 * 1024;
/// Stores like S3 take at most 10,000.
const MOST_PARTS: u64 = 9_000;
/// Parts on their way at once; so many are in memory.
const PARTS_AT_ONCE: usize = 4;

impl Library {
    /// Stores `file` under its hash, unless it is there already, with a few parts of it in memory.
    /// `name` is for messages.
    ///
    /// The file is read twice, first for its hash. An object that is there is compared whole, so a damaged one heals, and made
    /// young again where it is older than `renew_after_secs`, as [`Library::put_object`] does. The object appears when it is
    /// whole; an upload that fails is aborted.
    ///
    /// # Errors
    /// [`LibraryError::File`] where the file cannot be read, [`LibraryError::Damaged`] where it changed meanwhile.
    pub async fn put_object_file(
        &self,
        file: &Arc<File>,
        name: &FilePath,
        renew_after_secs: i64,
    ) -> Result<(ContentHash, Put), LibraryError> {
        let parts = |part_bytes| Parts::new(file, name, part_bytes);
        let (hash, bytes) = hash_parts(parts(PART_BYTES)).await?;
        let path = object_path(&hash);
        let holds = self.holds_parts(&path, parts(PART_BYTES), bytes);
        let (put, is_sent) = self.weigh(&path, bytes, renew_after_secs, holds).await?;
        if is_sent {
            let parts = parts(part_bytes(bytes)).into_stream();
            self.upload(&path, &hash, bytes, parts).await?;
        }
        Ok((hash, put))
    }

    /// Sends what becomes an object of `bytes`, piece by piece; it is there, whole, or is not. Pieces are put together into parts that a
    /// store takes.
    pub(super) async fn upload(
        &self,
        path: &Path,
        hash: &ContentHash,
        bytes: u64,
        pieces: impl Stream<Item = Result<Bytes, LibraryError>>,
    ) -> Result<(), LibraryError> {
        self.clear_way(path)?;
        let part_bytes = part_bytes(bytes);
        let upload = self.store.put_multipart(path).await;
        let upload = upload.map_err(|error| self.store_error(path, error))?;
        let mut upload = WriteMultipart::new_with_chunk_size(upload, part_bytes as usize);
        let sent = self.send_pieces(&mut upload, path, pieces).await;
        let sent = sent.and_then(|found| match found == *hash {
            true => Ok(()),
            false => Err(self.damaged(path.as_ref(), wrong_hash(hash, &found, bytes))),
        });
        if let Err(error) = sent {
            // The first error is the one to tell.
            let _ = upload.abort().await;
            return Err(error);
        }
        let finished = upload.finish().await;
        finished.map_err(|error| self.store_error(path, error))?;
        Ok(())
    }

    /// Gives the hash of what was sent: what changes while it is read must not become an object.
    async fn send_pieces(
        &self,
        upload: &mut WriteMultipart,
        path: &Path,
        pieces: impl Stream<Item = Result<Bytes, LibraryError>>,
    ) -> Result<ContentHash, LibraryError> {
        let mut hasher = ContentHasher::default();
        let mut pieces = std::pin::pin!(pieces);
        while let Some(piece) = pieces.try_next().await? {
            hasher.update(&piece);
            let room = upload.wait_for_capacity(PARTS_AT_ONCE).await;
            room.map_err(|error| self.store_error(path, error))?;
            upload.put(piece);
        }
        Ok(hasher.finish())
    }

    async fn holds_parts(
        &self,
        path: &Path,
        mut parts: Parts,
        bytes: u64,
    ) -> Result<bool, LibraryError> {
        let mut pieces = std::pin::pin!(self.pieces(path, 0..bytes));
        let mut part = Bytes::new();
        while let Some(mut piece) = pieces.try_next().await? {
            while !piece.is_empty() {
                if part.is_empty() {
                    match parts.next().await? {
                        Some(next) => part = next,
                        None => return Ok(false),
                    }
                }
                let both = piece.len().min(part.len());
                if piece.split_to(both) != part.split_to(both) {
                    return Ok(false);
                }
            }
        }
        Ok(part.is_empty() && parts.next().await?.is_none())
    }
}

/// Bytes of the parts that an object of `bytes` is sent in.
fn part_bytes(bytes: u64) -> u64 {
    PART_BYTES.max(bytes.div_ceil(MOST_PARTS))
}

async fn hash_parts(mut parts: Parts) -> Result<(ContentHash, u64), LibraryError> {
    let mut hasher = ContentHasher::default();
    let mut bytes = 0;
    while let Some(part) = parts.next().await? {
        bytes += part.len() as u64;
        hasher.update(&part);
    }
    Ok((hasher.finish(), bytes))
}

/// A file read part by part off the runtime's threads; its own position, whoever else reads it.
struct Parts {
    name: PathBuf,
    part_bytes: u64,
    file: Arc<File>,
    at: u64,
}

impl Parts {
    fn new(file: &Arc<File>, name: &FilePath, part_bytes: u64) -> Self {
        Self {
            name: name.to_owned(),
            part_bytes,
            file: Arc::clone(file),
            at: 0,
        }
    }

    /// The parts that are left.
    fn into_stream(self) -> impl Stream<Item = Result<Bytes, LibraryError>> {
        futures_util::stream::try_unfold(self, |mut parts| async move {
            let part = parts.next().await?;
            Ok(part.map(|part| (part, parts)))
        })
    }

    /// The next part, full but for the last one; `None` at the end.
    async fn next(&mut self) -> Result<Option<Bytes>, LibraryError> {
        let (file, bytes, at) = (Arc::clone(&self.file), self.part_bytes as usize, self.at);
        let read = tokio::task::spawn_blocking(move || read_part(&file, bytes, at)).await;
        let part = read
            .unwrap_or_else(|error| Err(error.into()))
            .map_err(|cause| LibraryError::File {
                file: self.name.clone(),
                cause,
            })?;
        self.at += part.len() as u64;
        Ok((!part.is_empty()).then(|| part.into()))
    }
}

/// `bytes` from `at` on, fewer where the file ends.
fn read_part(file: &File, bytes: usize, at: u64) -> io::Result<Vec<u8>> {
    let mut part = vec![0; bytes];
    let mut filled = 0;
    while filled < bytes {
        match read_at(file, &mut part[filled..], at + filled as u64) {
            Ok(0) => break,
            Ok(read) => filled += read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    part.truncate(filled);
    Ok(part)
}

#[cfg(unix)]
fn read_at(file: &File, bytes: &mut [u8], at: u64) -> io::Result<usize> {
    std::os::unix::fs::FileExt::read_at(file, bytes, at)
}

#[cfg(windows)]
fn read_at(file: &File, bytes: &mut [u8], at: u64) -> io::Result<usize> {
    std::os::windows::fs::FileExt::seek_read(file, bytes, at)
}
