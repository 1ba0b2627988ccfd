//! A scene as it stands after `open`: everything that culling needs, and the root pages, hash-checked and parsed.

use std::collections::HashMap;

use lodestream_format::disk_form::DiskForm;
use lodestream_format::{Asset, ContentHash, FormatError, Hierarchy, Scene};

use super::error::StreamError;
use super::open_parts::OpenParts;
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

/// Bytes that viewers keep for a page beside its entry: page tables, priorities, requests and
/// residency.
const PAGE_STATE_BYTES: u64 = 256;
/// Bytes that viewers keep for an instance beside it.
const INSTANCE_RECORD_BYTES: u64 = 128;

impl OpenedScene {
    /// Parses everything, within what memory the parts have left.
    pub fn parse(mut parts: OpenParts) -> Result<Self, StreamError> {
        let scene = parts.scene.take().ok_or_else(|| StreamError::NotFound {
            place: "scene object".to_owned(),
        })?;
        let instances_bytes = INSTANCE_RECORD_BYTES * scene.instances.len() as u64;
        parts
            .memory
            .take(instances_bytes, || "instances of the scene".to_owned())?;
        let mut assets: Vec<OpenedAsset> = Vec::with_capacity(scene.assets.len());
        let mut parsed: HashMap<ContentHash, usize> = HashMap::new();
        for used in &scene.assets {
            // An asset that the scene uses with several materials has arrays of its own for each.
            let opened = match parsed.get(&used.asset) {
                Some(&index) => {
                    let same = &assets[index];
                    let bytes = same.memory_bytes() + same.asset.memory_bytes();
                    let place = || format!("another use of asset {}", used.asset);
                    parts.memory.take(bytes, place)?;
                    same.clone()
                }
                None => OpenedAsset::parse(used.asset, &mut parts)?,
            };
            parsed.entry(used.asset).or_insert(assets.len());
            assets.push(opened);
        }
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
    fn parse(hash: ContentHash, parts: &mut OpenParts) -> Result<Self, StreamError> {
        let place = |part: &str| format!("{part} of asset {hash}");
        let (asset, hierarchy_bytes, root_pages) = parts.remove_asset(&hash)?;
        let mut opened = Self {
            hash,
            asset,
            hierarchy: Hierarchy::default(),
            root_pages: Vec::new(),
            page_base: 0,
        };
        let lists_bytes = 2 * hierarchy_bytes.len() as u64 + opened.memory_bytes();
        parts.memory.take(lists_bytes, || place("arrays"))?;
        let asset = &opened.asset;
        let hierarchy = Hierarchy::decode(&hierarchy_bytes, asset.pages.len() as u32)
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
        let frames = split_frames(&hash, asset, 0, asset.root_page_count - 1, &root_pages)?;
        let mut forms = Vec::with_capacity(frames.len());
        for (page, frame) in (0..).zip(&frames) {
            let form = decode_page(&hash, asset, &hierarchy, page, frame)?;
            parts
                .memory
                .take(form_bytes(&form), || place("root pages"))?;
            forms.push(form);
        }
        opened.hierarchy = hierarchy;
        opened.root_pages = forms;
        Ok(opened)
    }

    /// Bytes that it takes in memory beside its page entries: twice its hierarchy, once here and
    /// once in the arrays.
    fn memory_bytes(&self) -> u64 {
        let hierarchy = size_of_val(&self.hierarchy.nodes[..])
            + size_of_val(&self.hierarchy.groups[..])
            + size_of_val(&self.hierarchy.parts[..]);
        let roots: u64 = self.root_pages.iter().map(form_bytes).sum();
        // The residency keeps the dependencies of pages once more.
        2 * hierarchy as u64
            + roots
            + self.asset.memory_bytes()
            + PAGE_STATE_BYTES * self.asset.pages.len() as u64
            + 4 * self.asset.material_slots as u64
            + size_of::<Self>() as u64
    }
}

/// Bytes of a root page: once here, once on its way into the pool.
fn form_bytes(form: &DiskForm) -> u64 {
    let form = size_of_val(form.words())
        + size_of_val(form.headers())
        + size_of_val(form.spans())
        + size_of_val(form.parents());
    2 * form as u64
}
