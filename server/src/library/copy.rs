//! Copies of scenes, with their build records, between libraries: only missing and damaged objects
//! are sent, objects before the names that need them.
//!
//! After an interruption at any point the names in the target point at whole scenes, and the next
//! copy sends only the rest.

use std::collections::BTreeSet;

use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::ContentHash;

use super::objects::{Found, now_secs};
use super::repair::{Held, Repaired};
use super::{Library, LibraryError, object_path};

/// Objects on their way at once.
pub(super) const OBJECTS_AT_ONCE: usize = 4;
/// Objects up to this are sent whole.
const WHOLE_BYTES: u64 = 4 * 1024 * 1024;
/// Scenes of one page of the source's list.
const SCENES_AT_ONCE: usize = 256;
/// What no scene of the target needs and is older than this is sent again, so that a `gc` that runs meanwhile does not take it.
const RENEW_AFTER_SECS: i64 = 60;

/// Options of a copy.
#[derive(Debug, Clone, Default)]
pub struct CopyOptions {
    /// Only these scenes; all where there are none.
    pub scenes: Vec<String>,
    /// Hash the target's objects, and send damaged ones again. Otherwise an object of the right
    /// length counts as whole.
    pub verify: bool,
    /// Remove scenes that the source no longer has.
    pub delete: bool,
    /// Accept a source without scenes, which mostly is the wrong one.
    pub allow_empty: bool,
}

/// What a copy did.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize)]
pub struct CopyReport {
    /// Scenes of the source that were looked at.
    pub scenes: u64,
    /// Those whose name points at something else in the target now.
    pub published: u64,
    /// Scenes removed from the target.
    pub removed: Vec<String>,
    /// Objects below the source's scenes.
    pub objects: u64,
    /// Objects sent, repaired ones included.
    pub copied: u64,
    /// Their bytes.
    pub copied_bytes: u64,
    /// Objects of the target that were hashed and are whole.
    pub verified: u64,
    /// Their bytes.
    pub verified_bytes: u64,
    /// Objects and build records that were damaged in the target, sent again.
    pub repaired: Repaired,
    /// Damaged objects and build records removed: no scene needs them, and the source lacks them.
    pub dropped: u64,
    /// Build records sent.
    pub records: u64,
    /// Faults of the target that the source cannot repair, one line each.
    pub unrepaired: Vec<String>,
}

/// A copy on its way.
pub(super) struct Copying<'a> {
    pub source: &'a Library,
    pub target: &'a Library,
    pub options: &'a CopyOptions,
    /// Objects that the target's scenes need, those published by this copy included.
    pub held: Held,
    /// Objects checked or sent by this copy.
    pub known: BTreeSet<ContentHash>,
    pub report: CopyReport,
}

/// Result for an object below the source's scenes.
enum Looked {
    /// The target has it; the bytes are 0 where it was not hashed.
    There {
        hashed_bytes: u64,
    },
    Sent {
        bytes: u64,
        was_damaged: bool,
    },
}

impl Library {
    /// Brings scenes from `source` to this library, with the records of their builds.
    ///
    /// # Errors
    /// A scene that the source lacks, a source without scenes, the first damaged object of the
    /// source, and the first failure of either store.
    pub async fn copy_from(
        &self,
        source: &Library,
        options: &CopyOptions,
    ) -> Result<CopyReport, LibraryError> {
        let names = match &options.scenes[..] {
            [] => source.names_to_copy(options).await?,
            names => names.iter().cloned().collect(),
        };
        let mut copying = Copying {
            source,
            target: self,
            options,
            held: self.held().await?,
            known: BTreeSet::new(),
            report: CopyReport::default(),
        };
        for name in &names {
            copying.scene(name).await?;
        }
        if options.delete {
            copying.remove_lost().await?;
        }
        copying.records().await?;
        if options.verify && options.scenes.is_empty() {
            copying.mend_rest().await?;
        }
        Ok(copying.report)
    }

    async fn names_to_copy(&self, options: &CopyOptions) -> Result<BTreeSet<String>, LibraryError> {
        let names = self.all_scene_names().await?;
        match names.is_empty() && !options.allow_empty {
            true => Err(LibraryError::Location {
                location: self.location.to_string(),
                expected: "scenes to copy (--allow-empty says that there are none)".to_owned(),
                found: "none".to_owned(),
            }),
            false => Ok(names),
        }
    }

    pub(super) async fn all_scene_names(&self) -> Result<BTreeSet<String>, LibraryError> {
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

    async fn points_at(&self, name: &str, scene: ContentHash) -> Result<bool, LibraryError> {
        match self.reference(name).await {
            Ok(reference) => Ok(reference.scene == scene),
            // It is written anew.
            Err(error) if error.is_missing() || error.is_damage() => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Sends an object to `target`, over what is there.
    ///
    /// # Errors
    /// Also [`LibraryError::Damaged`]: damaged bytes are not sent.
    pub(super) async fn send_object(
        &self,
        target: &Library,
        hash: &ContentHash,
        bytes: u64,
    ) -> Result<(), LibraryError> {
        let path = object_path(hash);
        if bytes <= WHOLE_BYTES {
            let object = self.object(hash).await?;
            return target.write(&path, object).await;
        }
        let pieces = self.object_pieces(hash, 0..bytes);
        target.upload(&path, hash, bytes, pieces).await
    }
}

impl Copying<'_> {
    async fn scene(&mut self, name: &str) -> Result<(), LibraryError> {
        let scene = self.source.reference(name).await?.scene;
        let reach = self.source.reach(&scene).await?;
        let unknown = reach.objects().filter(|hash| !self.known.contains(hash));
        let looked: Vec<(ContentHash, Looked)> = stream::iter(unknown.copied().collect::<Vec<_>>())
            .map(|hash| self.object(hash))
            .buffer_unordered(OBJECTS_AT_ONCE)
            .try_collect()
            .await?;
        self.report.scenes += 1;
        self.report.objects += reach.objects().count() as u64;
        for (hash, looked) in looked {
            self.count(hash, looked);
        }
        if !self.target.points_at(name, scene).await? {
            self.publish(name, scene).await?;
            self.report.published += 1;
        }
        self.held.add(reach);
        Ok(())
    }

    fn count(&mut self, hash: ContentHash, looked: Looked) {
        self.known.insert(hash);
        let report = &mut self.report;
        match looked {
            Looked::There { hashed_bytes: 0 } => {}
            Looked::There { hashed_bytes } => {
                report.verified += 1;
                report.verified_bytes += hashed_bytes;
            }
            Looked::Sent { bytes, was_damaged } => {
                report.copied += 1;
                report.copied_bytes += bytes;
                if was_damaged {
                    report.repaired.add(bytes);
                }
            }
        }
    }

    async fn object(&self, hash: ContentHash) -> Result<(ContentHash, Looked), LibraryError> {
        let path = object_path(&hash);
        let Some(bytes) = self.source.object_bytes(&hash).await? else {
            return Err(self.source.no_object(&path));
        };
        let was_damaged = match self.target.found(&path).await? {
            Found::Nothing => self.held.needs(&hash),
            Found::NoFile => true,
            Found::Object(entry) => {
                let is_whole = entry.bytes == bytes
                    && !self.held.is_damaged(&hash)
                    && (!self.options.verify || self.target.is_whole(&hash).await?);
                let is_young = now_secs() - entry.written_secs <= RENEW_AFTER_SECS;
                if is_whole && (self.held.needs(&hash) || is_young) {
                    let hashed_bytes = if self.options.verify { bytes } else { 0 };
                    return Ok((hash, Looked::There { hashed_bytes }));
                }
                !is_whole
            }
        };
        self.source.send_object(self.target, &hash, bytes).await?;
        Ok((hash, Looked::Sent { bytes, was_damaged }))
    }

    /// Publishes; a damaged scene or asset that only this finds is sent again.
    async fn publish(&mut self, name: &str, scene: ContentHash) -> Result<(), LibraryError> {
        let mut mended = BTreeSet::new();
        loop {
            let error = match self.target.publish(name, scene).await {
                Err(error) if error.is_damage() => error,
                other => return other.map(|_| ()),
            };
            let object = error.object().filter(|hash| mended.insert(*hash));
            let Some(object) = object else {
                return Err(error);
            };
            let Some(bytes) = self.source.object_bytes(&object).await? else {
                return Err(error);
            };
            self.source.send_object(self.target, &object, bytes).await?;
            let was_damaged = true;
            self.count(object, Looked::Sent { bytes, was_damaged });
        }
    }

    /// Removes scenes of the target that the source lacks now.
    async fn remove_lost(&mut self) -> Result<(), LibraryError> {
        // No listing shows a scene whose file is a folder; it is damaged, not lost.
        if let Some(fault) = self.source.no_files().await?.into_iter().next() {
            return Err(fault);
        }
        let kept = self.source.names_to_copy(self.options).await?;
        for name in self.target.all_scene_names().await? {
            if kept.contains(&name) {
                continue;
            }
            match self.target.remove(&name).await {
                Ok(()) => self.report.removed.push(name),
                // Removed by another process.
                Err(error) if error.is_missing() => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}
