//! Notes: small files that ingest keeps for itself in a library, beside objects and scenes.
//!
//! A note is a line with the hash of the rest, then JSON. It can be lost without loss of a scene, so whoever reads one that is
//! damaged goes on without it and says so.

mod builds;
mod plans;

use bytes::Bytes;
use lodestream_format::{ContentHash, FormatError};
use object_store::ObjectStoreExt;
use object_store::path::Path;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::objects::now_secs;
use super::{Library, LibraryError};

pub(super) use builds::{BUILDS, build_path};
pub use builds::{BuildRecord, Check};
pub(super) use plans::PLANS;
pub use plans::PlanNote;

impl Library {
    /// Writes a note, atomically.
    pub(super) async fn put_note(
        &self,
        path: &Path,
        note: &impl Serialize,
    ) -> Result<(), LibraryError> {
        let json = serde_json::to_string(note).map_err(|error| {
            self.damaged(path.as_ref(), FormatError::new("note", "to encode", error))
        })?;
        let text = format!("{}\n{json}\n", ContentHash::of(json.as_bytes()));
        self.write(path, text.into()).await
    }

    /// Reads a note; `None` where there is none.
    ///
    /// # Errors
    /// [`LibraryError::Damaged`] where the bytes are not those of a note of this kind.
    pub(super) async fn note<T: DeserializeOwned>(
        &self,
        path: &Path,
    ) -> Result<Option<T>, LibraryError> {
        Ok(self.note_bytes(path).await?.map(|(note, _)| note))
    }

    /// The same, with its bytes.
    pub(super) async fn note_bytes<T: DeserializeOwned>(
        &self,
        path: &Path,
    ) -> Result<Option<(T, Bytes)>, LibraryError> {
        let bytes = match self.store.get(path).await {
            Ok(found) => found.bytes().await,
            Err(error) => Err(error),
        };
        let bytes = match bytes {
            Ok(bytes) => bytes,
            Err(object_store::Error::NotFound { .. }) => return Ok(None),
            Err(error) => return Err(self.store_error(path, error)),
        };
        let note = parse(&bytes).map_err(|error| self.damaged(path.as_ref(), error))?;
        Ok(Some((note, bytes)))
    }

    /// Makes a note young again where it is older than `renew_after_secs`: `gc` then spares what it names.
    pub(super) async fn renew_note(
        &self,
        path: &Path,
        note: &impl Serialize,
        renew_after_secs: i64,
    ) -> Result<(), LibraryError> {
        match self.entry(path).await? {
            Some(entry) if now_secs() - entry.written_secs <= renew_after_secs => Ok(()),
            _ => self.put_note(path, note).await,
        }
    }
}

fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, FormatError> {
    let wrong = |expected: &str, found: String| FormatError::new("note", expected, found);
    let text = std::str::from_utf8(bytes).map_err(|error| wrong("UTF-8", error.to_string()))?;
    let split = text
        .strip_suffix('\n')
        .and_then(|text| text.split_once('\n'));
    let Some((hash, json)) = split else {
        let found = format!("{} bytes without them", bytes.len());
        return Err(wrong("two whole lines", found));
    };
    let expected: ContentHash = hash.parse()?;
    let found = ContentHash::of(json.as_bytes());
    if found != expected {
        return Err(wrong(
            &format!("JSON that hashes to {expected}"),
            found.to_string(),
        ));
    }
    serde_json::from_str(json).map_err(|error| wrong("JSON of this version", error.to_string()))
}
