//! A library's scenes in another library: only what is missing there is read and sent, objects before the names that need them.
//!
//! Interrupted at any point, the names in the target point at whole scenes, and the next copy sends only what the last one had not.

use std::collections::BTreeSet;

use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::ContentHash;

use super::objects::now_secs;
use super::{Library, LibraryError, Reach, object_path};

/// Objects on their way at once.
const OBJECTS_AT_ONCE: usize = 4;
/// Objects up to this are sent whole.
const WHOLE_BYTES: u64 = 4 * 1024 * 1024;
/// Scenes of one page of the source's list.
const SCENES_AT_ONCE: usize = 256;
/// What no scene of the target needs and is older than this is sent again, so that a `gc` that runs meanwhile does not take it.
const RENEW_AFTER_SECS: i64 = 60;

/// What a copy did.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize)]
pub struct CopyReport {
    /// Scenes of the source that were looked at.
    pub scenes: u64,
    /// Those whose name points at something else in the target now.
    pub published: u64,
    /// Objects below them.
    pub objects: u64,
    /// Those that were sent.
    pub copied: u64,
    /// Their bytes.
    pub copied_bytes: u64,
}

impl Library {
    /// Brings `names`, or all scenes where there are none, from `source` to this library. Names that only this library has stay.
    ///
    /// # Errors
    /// Where a name is not in the source, and at the first object that is damaged there or that either store fails at.
    pub async fn copy_from(
        &self,
        source: &Library,
        names: &[String],
    ) -> Result<CopyReport, LibraryError> {
        let all = match names {
            [] => source.all_scene_names().await?,
            names => names.iter().cloned().collect(),
        };
        let mut held = self.held().await?;
        let mut report = CopyReport::default();
        for name in all {
            let scene = source.reference(&name).await?.scene;
            let reach = source.reach(&scene).await?;
            let sent: Vec<Option<u64>> = stream::iter(reach.objects().copied())
                .map(|hash| self.copy_object(source, hash, held.contains(&hash)))
                .buffer_unordered(OBJECTS_AT_ONCE)
                .try_collect()
                .await?;
            report.scenes += 1;
            report.objects += sent.len() as u64;
            report.copied += sent.iter().flatten().count() as u64;
            report.copied_bytes += sent.iter().flatten().sum::<u64>();
            if !self.points_at(&name, scene).await? {
                self.publish_copied(source, &name, scene).await?;
                report.published += 1;
            }
            held.merge(reach);
        }
        Ok(report)
    }

    /// Publishes; an object of the right length and other bytes, which is found only now, is sent anew.
    async fn publish_copied(
        &self,
        source: &Library,
        name: &str,
        scene: ContentHash,
    ) -> Result<(), LibraryError> {
        let mut mended = BTreeSet::new();
        loop {
            let damaged = match self.publish(name, scene).await {
                Err(LibraryError::Damaged { path, error, .. }) => (path, error),
                other => return other.map(|_| ()),
            };
            let object = damaged
                .0
                .rsplit('/')
                .next()
                .and_then(|hash| hash.parse().ok());
            let object: ContentHash = match object.filter(|hash| mended.insert(*hash)) {
                Some(object) => object,
                None => return Err(self.damaged(damaged.0, damaged.1)),
            };
            let bytes = source.object(&object).await?;
            self.write(&object_path(&object), bytes).await?;
        }
    }

    async fn all_scene_names(&self) -> Result<BTreeSet<String>, LibraryError> {
        let mut all = BTreeSet::new();
        loop {
            let after = all.last().map(String::as_str);
            let names = self.scene_names(after, SCENES_AT_ONCE).await?;
            if names.is_empty() {
                return Ok(all);
            }
            all.extend(names);
        }
    }

    /// What the scenes of this library need: `gc` does not take it. A scene that cannot be read protects nothing.
    async fn held(&self) -> Result<Reach, LibraryError> {
        let mut held = Reach::default();
        for name in self.all_scene_names().await? {
            let reach = match self.reference(&name).await {
                Ok(reference) => self.reach(&reference.scene).await,
                Err(error) => Err(error),
            };
            match reach {
                Ok(reach) => held.merge(reach),
                Err(LibraryError::Store { .. }) => reach.map(|_| ())?,
                Err(error) => tracing::warn!("{error}"),
            }
        }
        Ok(held)
    }

    async fn points_at(&self, name: &str, scene: ContentHash) -> Result<bool, LibraryError> {
        match self.reference(name).await {
            Ok(reference) => Ok(reference.scene == scene),
            Err(error) if error.is_missing() => Ok(false),
            // It is written anew.
            Err(LibraryError::Damaged { .. }) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Gives the bytes of an object that had to be sent.
    async fn copy_object(
        &self,
        source: &Library,
        hash: ContentHash,
        is_held: bool,
    ) -> Result<Option<u64>, LibraryError> {
        let path = object_path(&hash);
        let Some(bytes) = source.object_bytes(&hash).await? else {
            return Err(source.no_object(&path));
        };
        if let Some(entry) = self.entry(&path).await? {
            let is_young = now_secs() - entry.written_secs <= RENEW_AFTER_SECS;
            if entry.bytes == bytes && (is_held || is_young) {
                return Ok(None);
            }
        }
        if bytes <= WHOLE_BYTES {
            let object = source.object(&hash).await?;
            self.write(&path, object).await?;
        } else {
            let pieces = source.object_pieces(&hash, 0..bytes);
            self.upload(&path, &hash, bytes, pieces).await?;
        }
        Ok(Some(bytes))
    }
}
