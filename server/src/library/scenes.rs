//! Named references: the only things in a library that change.

use std::collections::BTreeSet;

use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::library::{SCENES, SceneReference, scene_path};
use lodestream_format::wire::{SceneEntry, ScenesPage};
use lodestream_format::{ContentHash, FormatError};
use object_store::path::Path;
use object_store::{ObjectStoreExt, PutPayload};

use super::objects::now_secs;
use super::{Library, LibraryError};

/// References read at once while a page of the list is made.
const READS_AT_ONCE: usize = 16;

fn reference_path(name: &str) -> Result<Path, LibraryError> {
    scene_path(name).map(Path::from).map_err(LibraryError::Name)
}

impl Library {
    /// Points `name` at `scene`, atomically, after checking that everything it needs is there.
    ///
    /// # Errors
    /// [`LibraryError::NoObject`] where something is missing: the name then points where it did.
    pub async fn publish(
        &self,
        name: &str,
        scene: ContentHash,
    ) -> Result<SceneReference, LibraryError> {
        let path = reference_path(name)?;
        for hash in self.reach(&scene).await?.objects() {
            if self.object_bytes(hash).await?.is_none() {
                return Err(self.no_object(&super::object_path(hash)));
            }
        }
        let reference = SceneReference {
            scene,
            published_secs: now_secs().max(0) as u64,
        };
        let json = serde_json::to_vec(&reference).map_err(|error| {
            let error = FormatError::new("scene reference", "to encode", error);
            self.damaged(path.as_ref(), error)
        })?;
        self.store
            .put(&path, PutPayload::from(json))
            .await
            .map_err(|error| self.store_error(&path, error))?;
        Ok(reference)
    }

    /// What `name` points at now.
    pub async fn reference(&self, name: &str) -> Result<SceneReference, LibraryError> {
        let path = reference_path(name)?;
        let wrong = |error| match error {
            object_store::Error::NotFound { .. } => self.no_scene(name),
            error => self.store_error(&path, error),
        };
        let json = self.store.get(&path).await.map_err(wrong)?;
        let json = json.bytes().await.map_err(wrong)?;
        serde_json::from_slice(&json).map_err(|error| {
            let error = FormatError::new("scene reference", "its JSON", error);
            self.damaged(path.as_ref(), error)
        })
    }

    /// Takes the name away; its objects stay until `gc`.
    pub async fn remove(&self, name: &str) -> Result<(), LibraryError> {
        let path = reference_path(name)?;
        if self.entry(&path).await?.is_none() {
            return Err(self.no_scene(name));
        }
        self.delete(&path).await
    }

    fn no_scene(&self, name: &str) -> LibraryError {
        LibraryError::NoScene {
            location: self.location.to_string(),
            name: name.to_owned(),
        }
    }

    /// At most `limit` scenes whose names come after `after`.
    pub async fn scenes(
        &self,
        after: Option<&str>,
        limit: usize,
    ) -> Result<ScenesPage, LibraryError> {
        let mut names = self.scene_names(after, limit.saturating_add(1)).await?;
        let more = names.len() > limit;
        names.truncate(limit);
        let next = names.last().filter(|_| more).cloned();
        let reads = names.into_iter().map(|name| async move {
            match self.reference(&name).await {
                Ok(reference) => Ok(Some(SceneEntry { name, reference })),
                // Removed since it was listed.
                Err(LibraryError::NoScene { .. }) => Ok(None),
                Err(error) => Err(error),
            }
        });
        let scenes: Vec<_> = stream::iter(reads)
            .buffered(READS_AT_ONCE)
            .try_filter_map(|entry| async move { Ok(entry) })
            .try_collect()
            .await?;
        Ok(ScenesPage { scenes, next })
    }

    /// The first `limit` names after `after`, in byte order. Files that no scene can be named are passed over.
    pub async fn scene_names(
        &self,
        after: Option<&str>,
        limit: usize,
    ) -> Result<Vec<String>, LibraryError> {
        let folder = Path::from(SCENES);
        let mut listed = self.store.list(Some(&folder));
        let mut names = BTreeSet::new();
        // Stores list in any order: the smallest names are kept while the rest goes by.
        while let Some(meta) = listed.next().await {
            let meta = meta.map_err(|error| self.store_error(&folder, error))?;
            let Some(name) = meta.location.filename() else {
                continue;
            };
            let ours = reference_path(name).is_ok_and(|path| path == meta.location);
            if ours && after.is_none_or(|after| name > after) {
                names.insert(name.to_owned());
                if names.len() > limit {
                    names.pop_last();
                }
            }
        }
        Ok(names.into_iter().collect())
    }

    /// Whether the store answers.
    pub async fn ready(&self) -> Result<(), LibraryError> {
        if !self.location.contains("://") {
            // A local listing of a folder that is gone is empty, not an error.
            return Self::open(&self.location).map(|_| ());
        }
        let folder = Path::from(SCENES);
        match self.store.list(Some(&folder)).next().await {
            Some(Err(error)) => Err(self.store_error(&folder, error)),
            _ => Ok(()),
        }
    }
}
