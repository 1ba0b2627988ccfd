//! A scene as it stands after `open`: everything that culling needs, and the root pages, hash-checked and parsed.

use std::collections::HashMap;

use bytes::Bytes;
use lodestream_format::disk_form::DiskForm;
use lodestream_format::{Asset, ContentHash, FormatError, Hierarchy, Scene};

use super::error::{StreamError, check_hash};
use super::page_check::{decode_page, split_frames};

/// An asset of an opened scene.
#[derive(Debug, Clone)]
pub struct OpenedAsset {
    /// The asset's name.
    pub hash: ContentHash,
    /// Its pages and grids.
    pub asset: Asset,
    /// Its groups and nodes.
    pub hierarchy: Hierarchy,
    /// Its first pages, checked.
    pub root_pages: Vec<DiskForm>,
    /// Scene-wide number of its first page.
    pub page_base: u32,
}

/// A scene with its assets in the order of `scene.assets`.
#[derive(Debug, Clone, Default)]
pub struct OpenedScene {
    /// Instances, materials and textures.
    pub scene: Scene,
    /// Assets; scene-wide page = `page_base` + page.
    pub assets: Vec<OpenedAsset>,
    /// Bytes that opening it took.
    pub open_bytes: u64,
}

/// The bytes of a scene before they are checked.
#[derive(Debug, Clone, Default)]
pub struct OpenParts {
    /// Name of the scene object.
    pub scene: Option<ContentHash>,
    /// Scene, assets and hierarchies.
    pub objects: HashMap<ContentHash, Bytes>,
    /// Frames of an asset's root pages, end to end, by the asset's name.
    pub root_pages: HashMap<ContentHash, Bytes>,
    /// Bytes that were read for all this.
    pub read_bytes: u64,
}

impl OpenParts {
    /// An object with its hash checked.
    pub fn object(&self, hash: &ContentHash) -> Result<&Bytes, StreamError> {
        let bytes = self
            .objects
            .get(hash)
            .ok_or_else(|| StreamError::NotFound {
                place: format!("object {hash}"),
            })?;
        check_hash(|| format!("object {hash}"), hash, bytes)?;
        Ok(bytes)
    }
}

impl OpenedScene {
    /// Checks and parses everything.
    pub fn parse(parts: &OpenParts) -> Result<Self, StreamError> {
        let scene_hash = parts.scene.ok_or_else(|| StreamError::NotFound {
            place: "scene object".to_owned(),
        })?;
        let scene = Scene::decode(parts.object(&scene_hash)?)
            .map_err(StreamError::format(format!("scene {scene_hash}")))?;
        let assets = scene
            .assets
            .iter()
            .map(|used| OpenedAsset::parse(used.asset, parts))
            .collect::<Result<Vec<_>, _>>()?;
        Self::assemble(scene, assets, parts.read_bytes)
    }

    /// Numbers the pages of `assets`, which stand in the order of `scene.assets`.
    ///
    /// # Errors
    /// [`StreamError::Setting`] where the scene has more pages than a `u32` numbers.
    pub fn assemble(
        scene: Scene,
        mut assets: Vec<OpenedAsset>,
        open_bytes: u64,
    ) -> Result<Self, StreamError> {
        let mut pages = 0u64;
        for opened in &mut assets {
            opened.page_base = pages as u32;
            pages += opened.asset.pages.len() as u64;
            if pages >= u32::MAX as u64 {
                return Err(StreamError::Setting {
                    setting: "pages of the scene",
                    expected: format!("fewer than {}", u32::MAX),
                    found: format!("at least {pages}"),
                });
            }
        }
        Ok(Self {
            scene,
            assets,
            open_bytes,
        })
    }

    /// Pages of all assets.
    pub fn page_count(&self) -> u32 {
        self.assets
            .last()
            .map_or(0, |last| last.page_base + last.asset.pages.len() as u32)
    }

    /// Index of the asset of a scene-wide page, and the page's number in it; `None` past the last page.
    pub fn locate(&self, page: u32) -> Option<(usize, u32)> {
        let index = self
            .assets
            .partition_point(|opened| opened.page_base <= page)
            .checked_sub(1)?;
        let local = page - self.assets[index].page_base;
        ((local as usize) < self.assets[index].asset.pages.len()).then_some((index, local))
    }
}

impl OpenedAsset {
    fn parse(hash: ContentHash, parts: &OpenParts) -> Result<Self, StreamError> {
        let place = |what: &str| format!("{what} of asset {hash}");
        let asset = Asset::decode(parts.object(&hash)?)
            .map_err(StreamError::format(format!("asset {hash}")))?;
        let hierarchy =
            Hierarchy::decode(parts.object(&asset.hierarchy)?, asset.pages.len() as u32)
                .map_err(StreamError::format(place("hierarchy")))?;
        // Root groups are always refined, so they must always be there: a hole otherwise.
        let astray = hierarchy
            .groups
            .iter()
            .position(|group| group.is_root() && group.pages().end > asset.root_page_count);
        if let Some(group) = astray {
            let expected = format!("pages below {}", asset.root_page_count);
            let found = format!("{:?}", hierarchy.groups[group].pages());
            let error = FormatError::new(format!("root group {group}"), expected, found);
            return Err(StreamError::format(place("hierarchy"))(error));
        }
        let frames = parts
            .root_pages
            .get(&hash)
            .ok_or_else(|| StreamError::NotFound {
                place: place("root pages"),
            })?;
        let frames = split_frames(&hash, &asset, 0, asset.root_page_count - 1, frames)?;
        let root_pages = frames
            .iter()
            .enumerate()
            .map(|(page, frame)| decode_page(&hash, &asset, &hierarchy, page as u32, frame))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            hash,
            asset,
            hierarchy,
            root_pages,
            page_base: 0,
        })
    }
}
