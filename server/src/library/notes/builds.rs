//! Build records: which asset a mesh became, found again by a key that names mesh, options and builder.
//!
//! ```text
//! builds/ab/ab12…   a note (`notes`), named by the key
//! ```
//!
//! A record promises nothing: its objects may be gone, so [`Library::has_build`] is asked before one is used. While a record is
//! younger than the grace period of `gc`, its objects stay.

use futures_util::{Stream, StreamExt};
use lodestream_format::ContentHash;
use object_store::path::Path;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::library::{Library, LibraryError, ObjectEntry, object_path};

pub(in crate::library) const BUILDS: &str = "builds";

/// How objects are checked before they are reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Check {
    /// Read and hash all bytes.
    #[default]
    Hash,
    /// Compare lengths alone.
    Length,
}

/// What a build gave: the objects, and `R`, what else is to be known of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BuildRecord<R> {
    /// The asset object.
    pub asset: ContentHash,
    /// The asset's hierarchy.
    pub hierarchy: ContentHash,
    /// Bytes of the hierarchy object.
    pub hierarchy_bytes: u64,
    /// The asset's pack.
    pub pack: ContentHash,
    /// Bytes of the pack.
    pub pack_bytes: u64,
    /// The build's own report.
    pub report: R,
}

impl<R> BuildRecord<R> {
    /// Asset, hierarchy and pack.
    pub fn objects(&self) -> [ContentHash; 3] {
        [self.asset, self.hierarchy, self.pack]
    }
}

/// Where the record of `key` lies.
pub(in crate::library) fn build_path(key: &ContentHash) -> Path {
    let name = key.to_string();
    Path::from(format!("{BUILDS}/{}/{name}", &name[..2]))
}

impl Library {
    /// Stores what `key` became, in place of what it said before.
    pub async fn put_build<R: Serialize>(
        &self,
        key: &ContentHash,
        record: &BuildRecord<R>,
    ) -> Result<(), LibraryError> {
        self.put_note(&build_path(key), record).await
    }

    /// What `key` became, or `None` where that is not known.
    ///
    /// # Errors
    /// [`LibraryError::Damaged`] where the record cannot be read, also where another version wrote it.
    pub async fn build<R: DeserializeOwned>(
        &self,
        key: &ContentHash,
    ) -> Result<Option<BuildRecord<R>>, LibraryError> {
        self.note(&build_path(key)).await
    }

    /// Checks a record against its own hash; a missing record passes.
    pub(crate) async fn check_build(&self, key: &ContentHash) -> Result<(), LibraryError> {
        let path = build_path(key);
        let note = self.note::<serde::de::IgnoredAny>(&path).await;
        note.map(|_| ())
    }

    /// Makes a record young again where it is older than `renew_after_secs`.
    pub async fn renew_build<R: Serialize>(
        &self,
        key: &ContentHash,
        record: &BuildRecord<R>,
        renew_after_secs: i64,
    ) -> Result<(), LibraryError> {
        self.renew_note(&build_path(key), record, renew_after_secs)
            .await
    }

    /// Checks the objects of a record: hashes the asset; hierarchy and pack as `check` says.
    ///
    /// # Errors
    /// [`LibraryError::NoObject`] and [`LibraryError::Damaged`] say what is not as the record promises; others that the store
    /// failed.
    pub async fn has_build<R>(
        &self,
        record: &BuildRecord<R>,
        check: Check,
    ) -> Result<(), LibraryError> {
        let asset = self.asset(&record.asset).await?;
        let expected = format!(
            "hierarchy {}, pack {} of {} bytes",
            record.hierarchy, record.pack, record.pack_bytes
        );
        let found = format!(
            "hierarchy {}, pack {} of {} bytes",
            asset.hierarchy,
            asset.pack,
            asset.pack_bytes()
        );
        if expected != found {
            let error = lodestream_format::FormatError::new("asset", expected, found);
            return Err(self.damaged(object_path(&record.asset), error));
        }
        for (hash, bytes) in [
            (&record.hierarchy, record.hierarchy_bytes),
            (&record.pack, record.pack_bytes),
        ] {
            let path = object_path(hash);
            let found = match check {
                Check::Hash => Some(self.check_object(hash).await?),
                Check::Length => self.object_bytes(hash).await?,
            };
            match found {
                Some(found) if found == bytes => {}
                Some(found) => {
                    let expected = format!("{bytes} bytes");
                    let error = lodestream_format::FormatError::new("object", expected, found);
                    return Err(self.damaged(path, error));
                }
                None => return Err(self.no_object(&path)),
            }
        }
        Ok(())
    }

    /// Every file below `builds/`; `hash` is the key.
    pub(crate) fn builds(
        &self,
    ) -> impl Stream<Item = Result<ObjectEntry, LibraryError>> + Send + '_ {
        let folder = Path::from(BUILDS);
        let at = folder.clone();
        self.store.list(Some(&folder)).map(move |listed| {
            listed
                .map(|meta| ObjectEntry::of(meta, build_path))
                .map_err(|error| self.store_error(&at, error))
        })
    }
}
