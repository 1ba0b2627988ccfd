//! Immutable objects: put once, read whole with their hash checked, or in ranges.

use std::ops::Range;

use bytes::Bytes;
use futures_util::{Stream, StreamExt, TryStreamExt};
use lodestream_format::hash::ContentHasher;
use lodestream_format::library::OBJECTS;
use lodestream_format::{ContentHash, FormatError};
use object_store::path::Path;
use object_store::{ObjectStoreExt, PutPayload};

use super::error::wrong_hash;
use super::{Library, LibraryError, object_path};

/// Bytes of one read where an object is read piece by piece.
const PIECE_BYTES: u64 = 4 * 1024 * 1024;

/// What putting an object did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Put {
    /// It was not there.
    Stored,
    /// It was there with the same bytes; only its age was renewed where it was old.
    Known,
    /// What was there under its name was damaged and has been replaced.
    Healed,
}

/// State of an object's path.
#[derive(Debug)]
pub(super) enum Found {
    /// No file.
    Nothing,
    /// A file.
    Object(ObjectEntry),
    /// A folder, or an unreadable file.
    NoFile,
}

/// An object as a listing shows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ObjectEntry {
    /// Place in the library.
    pub path: String,
    /// The name, where the path is that of an object at all.
    pub hash: Option<ContentHash>,
    /// Bytes.
    pub bytes: u64,
    /// When it was written, seconds since 1970 UTC.
    pub written_secs: i64,
}

impl Library {
    /// Stores `bytes` under their hash, unless they are there already.
    ///
    /// An object that is there is compared whole: reading costs less than the write that it saves, and a damaged object
    /// heals. Its time is renewed when it is older than `renew_after_secs`, so that a concurrent `gc`, which spares what is
    /// younger than its grace period, does not take it before it is published.
    pub async fn put_object(
        &self,
        bytes: Bytes,
        renew_after_secs: i64,
    ) -> Result<(ContentHash, Put), LibraryError> {
        let hash = ContentHash::of(&bytes);
        let path = object_path(&hash);
        let holds = self.holds(&path, &bytes);
        let weighed = self.weigh(&path, bytes.len() as u64, renew_after_secs, holds);
        let (put, is_sent) = weighed.await?;
        if is_sent {
            // Overwriting is atomic, and a racing writer of the same name writes the same bytes.
            self.write(&path, bytes).await?;
        }
        Ok((hash, put))
    }

    /// Result of putting an object of `bytes` at `path`, and whether it has to be written; `holds`
    /// compares the stored bytes.
    pub(super) async fn weigh(
        &self,
        path: &Path,
        bytes: u64,
        renew_after_secs: i64,
        holds: impl Future<Output = Result<bool, LibraryError>>,
    ) -> Result<(Put, bool), LibraryError> {
        let entry = match self.found(path).await? {
            Found::Nothing => return Ok((Put::Stored, true)),
            Found::NoFile => return Ok((Put::Healed, true)),
            Found::Object(entry) => entry,
        };
        let is_whole = match entry.bytes == bytes {
            true => match holds.await {
                Err(error) if error.is_damage() => false,
                held => held?,
            },
            false => false,
        };
        let is_old = now_secs() - entry.written_secs > renew_after_secs;
        Ok(match is_whole {
            true => (Put::Known, is_old),
            false => (Put::Healed, true),
        })
    }

    pub(super) async fn write(&self, path: &Path, bytes: Bytes) -> Result<(), LibraryError> {
        self.clear_way(path)?;
        self.store
            .put(path, PutPayload::from_bytes(bytes))
            .await
            .map_err(|error| self.store_error(path, error))?;
        Ok(())
    }

    async fn holds(&self, path: &Path, bytes: &Bytes) -> Result<bool, LibraryError> {
        let mut at = 0;
        let mut pieces = std::pin::pin!(self.pieces(path, 0..bytes.len() as u64));
        while let Some(piece) = pieces.try_next().await? {
            let end = at + piece.len();
            if bytes.get(at..end) != Some(&piece[..]) {
                return Ok(false);
            }
            at = end;
        }
        Ok(at == bytes.len())
    }

    /// An object, whole, with its hash checked.
    ///
    /// # Errors
    /// [`LibraryError::Damaged`] where the bytes do not hash to the name.
    pub async fn object(&self, hash: &ContentHash) -> Result<Bytes, LibraryError> {
        let path = object_path(hash);
        let wrong = |error| self.store_error(&path, error);
        let bytes = self.store.get(&path).await.map_err(wrong)?;
        let bytes = bytes.bytes().await.map_err(wrong)?;
        let found = ContentHash::of(&bytes);
        if found == *hash {
            Ok(bytes)
        } else {
            let error = wrong_hash(hash, &found, bytes.len() as u64);
            Err(self.damaged(path.as_ref(), error))
        }
    }

    /// Bytes of an object, or `None` where there is none.
    pub async fn object_bytes(&self, hash: &ContentHash) -> Result<Option<u64>, LibraryError> {
        Ok(self
            .entry(&object_path(hash))
            .await?
            .map(|entry| entry.bytes))
    }

    /// `range` of an object, exactly; unchecked, the reader checks what the bytes are.
    ///
    /// # Errors
    /// [`LibraryError::Damaged`] where the object ends before the range does.
    pub async fn object_range(
        &self,
        hash: &ContentHash,
        range: Range<u64>,
    ) -> Result<Bytes, LibraryError> {
        self.range(&object_path(hash), range).await
    }

    /// [`Library::object_range`] of an asset's pack: the asset is there, so a pack that is not is damage.
    pub async fn pack_range(
        &self,
        pack: &ContentHash,
        range: Range<u64>,
    ) -> Result<Bytes, LibraryError> {
        match self.object_range(pack, range).await {
            Err(LibraryError::NoObject { path, .. }) => {
                let error = FormatError::new("pack", "that of an asset that is there", "none");
                Err(self.damaged(path, error))
            }
            read => read,
        }
    }

    async fn range(&self, path: &Path, range: Range<u64>) -> Result<Bytes, LibraryError> {
        if range.is_empty() {
            return Ok(Bytes::new());
        }
        let short = |found: String| {
            let expected = format!("at least {} bytes", range.end);
            self.damaged(path.as_ref(), FormatError::new("object", expected, found))
        };
        match self.store.get_range(path, range.clone()).await {
            Ok(bytes) if bytes.len() as u64 == range.end - range.start => Ok(bytes),
            // Stores answer a range that ends too late with what there is, and one that starts too late with an error of no type.
            Ok(bytes) => Err(short(format!("{}", range.start + bytes.len() as u64))),
            Err(error) if is_transport(&error) => Err(self.store_error(path, error)),
            Err(error) => match self.entry(path).await? {
                Some(entry) if entry.bytes < range.end => Err(short(format!("{}", entry.bytes))),
                _ => Err(self.store_error(path, error)),
            },
        }
    }

    /// `range` of an object in pieces of a few MiB, each read when it is asked for.
    pub fn object_pieces(
        &self,
        hash: &ContentHash,
        range: Range<u64>,
    ) -> impl Stream<Item = Result<Bytes, LibraryError>> + Send + use<> {
        self.pieces(&object_path(hash), range)
    }

    /// That `hasher`, which has seen all `bytes` of an object, found the object's name.
    ///
    /// # Errors
    /// [`LibraryError::Damaged`] where it found another.
    pub fn check_hash(
        &self,
        hash: &ContentHash,
        hasher: ContentHasher,
        bytes: u64,
    ) -> Result<(), LibraryError> {
        let found = hasher.finish();
        match found == *hash {
            true => Ok(()),
            false => {
                let error = wrong_hash(hash, &found, bytes);
                Err(self.damaged(object_path(hash).as_ref(), error))
            }
        }
    }

    pub(super) fn pieces(
        &self,
        path: &Path,
        range: Range<u64>,
    ) -> impl Stream<Item = Result<Bytes, LibraryError>> + Send + use<> {
        let (library, path) = (self.clone(), path.clone());
        futures_util::stream::try_unfold(range.start, move |at| {
            let (library, path) = (library.clone(), path.clone());
            async move {
                if at >= range.end {
                    return Ok(None);
                }
                let end = range.end.min(at + PIECE_BYTES);
                let piece = library.range(&path, at..end).await?;
                Ok(Some((piece, end)))
            }
        })
    }

    /// Re-hashes an object of any size in bounded memory; gives its bytes.
    pub async fn check_object(&self, hash: &ContentHash) -> Result<u64, LibraryError> {
        let path = object_path(hash);
        let Some(entry) = self.entry(&path).await? else {
            return Err(self.no_object(&path));
        };
        let mut hasher = ContentHasher::default();
        let mut pieces = std::pin::pin!(self.pieces(&path, 0..entry.bytes));
        while let Some(piece) = pieces.try_next().await? {
            hasher.update(&piece);
        }
        self.check_hash(hash, hasher, entry.bytes)?;
        Ok(entry.bytes)
    }

    /// Every file below `objects/`, in no order, also those that are no objects.
    pub fn objects(&self) -> impl Stream<Item = Result<ObjectEntry, LibraryError>> + Send + '_ {
        let folder = Path::from(OBJECTS);
        let at = folder.clone();
        self.store.list(Some(&folder)).map(move |listed| {
            listed
                .map(|meta| ObjectEntry::of(meta, object_path))
                .map_err(|error| self.store_error(&at, error))
        })
    }

    /// What lies at `path`, or `None`.
    pub(super) async fn entry(&self, path: &Path) -> Result<Option<ObjectEntry>, LibraryError> {
        match self.store.head(path).await {
            Ok(meta) => Ok(Some(ObjectEntry::of(meta, object_path))),
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(self.store_error(path, error)),
        }
    }

    /// Finds the file at `path`.
    pub(super) async fn found(&self, path: &Path) -> Result<Found, LibraryError> {
        match self.entry(path).await {
            Ok(Some(entry)) => Ok(Found::Object(entry)),
            Ok(None) if self.has_obstacle(path) => Ok(Found::NoFile),
            Ok(None) => Ok(Found::Nothing),
            Err(error) if error.is_damage() => Ok(Found::NoFile),
            Err(error) => Err(error),
        }
    }

    /// Whether an object is there and its bytes match its hash.
    pub(super) async fn is_whole(&self, hash: &ContentHash) -> Result<bool, LibraryError> {
        match self.check_object(hash).await {
            Ok(_) => Ok(true),
            Err(error) if error.is_damage() || error.is_missing() => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Removes an object; one that is gone already is no error.
    pub(super) async fn delete(&self, path: &Path) -> Result<(), LibraryError> {
        match self.store.delete(path).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(self.store_error(path, error)),
        }
    }
}

impl ObjectEntry {
    /// `path_of` says where what has a name lies.
    pub(super) fn of(
        meta: object_store::ObjectMeta,
        path_of: impl Fn(&ContentHash) -> Path,
    ) -> Self {
        let name = meta.location.filename().and_then(|name| name.parse().ok());
        Self {
            hash: name.filter(|hash| path_of(hash) == meta.location),
            path: meta.location.to_string(),
            bytes: meta.size,
            written_secs: meta.last_modified.timestamp(),
        }
    }
}

/// Seconds since 1970 UTC; 0 on a clock before that.
pub(super) fn now_secs() -> i64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    since.map_or(0, |since| since.as_secs() as i64)
}

/// Whether a store was not reached, or did not answer: it is no use to ask it what is there.
fn is_transport(error: &object_store::Error) -> bool {
    use object_store::client::{HttpError, HttpErrorKind};
    let mut cause: Option<&dyn std::error::Error> = Some(error);
    while let Some(error) = cause {
        if let Some(error) = error.downcast_ref::<HttpError>() {
            return !matches!(error.kind(), HttpErrorKind::Decode | HttpErrorKind::Unknown);
        }
        cause = error.source();
    }
    false
}
