//! The parts of a scene as they come: the scene first, then only objects that it leads to, each of
//! the size that was announced, all within one bound of memory.

use std::collections::HashMap;

use bytes::Bytes;
use lodestream_format::wire::{Block, BlockHeader, BlockKind};
use lodestream_format::{Asset, ContentHash, FormatError, Scene};

use super::error::{StreamError, check_hash};
use super::limits::Memory;
use super::page_check::pack_range;

/// Bytes that an asset's entry takes in the tables here, at most.
const ENTRY_BYTES: u64 = 512;

/// The checked objects of a scene.
#[derive(Debug)]
pub struct OpenParts {
    pub(super) memory: Memory,
    pub(super) scene: Option<Scene>,
    assets: HashMap<ContentHash, AssetParts>,
    hierarchies: HashMap<ContentHash, HierarchyPart>,
    /// Bytes of all parts; fewer where they came compressed.
    pub read_bytes: u64,
}

/// Parts received of an asset that the scene names.
#[derive(Debug, Default)]
struct AssetParts {
    asset: Option<Asset>,
    root_pages: Option<Bytes>,
}

#[derive(Debug, Default)]
struct HierarchyPart {
    /// Assets that name it and whose answer has not brought it yet.
    awaited: u32,
    bytes: Option<Bytes>,
}

impl OpenParts {
    /// Parts that may take `memory_bytes`.
    pub fn new(memory_bytes: u64) -> Self {
        Self {
            memory: Memory::new(memory_bytes),
            scene: None,
            assets: HashMap::new(),
            hierarchies: HashMap::new(),
            read_bytes: 0,
        }
    }

    /// Looks at a block before any of its payload is kept, and takes memory for it.
    ///
    /// # Errors
    /// [`StreamError::Format`] for a block that nothing before it leads to, or of another size than
    /// was announced; [`StreamError::Memory`] where it does not fit.
    pub fn announced(&mut self, header: &BlockHeader) -> Result<(), StreamError> {
        let place = || format!("{:?} block {}", header.kind, header.hash);
        let expected = match header.kind {
            BlockKind::Scene if self.scene.is_none() => None,
            BlockKind::Scene => Some("one scene"),
            _ if self.scene.is_none() => Some("the scene first"),
            BlockKind::Asset => match self.assets.get(&header.hash) {
                Some(parts) if parts.asset.is_none() => None,
                _ => Some("an asset that the scene names and that has not come"),
            },
            BlockKind::Hierarchy => match self.hierarchies.get(&header.hash) {
                Some(part) if part.awaited > 0 => None,
                _ => Some("a hierarchy that an asset names and that has not come"),
            },
            BlockKind::RootPages => match self.awaited_root_bytes(&header.hash) {
                Some(expected_bytes) if header.payload_bytes != expected_bytes => {
                    return Err(StreamError::Length {
                        place: place(),
                        expected_bytes,
                        found_bytes: header.payload_bytes,
                    });
                }
                Some(_) => None,
                None => Some("root pages of an asset that came, once"),
            },
            BlockKind::Page | BlockKind::End => Some("parts of the scene"),
        };
        if let Some(expected) = expected {
            let error = FormatError::new("block", expected, place());
            return Err(StreamError::format("answer to open")(error));
        }
        self.memory.take(header.payload_bytes, place)
    }

    fn awaited_root_bytes(&self, hash: &ContentHash) -> Option<u64> {
        let parts = self.assets.get(hash)?;
        match (&parts.asset, &parts.root_pages) {
            (Some(asset), None) => root_bytes(asset),
            _ => None,
        }
    }

    /// Takes a block that was announced: checks its hash, and reads scenes and assets.
    ///
    /// # Errors
    /// [`StreamError::Hash`] and [`StreamError::Format`] where it is not what its name says.
    pub fn take(&mut self, block: Block) -> Result<(), StreamError> {
        let (hash, payload) = (block.hash, Bytes::from(block.payload));
        self.read_bytes += payload.len() as u64;
        let place = || format!("object {hash}");
        match block.kind {
            BlockKind::Scene => {
                check_hash(place, &hash, &payload)?;
                self.take_scene(&hash, &payload)
            }
            BlockKind::Asset => {
                check_hash(place, &hash, &payload)?;
                self.take_asset(hash, &payload)
            }
            BlockKind::Hierarchy => {
                check_hash(place, &hash, &payload)?;
                let part = self.hierarchies.entry(hash).or_default();
                part.awaited = part.awaited.saturating_sub(1);
                let payload_bytes = payload.len() as u64;
                if part.bytes.replace(payload).is_some() {
                    self.memory.give_back(payload_bytes);
                }
                Ok(())
            }
            // Each page's hash is checked where it is cut out.
            BlockKind::RootPages => {
                self.assets.entry(hash).or_default().root_pages = Some(payload);
                Ok(())
            }
            BlockKind::Page | BlockKind::End => Ok(()),
        }
    }

    fn take_scene(&mut self, hash: &ContentHash, bytes: &Bytes) -> Result<(), StreamError> {
        let place = || format!("scene {hash}");
        let scene = Scene::decode_within(bytes, self.memory.left_bytes());
        let scene = scene.map_err(StreamError::format(place()))?;
        self.memory.give_back(bytes.len() as u64);
        let tables_bytes = ENTRY_BYTES.saturating_mul(scene.assets.len() as u64);
        self.memory
            .take(scene.memory_bytes() + tables_bytes, place)?;
        let named = scene.assets.iter();
        self.assets = named
            .map(|used| (used.asset, AssetParts::default()))
            .collect();
        self.scene = Some(scene);
        Ok(())
    }

    fn take_asset(&mut self, hash: ContentHash, bytes: &Bytes) -> Result<(), StreamError> {
        let place = || format!("asset {hash}");
        let asset = Asset::decode_within(bytes, self.memory.left_bytes());
        let asset = asset.map_err(StreamError::format(place()))?;
        self.memory.give_back(bytes.len() as u64);
        self.memory.take(asset.memory_bytes(), place)?;
        self.hierarchies.entry(asset.hierarchy).or_default().awaited += 1;
        self.assets.entry(hash).or_default().asset = Some(asset);
        Ok(())
    }

    /// Assets that the scene names, each once.
    pub(super) fn named_assets(&self) -> Vec<ContentHash> {
        self.assets.keys().copied().collect()
    }

    /// An asset that has come.
    pub(super) fn asset(&self, hash: &ContentHash) -> Result<&Asset, StreamError> {
        let asset = self.assets.get(hash).and_then(|parts| parts.asset.as_ref());
        asset.ok_or_else(|| StreamError::NotFound {
            place: format!("object {hash}"),
        })
    }

    /// An asset with its hierarchy and root pages, which leaves the parts.
    pub(super) fn remove_asset(
        &mut self,
        hash: &ContentHash,
    ) -> Result<(Asset, Bytes, Bytes), StreamError> {
        let missing = |place: String| StreamError::NotFound { place };
        let parts = self.assets.remove(hash).unwrap_or_default();
        let asset = parts
            .asset
            .ok_or_else(|| missing(format!("object {hash}")))?;
        let hierarchy = self.hierarchies.get(&asset.hierarchy);
        let hierarchy = hierarchy
            .and_then(|part| part.bytes.clone())
            .ok_or_else(|| missing(format!("hierarchy of asset {hash}")))?;
        let root_pages = parts
            .root_pages
            .ok_or_else(|| missing(format!("root pages of asset {hash}")))?;
        Ok((asset, hierarchy, root_pages))
    }
}

/// Bytes of an asset's root pages in its pack.
fn root_bytes(asset: &Asset) -> Option<u64> {
    let range = pack_range(asset, 0, asset.root_page_count - 1)?;
    Some(range.end - range.start)
}
