//! Sweeping objects that hang on no scene.
//!
//! Safe beside a running ingest: objects younger than the grace period are spared, an ingest renews the age of old objects
//! that it uses again, the age is read again just before an object goes, and `publish` checks that everything is there.
//! An ingest that runs longer than the grace period can lose objects; its publish then fails and the old scene stays.

use futures_util::TryStreamExt;

use super::objects::now_secs;
use super::{Library, LibraryError, Reach, object_path};

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
}

impl Library {
    /// Removes the objects that no scene needs. A damaged scene or asset ends it before anything is removed.
    pub async fn gc(&self, options: GcOptions) -> Result<GcReport, LibraryError> {
        // Listed before marking: whatever a publish between the two makes live was either listed and is then marked, or was
        // not listed and is not touched.
        let listed: Vec<_> = self.objects().try_collect().await?;
        let live = self.live_objects().await?;
        let mut report = GcReport::default();
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
            if now_secs() - now.written_secs < options.grace_secs as i64 {
                report.young += 1;
                continue;
            }
            if !options.dry_run {
                self.delete(&path).await?;
            }
            report.removed += 1;
            report.removed_bytes += now.bytes;
        }
        Ok(report)
    }

    async fn live_objects(&self) -> Result<Reach, LibraryError> {
        let mut live = Reach::default();
        for name in self.scene_names(None, usize::MAX).await? {
            match self.reference(&name).await {
                Ok(reference) => live.merge(self.reach(&reference.scene).await?),
                // Removed since it was listed.
                Err(LibraryError::NoScene { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(live)
    }
}
