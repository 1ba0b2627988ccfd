//! Plans: which mesh of a scene is built by which job; one for each scene name.
//!
//! ```text
//! plans/NAME   a note (`notes`)
//! ```
//!
//! While a plan is younger than the grace period of `gc`, its objects and the builds that it waits for stay.

use futures_util::TryStreamExt;
use lodestream_format::ContentHash;
use lodestream_format::library::scene_path;
use object_store::path::Path;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::library::{Library, LibraryError, ObjectEntry};

pub(in crate::library) const PLANS: &str = "plans";

/// A plan as the library sees it; `P` is what its jobs read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlanNote<P> {
    /// Objects that the scene will need and that no job makes.
    pub objects: Vec<ContentHash>,
    /// Keys of the builds that make the rest.
    pub builds: Vec<ContentHash>,
    /// The rest.
    pub plan: P,
}

fn plan_path(scene: &str) -> Result<Path, LibraryError> {
    scene_path(scene).map_err(LibraryError::Name)?;
    Ok(Path::from(format!("{PLANS}/{scene}")))
}

impl Library {
    /// Stores the plan of `scene`, in place of an earlier one.
    pub async fn put_plan<P: Serialize>(
        &self,
        scene: &str,
        plan: &PlanNote<P>,
    ) -> Result<(), LibraryError> {
        self.put_note(&plan_path(scene)?, plan).await
    }

    /// The plan of `scene`.
    ///
    /// # Errors
    /// [`LibraryError::NoPlan`] where there is none, [`LibraryError::Damaged`] where it cannot be read.
    pub async fn plan<P: DeserializeOwned>(
        &self,
        scene: &str,
    ) -> Result<PlanNote<P>, LibraryError> {
        let found = self.note(&plan_path(scene)?).await?;
        found.ok_or_else(|| LibraryError::NoPlan {
            location: self.location().to_owned(),
            scene: scene.to_owned(),
        })
    }

    /// Makes a plan young again where it is older than `renew_after_secs`.
    pub async fn renew_plan<P: Serialize>(
        &self,
        scene: &str,
        plan: &PlanNote<P>,
        renew_after_secs: i64,
    ) -> Result<(), LibraryError> {
        self.renew_note(&plan_path(scene)?, plan, renew_after_secs)
            .await
    }

    /// Every file below `plans/`.
    pub(in crate::library) async fn plans(&self) -> Result<Vec<ObjectEntry>, LibraryError> {
        let folder = Path::from(PLANS);
        self.store
            .list(Some(&folder))
            .map_ok(|meta| ObjectEntry::of(meta, |_| Path::default()))
            .try_collect()
            .await
            .map_err(|error| self.store_error(&folder, error))
    }
}
