//! Sweeping objects that hang on no scene, old notes of ingest, and staged files of killed writers.
//!
//! Safe beside a running ingest: objects younger than the grace period are spared, and so is what a younger build record or
//! plan names; an ingest renews the age of what it uses again, the age is read again just before something goes, and
//! `publish` checks that everything is there. An ingest that runs longer than the grace period, or reuses a build in the
//! moment in which it is swept, can lose objects; its publish then fails, the old scene stays, and a second run builds anew.

use std::collections::BTreeSet;

use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::ContentHash;
use object_store::path::Path;
use serde::de::IgnoredAny;

use super::objects::now_secs;
use super::{Library, LibraryError, ObjectEntry, Reach, object_path};

/// Build records looked at at once.
const READS_AT_ONCE: usize = 16;

/// How to sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GcOptions {
    /// Objects younger than this stay, seconds.
    pub grace_secs: u64,
    /// Say what would go, and leave it.
    pub dry_run: bool,
}

/// What a sweep did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct GcReport {
    /// Objects that scenes need.
    pub live: u64,
    /// Objects that none needs, still too young to go.
    pub young: u64,
    /// Objects removed.
    pub removed: u64,
    /// Their bytes.
    pub removed_bytes: u64,
    /// Build records that stay.
    pub records: u64,
    /// Build records removed: of objects that go, or that are gone.
    pub removed_records: u64,
    /// Plans that stay.
    pub plans: u64,
    /// Plans removed.
    pub removed_plans: u64,
    /// Staged files that stay: their writers may be running.
    pub staged: u64,
    /// Staged files removed.
    pub removed_staged: u64,
    /// Their bytes.
    pub removed_staged_bytes: u64,
}

/// What notes of ingest keep beside the scenes.
#[derive(Debug, Default)]
struct Kept {
    objects: BTreeSet<ContentHash>,
    /// Keys of records.
    builds: BTreeSet<ContentHash>,
}

impl Library {
    /// Removes what no scene needs. A damaged scene or asset ends it before anything is removed.
    pub async fn gc(&self, options: GcOptions) -> Result<GcReport, LibraryError> {
        // Listed before marking: whatever a publish between the two makes live was either listed and is then marked, or was
        // not listed and is not touched.
        let listed: Vec<_> = self.objects().try_collect().await?;
        let records: Vec<_> = self.builds().try_collect().await?;
        let plans = self.plans().await?;
        let live = self.live_objects().await?;
        let mut report = GcReport::default();
        let mut kept = Kept::default();
        for plan in plans {
            self.sweep_plan(&plan, options, &mut kept, &mut report)
                .await?;
        }
        let there: BTreeSet<_> = listed.iter().filter_map(|entry| entry.hash).collect();
        self.sweep_records(records, &there, &live, options, &mut kept, &mut report)
            .await?;
        for entry in listed {
            let Some(hash) = entry.hash else { continue };
            if live.contains(&hash) {
                report.live += 1;
                continue;
            }
            let path = object_path(&hash);
            let Some(now) = self.entry(&path).await? else {
                continue;
            };
            if is_young(&now, options) || kept.objects.contains(&hash) {
                report.young += 1;
                continue;
            }
            if !options.dry_run {
                self.delete(&path).await?;
            }
            report.removed += 1;
            report.removed_bytes += now.bytes;
        }
        self.sweep_staged(options, &mut report).await?;
        Ok(report)
    }

    async fn sweep_staged(
        &self,
        options: GcOptions,
        report: &mut GcReport,
    ) -> Result<(), LibraryError> {
        for staged in self.staged().await? {
            if is_young_since(staged.written_secs, options) {
                report.staged += 1;
                continue;
            }
            if !options.dry_run {
                self.remove_staged(&staged)?;
            }
            report.removed_staged += 1;
            report.removed_staged_bytes += staged.bytes;
        }
        Ok(())
    }

    async fn sweep_plan(
        &self,
        entry: &ObjectEntry,
        options: GcOptions,
        kept: &mut Kept,
        report: &mut GcReport,
    ) -> Result<(), LibraryError> {
        let path = Path::from(entry.path.as_str());
        let name = path.filename().unwrap_or_default();
        // Read again: a job may have renewed it.
        let Some(now) = self.entry(&path).await? else {
            return Ok(());
        };
        match is_young(&now, options) {
            true => {
                report.plans += 1;
                match self.plan::<IgnoredAny>(name).await {
                    Ok(plan) => {
                        kept.objects.extend(plan.objects);
                        kept.builds.extend(plan.builds);
                    }
                    // What it kept cannot be known; its jobs will say that it is damaged.
                    Err(LibraryError::Damaged { .. } | LibraryError::Name(_)) => {}
                    Err(error) if error.is_missing() => {}
                    Err(error) => return Err(error),
                }
            }
            false => {
                report.removed_plans += 1;
                if !options.dry_run {
                    self.delete(&path).await?;
                }
            }
        }
        Ok(())
    }

    /// Drops the records that nothing keeps, before their objects go; what the others name is added to `kept`.
    async fn sweep_records(
        &self,
        records: Vec<ObjectEntry>,
        there: &BTreeSet<ContentHash>,
        live: &Reach,
        options: GcOptions,
        kept: &mut Kept,
        report: &mut GcReport,
    ) -> Result<(), LibraryError> {
        let planned = &kept.builds;
        let looks = records.into_iter().map(|entry| async move {
            let stays = self.record_stays(&entry, there, live, planned, options);
            stays.await.map(|stays| (entry, stays))
        });
        let mut looks = std::pin::pin!(stream::iter(looks).buffered(READS_AT_ONCE));
        let mut objects = vec![];
        while let Some((entry, stays)) = looks.try_next().await? {
            match stays {
                Some(named) => {
                    report.records += 1;
                    objects.extend(named);
                }
                None => {
                    report.removed_records += 1;
                    if !options.dry_run {
                        self.delete(&Path::from(entry.path)).await?;
                    }
                }
            }
        }
        kept.objects.extend(objects);
        Ok(())
    }

    /// The objects of a record that stays; `None` for one that goes.
    async fn record_stays(
        &self,
        entry: &ObjectEntry,
        there: &BTreeSet<ContentHash>,
        live: &Reach,
        planned: &BTreeSet<ContentHash>,
        options: GcOptions,
    ) -> Result<Option<Vec<ContentHash>>, LibraryError> {
        let Some(key) = entry.hash else {
            return Ok(Some(vec![]));
        };
        let record = match self.build::<IgnoredAny>(&key).await {
            Ok(Some(record)) => record,
            // Removed since it was listed.
            Ok(None) => return Ok(Some(vec![])),
            // Another version may have written it just now.
            Err(LibraryError::Damaged { .. }) if is_young(entry, options) => {
                return Ok(Some(vec![]));
            }
            Err(LibraryError::Damaged { .. }) => return Ok(None),
            Err(error) => return Err(error),
        };
        let objects = record.objects();
        for hash in &objects {
            // Not listed: stored since, or gone.
            if !there.contains(hash) && self.object_bytes(hash).await?.is_none() {
                return Ok(None);
            }
        }
        if objects.iter().all(|hash| live.contains(hash)) {
            return Ok(Some(vec![]));
        }
        let path = Path::from(entry.path.as_str());
        // Read again: an ingest may have renewed it.
        let now = self.entry(&path).await?;
        let stays = planned.contains(&key) || now.is_some_and(|now| is_young(&now, options));
        Ok(stays.then(|| objects.to_vec()))
    }

    async fn live_objects(&self) -> Result<Reach, LibraryError> {
        let mut live = Reach::default();
        for name in self.scene_names(None, usize::MAX).await? {
            match self.reference(&name).await {
                Ok(reference) => live.merge(self.reach(&reference.scene).await?),
                Err(LibraryError::NoScene { .. }) => self.check_removed(&name).await?,
                Err(error) => return Err(error),
            }
        }
        Ok(live)
    }
}

fn is_young(entry: &ObjectEntry, options: GcOptions) -> bool {
    is_young_since(entry.written_secs, options)
}

fn is_young_since(written_secs: i64, options: GcOptions) -> bool {
    let grace_secs = i64::try_from(options.grace_secs).unwrap_or(i64::MAX);
    now_secs() - written_secs < grace_secs
}
