//! Page tables of assets, each parsed once, least recently used first out when there are too many bytes of them. The one used last stays
//! however large it is: parsing takes longer than anything else that is done for a page.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use lodestream_format::asset::PageEntry;
use lodestream_format::{Asset, ContentHash};
use tokio::sync::OnceCell;

use crate::library::{Library, LibraryError};

/// Bounded map from asset to its parsed object.
#[derive(Debug)]
pub(super) struct AssetTables {
    limit_bytes: usize,
    tables: Mutex<Tables>,
}

#[derive(Debug, Default)]
struct Tables {
    entries: HashMap<ContentHash, Entry>,
    clock: u64,
    bytes: usize,
}

#[derive(Debug)]
struct Entry {
    asset: Arc<OnceCell<Arc<Asset>>>,
    used: u64,
    bytes: usize,
}

impl AssetTables {
    pub(super) fn new(limit_bytes: usize) -> Self {
        Self {
            limit_bytes,
            tables: Mutex::default(),
        }
    }

    /// The asset; concurrent askers of an unknown one wait for a single read.
    pub(super) async fn asset(
        &self,
        library: &Library,
        hash: &ContentHash,
    ) -> Result<Arc<Asset>, LibraryError> {
        if let Some(asset) = self.held(hash) {
            return Ok(asset);
        }
        let cell = self.cell(hash);
        let asset = cell
            .get_or_try_init(|| async { library.asset(hash).await.map(Arc::new) })
            .await;
        match asset {
            Ok(asset) => {
                self.account(hash, &cell, asset);
                Ok(Arc::clone(asset))
            }
            Err(error) => {
                self.forget(hash, &cell);
                Err(error)
            }
        }
    }

    /// The asset, if it was read before.
    pub(super) fn held(&self, hash: &ContentHash) -> Option<Arc<Asset>> {
        let mut tables = self.lock();
        tables.clock += 1;
        let used = tables.clock;
        let entry = tables.entries.get_mut(hash)?;
        entry.used = used;
        entry.asset.get().cloned()
    }

    fn cell(&self, hash: &ContentHash) -> Arc<OnceCell<Arc<Asset>>> {
        let mut tables = self.lock();
        tables.clock += 1;
        let used = tables.clock;
        let entry = tables.entries.entry(*hash).or_insert_with(|| Entry {
            asset: Arc::default(),
            used,
            bytes: 0,
        });
        entry.used = used;
        Arc::clone(&entry.asset)
    }

    /// Counts an entry when it is first filled, then makes room.
    fn account(&self, hash: &ContentHash, cell: &Arc<OnceCell<Arc<Asset>>>, asset: &Asset) {
        let mut tables = self.lock();
        let size = table_bytes(asset);
        let Some(entry) = tables.entries.get_mut(hash) else {
            return;
        };
        if entry.bytes > 0 || !Arc::ptr_eq(&entry.asset, cell) {
            return;
        }
        entry.bytes = size;
        tables.bytes += size;
        if tables.bytes > self.limit_bytes {
            tables.shrink(self.limit_bytes / 8 * 7);
        }
    }

    /// A failed read leaves nothing behind, so that names that do not exist cannot fill the map.
    fn forget(&self, hash: &ContentHash, cell: &Arc<OnceCell<Arc<Asset>>>) {
        let mut tables = self.lock();
        let same = |entry: &Entry| Arc::ptr_eq(&entry.asset, cell) && entry.bytes == 0;
        if tables.entries.get(hash).is_some_and(same) {
            tables.entries.remove(hash);
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Tables> {
        // Nothing panics while the lock is held, and a half-made change would only cost a reload.
        self.tables.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Tables {
    /// Drops the entries used longest ago until at most `target` bytes stay; one sort pays for many later inserts.
    fn shrink(&mut self, target: usize) {
        let mut oldest: Vec<_> = self
            .entries
            .iter()
            .filter(|(_, entry)| entry.bytes > 0)
            .map(|(hash, entry)| (entry.used, *hash))
            .collect();
        oldest.sort_unstable();
        oldest.pop();
        for (_, hash) in oldest {
            if self.bytes <= target {
                break;
            }
            if let Some(entry) = self.entries.remove(&hash) {
                self.bytes -= entry.bytes;
            }
        }
    }
}

/// About what an asset takes in memory.
fn table_bytes(asset: &Asset) -> usize {
    let dependencies: usize = asset
        .pages
        .iter()
        .map(|page| size_of_val(&page.dependencies[..]))
        .sum();
    size_of::<Asset>() + asset.pages.len() * size_of::<PageEntry>() + dependencies
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;

    fn asset(number: u32) -> Asset {
        let page = PageEntry {
            offset: 0,
            bytes: 9,
            memory_words: 1,
            hash: ContentHash([0; 32]),
            dependencies: vec![],
        };
        Asset {
            attributes: Default::default(),
            position_grid: lodestream_format::grid::Grid { step_exponent: 0 },
            uv_grid: lodestream_format::grid::Grid { step_exponent: 0 },
            center_q: [number as i64, 0, 0],
            aabb: lodestream_format::Aabb {
                min: [0.0; 3],
                max: [0.0; 3],
            },
            material_slots: 1,
            source_triangles: 1,
            dag_triangles: 1,
            clusters: 1,
            levels: 1,
            pack: ContentHash([1; 32]),
            hierarchy: ContentHash([2; 32]),
            proxy: Default::default(),
            root_page_count: 1,
            pages: vec![page],
        }
    }

    #[tokio::test]
    async fn the_map_stays_within_its_bytes_and_keeps_what_is_used() {
        let library = Library::open("memory://").expect("memory opens");
        let one = table_bytes(&asset(0));
        let tables = AssetTables::new(10 * one);
        let mut hashes = vec![];
        for number in 0..40 {
            let bytes = asset(number).encode().expect("encodes");
            let (hash, _) = library
                .put_object(Bytes::from(bytes), 0)
                .await
                .expect("stores");
            hashes.push(hash);
            tables.asset(&library, &hash).await.expect("reads");
            tables.asset(&library, &hashes[0]).await.expect("reads");
            let inner = tables.lock();
            assert!(inner.bytes <= 10 * one);
            let counted: usize = inner.entries.values().map(|entry| entry.bytes).sum();
            assert_eq!(inner.bytes, counted);
            assert!(inner.entries.contains_key(&hashes[0]), "the used one stays");
        }
        assert!(tables.lock().entries.len() < 40);
    }

    #[tokio::test]
    async fn what_is_larger_than_the_map_is_held_until_something_else_is_used() {
        let library = Library::open("memory://").expect("memory opens");
        let tables = AssetTables::new(1);
        let mut held = None;
        for number in 0..4 {
            let bytes = asset(number).encode().expect("encodes");
            let stored = library.put_object(Bytes::from(bytes), 0).await;
            let (hash, _) = stored.expect("stores");
            tables.asset(&library, &hash).await.expect("reads");
            assert!(tables.held(&hash).is_some());
            assert!(
                held.replace(hash)
                    .is_none_or(|before| tables.held(&before).is_none())
            );
        }
    }

    #[tokio::test]
    async fn names_that_do_not_exist_leave_nothing_behind() {
        let library = Library::open("memory://").expect("memory opens");
        let tables = AssetTables::new(1 << 20);
        for number in 0..10u32 {
            let hash = ContentHash::of(&number.to_le_bytes());
            assert!(tables.asset(&library, &hash).await.is_err());
        }
        assert!(tables.lock().entries.is_empty());
    }
}
