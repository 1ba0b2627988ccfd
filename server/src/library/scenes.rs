//! Named references: the only things in a library that change.

use std::collections::BTreeSet;

use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::library::{SCENES, SceneReference, scene_path};
use lodestream_format::wire::{SceneEntry, ScenesPage};
use lodestream_format::{ContentHash, FormatError};
use object_store::path::Path;
use object_store::{ObjectStoreExt, PutMode, PutPayload, UpdateVersion};

use super::objects::now_secs;
use super::{Library, LibraryError};

/// References read at once while a page of the list is made.
const READS_AT_ONCE: usize = 16;

fn reference_path(name: &str) -> Result<Path, LibraryError> {
    scene_path(name).map(Path::from).map_err(LibraryError::Name)
}

/// What a name has to point at for a publication to count.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Replaces {
    /// Whatever it is: of publications at the same time the last one counts.
    #[default]
    Anything,
    /// No scene yet.
    Nothing,
    /// This scene: of publications at the same time that replace it one counts, the others fail.
    Scene(ContentHash),
}

impl Library {
    /// [`Library::publish_replacing`] whatever is there.
    pub async fn publish(
        &self,
        name: &str,
        scene: ContentHash,
    ) -> Result<SceneReference, LibraryError> {
        self.publish_replacing(name, scene, Replaces::Anything)
            .await
    }

    /// Points `name` at `scene`, atomically, after checking that everything it needs is there.
    ///
    /// # Errors
    /// [`LibraryError::NoObject`] where something is missing, [`LibraryError::Changed`] where the name does not point at what is to be
    /// replaced: it then points where it did.
    pub async fn publish_replacing(
        &self,
        name: &str,
        scene: ContentHash,
        replaces: Replaces,
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
        self.replace(name, &path, PutPayload::from(json), replaces)
            .await?;
        Ok(reference)
    }

    async fn replace(
        &self,
        name: &str,
        path: &Path,
        json: PutPayload,
        replaces: Replaces,
    ) -> Result<(), LibraryError> {
        // Folders cannot compare and swap: whoever replaces something there does so alone.
        let _alone = match replaces {
            Replaces::Anything => None,
            _ => self.lock_folder().await?,
        };
        let mode = match replaces {
            Replaces::Anything => PutMode::Overwrite,
            Replaces::Nothing => PutMode::Create,
            Replaces::Scene(scene) => {
                let (found, version) = self.versioned_reference(name).await?;
                if found.scene != scene {
                    return Err(self.changed(name, replaces, found.scene.to_string()));
                }
                match self.folder.is_some() {
                    true => PutMode::Overwrite,
                    false => PutMode::Update(version),
                }
            }
        };
        match self.store.put_opts(path, json, mode.into()).await {
            Ok(_) => Ok(()),
            Err(object_store::Error::AlreadyExists { .. }) => {
                Err(self.changed(name, replaces, "a scene".to_owned()))
            }
            Err(object_store::Error::Precondition { .. }) => {
                Err(self.changed(name, replaces, "another scene, just now".to_owned()))
            }
            Err(error) => Err(self.store_error(path, error)),
        }
    }

    /// Fails unless `name` points at what is to be replaced; it may change before the publication, which looks again.
    pub async fn check_replaced(&self, name: &str, replaces: Replaces) -> Result<(), LibraryError> {
        let found = match (replaces, self.reference(name).await) {
            (Replaces::Anything, _) => return Ok(()),
            (_, Ok(found)) => Some(found.scene),
            (_, Err(LibraryError::NoScene { .. })) => None,
            (_, Err(error)) => return Err(error),
        };
        let expected = match replaces {
            Replaces::Scene(scene) => Some(scene),
            _ => None,
        };
        match found == expected {
            true => Ok(()),
            false => {
                let found = found.map_or_else(|| "none".to_owned(), |found| found.to_string());
                Err(self.changed(name, replaces, found))
            }
        }
    }

    fn changed(&self, name: &str, replaces: Replaces, found: String) -> LibraryError {
        LibraryError::Changed {
            location: self.location.to_string(),
            name: name.to_owned(),
            expected: match replaces {
                Replaces::Scene(scene) => scene.to_string(),
                Replaces::Nothing | Replaces::Anything => "none".to_owned(),
            },
            found,
        }
    }

    /// What `name` points at now.
    pub async fn reference(&self, name: &str) -> Result<SceneReference, LibraryError> {
        self.versioned_reference(name)
            .await
            .map(|(reference, _)| reference)
    }

    async fn versioned_reference(
        &self,
        name: &str,
    ) -> Result<(SceneReference, UpdateVersion), LibraryError> {
        let path = reference_path(name)?;
        let wrong = |error| match error {
            object_store::Error::NotFound { .. } => self.no_scene(name),
            error => self.store_error(&path, error),
        };
        let got = self.store.get(&path).await.map_err(wrong)?;
        let version = UpdateVersion {
            e_tag: got.meta.e_tag.clone(),
            version: got.meta.version.clone(),
        };
        let json = got.bytes().await.map_err(wrong)?;
        let reference = serde_json::from_slice(&json).map_err(|error| {
            let error = FormatError::new("scene reference", "its JSON", error);
            self.damaged(path.as_ref(), error)
        })?;
        Ok((reference, version))
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
        self.visible_scenes(after, limit, |_| true).await
    }

    /// The same, of those scenes that `may_see` lets through.
    pub async fn visible_scenes(
        &self,
        after: Option<&str>,
        limit: usize,
        may_see: impl Fn(&str) -> bool,
    ) -> Result<ScenesPage, LibraryError> {
        let most = limit.saturating_add(1);
        let mut names = self.names(after, most, may_see).await?;
        let more = names.len() > limit;
        names.truncate(limit);
        let next = names.last().filter(|_| more).cloned();
        let reads = names.into_iter().map(|name| async move {
            match self.reference(&name).await {
                Ok(reference) => Ok(Some(SceneEntry { name, reference })),
                Err(LibraryError::NoScene { .. }) => self.check_removed(&name).await.map(|()| None),
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

    /// That a name which was listed, and then was not there, is not listed any longer.
    ///
    /// # Errors
    /// A store that lists what it does not give: nothing may be concluded from it.
    pub(super) async fn check_removed(&self, name: &str) -> Result<(), LibraryError> {
        if !self
            .scene_names(None, usize::MAX)
            .await?
            .iter()
            .any(|listed| listed == name)
        {
            return Ok(());
        }
        let path = reference_path(name)?;
        let error = FormatError::new("scene reference", "what the store lists", "none");
        Err(self.damaged(path.as_ref(), error))
    }

    /// The first `limit` names after `after`, in byte order. Files that no scene can be named are passed over.
    pub async fn scene_names(
        &self,
        after: Option<&str>,
        limit: usize,
    ) -> Result<Vec<String>, LibraryError> {
        self.names(after, limit, |_| true).await
    }

    async fn names(
        &self,
        after: Option<&str>,
        limit: usize,
        may_see: impl Fn(&str) -> bool,
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
            if ours && after.is_none_or(|after| name > after) && may_see(name) {
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
        if self.folder.is_some() {
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
