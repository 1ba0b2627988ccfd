//! Repair of a copy's target: all its files are read, damaged ones are sent again.

use std::collections::{BTreeMap, BTreeSet};

use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::ContentHash;
use serde::de::IgnoredAny;

use super::copy::{Copying, OBJECTS_AT_ONCE};
use super::notes::build_path;
use super::{BuildRecord, Library, LibraryError, ObjectEntry, Reach, object_path};

/// Build records looked at at once.
const RECORDS_AT_ONCE: usize = 16;

/// Files that were damaged, or missing though referenced, stored again.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Repaired {
    /// Number.
    pub objects: u64,
    /// Their bytes.
    pub bytes: u64,
}

impl Repaired {
    /// Counts one of `bytes`.
    pub fn add(&mut self, bytes: u64) {
        self.objects += 1;
        self.bytes += bytes;
    }

    /// Adds another count.
    pub fn merge(&mut self, other: Repaired) {
        self.objects += other.objects;
        self.bytes += other.bytes;
    }
}

/// Objects that the scenes of a library need, as far as the scenes can be read.
#[derive(Debug, Default)]
pub(super) struct Held {
    needed: Reach,
    /// Unreadable scenes and assets among them.
    damaged: BTreeSet<ContentHash>,
    /// Errors of unreadable references.
    nameless: Vec<LibraryError>,
}

impl Held {
    pub fn needs(&self, hash: &ContentHash) -> bool {
        self.needed.contains(hash)
    }

    pub fn is_damaged(&self, hash: &ContentHash) -> bool {
        self.damaged.contains(hash)
    }

    pub fn add(&mut self, reach: Reach) {
        self.needed.merge(reach);
    }

    /// Whether unknown objects may be needed.
    fn is_partial(&self) -> bool {
        !self.damaged.is_empty() || !self.nameless.is_empty()
    }

    /// Records damage; other errors pass through.
    fn read<T>(
        &mut self,
        hash: ContentHash,
        read: Result<T, LibraryError>,
    ) -> Result<Option<T>, LibraryError> {
        self.needed.insert(hash);
        match read {
            Ok(read) => Ok(Some(read)),
            Err(error) if error.is_damage() || error.is_missing() => {
                self.damaged.insert(hash);
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }
}

/// Result for an object that no scene of the source needs.
enum Mended {
    Whole { bytes: u64 },
    Repaired { bytes: u64 },
    Dropped,
    Lost(LibraryError),
}

impl Library {
    /// Objects that the scenes of this library need; `gc` keeps them.
    pub(super) async fn held(&self) -> Result<Held, LibraryError> {
        let mut held = Held::default();
        for name in self.all_scene_names().await? {
            let hash = match self.reference(&name).await {
                Ok(reference) => reference.scene,
                Err(error) if error.is_missing() => continue,
                Err(error) if error.is_damage() => {
                    held.nameless.push(error);
                    continue;
                }
                Err(error) => return Err(error),
            };
            if held.needs(&hash) {
                continue;
            }
            let Some(scene) = held.read(hash, self.scene(&hash).await)? else {
                continue;
            };
            for texture in &scene.textures {
                held.needed.insert(texture.object);
            }
            let assets: BTreeSet<_> = scene.assets.iter().map(|used| used.asset).collect();
            let mut assets = stream::iter(
                assets
                    .into_iter()
                    .filter(|hash| !held.needs(hash))
                    .collect::<Vec<_>>(),
            )
            .map(|hash| async move { (hash, self.asset(&hash).await) })
            .buffered(OBJECTS_AT_ONCE);
            while let Some((hash, read)) = assets.next().await {
                if let Some(asset) = held.read(hash, read)? {
                    held.needed.insert(asset.hierarchy);
                    held.needed.insert(asset.pack);
                }
            }
        }
        Ok(held)
    }
}

impl Copying<'_> {
    /// Sends build records whose objects the target's scenes need, where the target lacks them.
    pub(super) async fn records(&mut self) -> Result<(), LibraryError> {
        let there = self.target.build_keys().await?;
        let mut asked = vec![];
        for (key, bytes) in self.source.build_keys().await? {
            // The same length counts as whole unless `verify` is set.
            if self.options.verify || there.get(&key) != Some(&bytes) {
                asked.push((key, there.contains_key(&key)));
            }
        }
        let sent: Vec<Option<(bool, u64)>> = stream::iter(asked)
            .map(|(key, is_there)| self.record(key, is_there))
            .buffer_unordered(RECORDS_AT_ONCE)
            .try_collect()
            .await?;
        for (was_damaged, bytes) in sent.into_iter().flatten() {
            self.report.records += 1;
            if was_damaged {
                self.report.repaired.add(bytes);
            }
        }
        Ok(())
    }

    /// Sends a record unless the target has a whole one. Returns whether it replaced a damaged one,
    /// and its bytes.
    async fn record(
        &self,
        key: ContentHash,
        is_there: bool,
    ) -> Result<Option<(bool, u64)>, LibraryError> {
        let path = build_path(&key);
        if is_there {
            match self.target.check_build(&key).await {
                Ok(()) => return Ok(None),
                Err(error) if error.is_damage() => {}
                Err(error) => return Err(error),
            }
        }
        let read = self.source.note_bytes::<BuildRecord<IgnoredAny>>(&path);
        let (record, bytes) = match read.await {
            Ok(Some(found)) => found,
            Ok(None) => return Ok(None),
            // Only the next ingest needs it, and builds without it.
            Err(error) if error.is_damage() => {
                tracing::warn!("build record {key} is not copied: {error}");
                return Ok(None);
            }
            Err(error) => return Err(error),
        };
        if !self.held.needed.contains_all(&record.objects()) {
            return Ok(None);
        }
        let length = bytes.len() as u64;
        self.target.write(&path, bytes).await?;
        Ok(Some((is_there, length)))
    }

    /// Checks the rest of the target. A damaged object is sent if the source has it, removed if no
    /// scene needs it, and else reported.
    pub(super) async fn mend_rest(&mut self) -> Result<(), LibraryError> {
        let (target, keys) = (self.target, self.target.build_keys().await?);
        let dropped: Vec<bool> = stream::iter(keys.into_keys())
            .map(|key| target.drop_damaged_record(key))
            .buffer_unordered(RECORDS_AT_ONCE)
            .try_collect()
            .await?;
        self.report.dropped += dropped.into_iter().filter(|dropped| *dropped).count() as u64;
        let mut listed = BTreeSet::new();
        let entries: Vec<_> = self.target.objects().try_collect().await?;
        for entry in entries {
            match entry.hash {
                Some(hash) => drop(listed.insert(hash)),
                None => self.report.unrepaired.push(format!(
                    "library {}: {}: expected an object, named objects/ab/ab12…, found another name",
                    self.target.location, entry.path
                )),
            }
        }
        loop {
            let held = self.target.held().await?;
            let all = listed.iter().chain(held.needed.objects());
            let unknown: BTreeSet<_> = all.filter(|hash| !self.known.contains(hash)).collect();
            let unknown: Vec<ContentHash> = unknown.into_iter().copied().collect();
            if unknown.is_empty() {
                let lost = held.nameless.iter().map(LibraryError::to_string);
                self.report.unrepaired.extend(lost);
                let no_files = self.target.no_files().await?;
                let no_files = no_files.iter().map(LibraryError::to_string);
                self.report.unrepaired.extend(no_files);
                return Ok(());
            }
            let looked: Vec<(ContentHash, Mended)> = stream::iter(unknown)
                .map(|hash| self.mend(hash, &held))
                .buffer_unordered(OBJECTS_AT_ONCE)
                .try_collect()
                .await?;
            // A repaired scene or asset may name objects not seen yet: the loop goes on.
            for (hash, mended) in looked {
                self.known.insert(hash);
                let report = &mut self.report;
                match mended {
                    Mended::Whole { bytes } => {
                        report.verified += 1;
                        report.verified_bytes += bytes;
                    }
                    Mended::Repaired { bytes } => {
                        report.copied += 1;
                        report.copied_bytes += bytes;
                        report.repaired.add(bytes);
                    }
                    Mended::Dropped => report.dropped += 1,
                    Mended::Lost(error) => report.unrepaired.push(error.to_string()),
                }
            }
        }
    }

    async fn mend(
        &self,
        hash: ContentHash,
        held: &Held,
    ) -> Result<(ContentHash, Mended), LibraryError> {
        let fault = match self.target.check_object(&hash).await {
            Ok(bytes) => return Ok((hash, Mended::Whole { bytes })),
            Err(error) if error.is_damage() || error.is_missing() => error,
            Err(error) => return Err(error),
        };
        if self.source.is_whole(&hash).await?
            && let Some(bytes) = self.source.object_bytes(&hash).await?
        {
            self.source.send_object(self.target, &hash, bytes).await?;
            return Ok((hash, Mended::Repaired { bytes }));
        }
        if held.needs(&hash) || held.is_partial() {
            return Ok((hash, Mended::Lost(fault)));
        }
        self.target.delete(&object_path(&hash)).await?;
        Ok((hash, Mended::Dropped))
    }
}

impl Library {
    /// Removes a damaged record; returns whether it did.
    async fn drop_damaged_record(&self, key: ContentHash) -> Result<bool, LibraryError> {
        match self.check_build(&key).await {
            Ok(()) => Ok(false),
            Err(error) if error.is_damage() => self.delete(&build_path(&key)).await.map(|()| true),
            Err(error) => Err(error),
        }
    }

    async fn build_keys(&self) -> Result<BTreeMap<ContentHash, u64>, LibraryError> {
        let named =
            |entry: ObjectEntry| async move { Ok(entry.hash.map(|key| (key, entry.bytes))) };
        self.builds().try_filter_map(named).try_collect().await
    }
}
