//! What a scene object needs: the closure of names below it.

use std::collections::BTreeSet;

use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::{Asset, ContentHash, Hierarchy, Scene};

use super::{Library, LibraryError, object_path};

/// Assets read at once.
const READS_AT_ONCE: usize = 8;

/// Everything below one scene object, itself included.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Reach {
    /// Scene, assets, packs, hierarchies and textures.
    objects: BTreeSet<ContentHash>,
}

impl Reach {
    /// Every name, each once.
    pub fn objects(&self) -> impl Iterator<Item = &ContentHash> {
        self.objects.iter()
    }

    /// Adds another closure.
    pub fn merge(&mut self, other: Reach) {
        self.objects.extend(other.objects);
    }

    pub(super) fn insert(&mut self, hash: ContentHash) {
        self.objects.insert(hash);
    }

    /// Whether all of them are needed.
    pub(super) fn contains_all(&self, hashes: &[ContentHash]) -> bool {
        hashes.iter().all(|hash| self.contains(hash))
    }

    /// Whether the object is needed.
    pub fn contains(&self, hash: &ContentHash) -> bool {
        self.objects.contains(hash)
    }
}

impl Library {
    /// A scene object.
    pub async fn scene(&self, hash: &ContentHash) -> Result<Scene, LibraryError> {
        let bytes = self.object(hash).await?;
        self.decode_scene(hash, &bytes)
    }

    /// A scene object whose bytes are at hand.
    pub fn decode_scene(&self, hash: &ContentHash, bytes: &[u8]) -> Result<Scene, LibraryError> {
        Scene::decode(bytes).map_err(|error| self.damaged(object_path(hash), error))
    }

    /// An asset object.
    pub async fn asset(&self, hash: &ContentHash) -> Result<Asset, LibraryError> {
        let bytes = self.object(hash).await?;
        Asset::decode(&bytes).map_err(|error| self.damaged(object_path(hash), error))
    }

    /// The hierarchy of an asset.
    pub async fn hierarchy(&self, asset: &Asset) -> Result<Hierarchy, LibraryError> {
        let bytes = self.object(&asset.hierarchy).await?;
        Hierarchy::decode(&bytes, asset.pages.len() as u32)
            .map_err(|error| self.damaged(object_path(&asset.hierarchy), error))
    }

    /// The closure below a scene object; reads the scene and its assets, not what they name.
    pub async fn reach(&self, scene_hash: &ContentHash) -> Result<Reach, LibraryError> {
        let scene = self.scene(scene_hash).await?;
        let assets: BTreeSet<_> = scene.assets.iter().map(|asset| asset.asset).collect();
        let mut objects: BTreeSet<_> = scene
            .textures
            .iter()
            .map(|texture| texture.object)
            .collect();
        objects.insert(*scene_hash);
        let below: Vec<_> = stream::iter(assets)
            .map(|hash| async move { Ok((hash, self.asset(&hash).await?)) })
            .buffered(READS_AT_ONCE)
            .map_ok(|(hash, asset)| [hash, asset.pack, asset.hierarchy])
            .try_collect()
            .await?;
        objects.extend(below.into_iter().flatten());
        Ok(Reach { objects })
    }
}
