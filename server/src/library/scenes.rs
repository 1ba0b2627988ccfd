//! Named references: the only things in a library that change.

use std::collections::BTreeSet;
use std::hash::{DefaultHasher, Hash, Hasher};

use futures_util::{Stream, StreamExt, TryStreamExt, stream};
use lodestream_format::library::{SCENES, SceneReference, scene_path};
use lodestream_format::wire::{SceneEntry, ScenesPage};
use lodestream_format::{ContentHash, FormatError};
use object_store::path::Path;
use object_store::{ObjectMeta, ObjectStoreExt, PutMode, PutPayload, UpdateVersion};

use super::objects::{Found, now_secs};
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

/// A scene in a list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ListedScene {
    pub name: Box<str>,
    /// Changes with the reference; nothing where the store does not tell.
    version: Option<u64>,
}

impl ListedScene {
    /// Whether `later` has the same reference for certain.
    pub(crate) fn is_unchanged(&self, later: &Self) -> bool {
        self.version.is_some() && self == later
    }
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
        self.clear_way(path)?;
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
        match self.found(&path).await? {
            Found::Nothing => Err(self.no_scene(name)),
            Found::Object(_) | Found::NoFile => self.delete(&path).await,
        }
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
        let most = limit.saturating_add(1);
        let mut names = self.scene_names(after, most).await?;
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
        Err(self.listed_but_gone(name))
    }

    /// The error of a scene that the store lists and does not give.
    pub(crate) fn listed_but_gone(&self, name: &str) -> LibraryError {
        let error = FormatError::new("scene reference", "what the store lists", "none");
        self.damaged(format!("{SCENES}/{name}"), error)
    }

    /// The first `limit` names after `after`, in byte order. Files that no scene can be named are passed over.
    pub async fn scene_names(
        &self,
        after: Option<&str>,
        limit: usize,
    ) -> Result<Vec<String>, LibraryError> {
        let mut listed = std::pin::pin!(self.listed(after));
        let mut names = BTreeSet::new();
        // Stores list in any order: the smallest names are kept while the rest goes by.
        while let Some((name, _)) = listed.try_next().await? {
            if after.is_none_or(|after| *name > *after) {
                names.insert(name);
                if names.len() > limit {
                    names.pop_last();
                }
            }
        }
        Ok(names.into_iter().collect())
    }

    /// All scenes by name, without what they point at.
    pub(crate) async fn listed_scenes(&self) -> Result<Vec<ListedScene>, LibraryError> {
        let scenes = self.listed(None).map_ok(|(name, meta)| {
            let mut hasher = DefaultHasher::new();
            let version = meta.e_tag.map(|tag| {
                tag.hash(&mut hasher);
                hasher.finish()
            });
            ListedScene {
                name: name.into(),
                version,
            }
        });
        let mut scenes: Vec<_> = scenes.try_collect().await?;
        scenes.sort_unstable_by(|a, b| a.name.cmp(&b.name));
        Ok(scenes)
    }

    /// The references, in any order; where `after` is a name some or all of those up to it may be
    /// left out.
    fn listed(
        &self,
        after: Option<&str>,
    ) -> impl Stream<Item = Result<(String, ObjectMeta), LibraryError>> + Send + '_ {
        let folder = Path::from(SCENES);
        let listed = match after.and_then(|after| reference_path(after).ok()) {
            Some(after) => self.store.list_with_offset(Some(&folder), &after),
            None => self.store.list(Some(&folder)),
        };
        listed.filter_map(move |meta| {
            let named = meta.map(|meta| {
                let name = meta.location.filename()?.to_owned();
                let ours = reference_path(&name).is_ok_and(|path| path == meta.location);
                ours.then_some((name, meta))
            });
            let named = named.map_err(|error| self.store_error(&folder, error));
            std::future::ready(named.transpose())
        })
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
