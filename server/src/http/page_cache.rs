//! Pieces of packs in memory, and small objects whole, in front of the store: bounded by bytes, and one read for all who wait for a piece.
//!
//! A piece is all pages that begin in the same [`PIECE_BYTES`] of a pack: more than one, so that what lies beside a page, its siblings and
//! what depends on it, is read with it, and whole ones, so that no byte gets in whose page does not hash to its name. Answers hold
//! slices of pieces: nothing is copied.

use std::future::Future;
use std::ops::{Range, RangeInclusive};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use bytes::Bytes;
use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::asset::PageEntry;
use lodestream_format::library::object_path;
use lodestream_format::{Asset, ContentHash, FormatError};
use quick_cache::Weighter;
use quick_cache::sync::Cache;

use super::fair::{Asker, FairReads};
use super::memory::{Memory, Room};
use super::read_ahead;
use super::resident::{MappedPages, Resident};
use super::slices::Slices;
use crate::library::{Library, LibraryError};

/// Bytes of a pack in which the pages of a piece begin; the last one ends beyond them.
pub(super) const PIECE_BYTES: u64 = 128 * 1024;
/// Most bytes of an answer that are held at once: joining pages up to that gives 1.5 times the bytes a second on loopback, more nothing.
pub(super) const RUN_BYTES: u64 = 256 * 1024;
/// Of so many answers from the system's memory one has a piece brought into the cache, which is a third faster still: often while the
/// cache has room, seldom where that takes another's place.
const RESIDENT_READS: [u64; 2] = [16, 256];
/// Reads of one range at a time.
const READS_AHEAD: usize = 8;

/// A pack, and the number of a piece of it; or another object, whole.
type PieceKey = (ContentHash, u64);
/// Number of an object that is no pack.
const WHOLE: u64 = u64::MAX;
/// What an object is taken for until it is read.
const OBJECT_BYTES: u64 = 64 * 1024;

/// Things made of an object for all who ask; its numbers are no piece's.
#[derive(Debug, Clone, Copy)]
pub(super) enum Made {
    /// The opening of the asset of a hash, compressed.
    Opening = 1,
    /// The hierarchy of a hash, compressed.
    Hierarchy = 2,
    /// The block of the scene of a hash, compressed.
    Scene = 3,
    /// The hashes of that scene's assets.
    Assets = 4,
}

#[derive(Debug, Clone)]
struct ByBytes;

impl Weighter<PieceKey, Bytes> for ByBytes {
    fn weight(&self, _: &PieceKey, piece: &Bytes) -> u64 {
        piece.len() as u64
    }
}

/// The cache; shared by all requests, clones are handles.
#[derive(Debug, Clone)]
pub(super) struct PageCache(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    library: Library,
    resident: Resident,
    pieces: Cache<PieceKey, Bytes, ByBytes>,
    reads: Arc<FairReads>,
    memory: Arc<Memory>,
    hits: AtomicU64,
    misses: AtomicU64,
    ahead: AtomicU64,
    resident_reads: AtomicU64,
    mapped: AtomicU64,
}

/// What it did so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CacheCounts {
    /// Pieces that were there.
    pub hits: u64,
    /// Pieces that had to be read or waited for.
    pub misses: u64,
    /// Pieces that were read before they were asked for.
    pub ahead: u64,
    /// Ranges that were not there, and that the system had in memory.
    pub resident: u64,
    /// Ranges that went out from the system's memory.
    pub mapped: u64,
    /// Bytes held now.
    pub bytes: u64,
}

impl PageCache {
    /// At most `limit_bytes` of pieces of what is in `library`.
    pub(super) fn new(library: Library, limit_bytes: usize) -> Self {
        let pieces = limit_bytes.div_ceil(PIECE_BYTES as usize);
        Self(Arc::new(Inner {
            library,
            resident: Resident::default(),
            pieces: Cache::with_weighter(pieces, limit_bytes as u64, ByBytes),
            reads: Arc::default(),
            memory: Arc::default(),
            hits: AtomicU64::new(0),
            misses: AtomicU64::new(0),
            ahead: AtomicU64::new(0),
            resident_reads: AtomicU64::new(0),
            mapped: AtomicU64::new(0),
        }))
    }

    /// Frames of pages `pages` of an asset, end to end, if all of them are in memory, ours or the system's; for `asker`.
    pub(super) fn held(
        &self,
        asset: &Arc<Asset>,
        pages: RangeInclusive<u32>,
        asker: Asker,
    ) -> Option<Slices> {
        if let Some(slices) = self.cached(asset, &pages) {
            return Some(slices);
        }
        let memory = &self.0.memory;
        memory.set_cached(self.0.pieces.weight());
        let read = self.0.resident.read(asset, pages.clone(), memory)?;
        let reads = self.0.resident_reads.fetch_add(1, Ordering::Relaxed);
        let is_full = self.0.pieces.weight() > self.0.pieces.capacity() / 8 * 7;
        let every = RESIDENT_READS[usize::from(is_full)];
        if reads.is_multiple_of(every) {
            // Each piece has its turn, for an answer is from the cache where all of its pieces are.
            let numbers = numbers(asset, &pages);
            let nth = (reads / every) % (numbers.end - numbers.start).max(1);
            self.begin(asset, numbers.start + nth, asker);
        }
        Some(Slices::from_iter([read]))
    }

    /// The same, where they are in the system's memory, if they need no copy there.
    pub(super) fn mapped(
        &self,
        asset: &Arc<Asset>,
        pages: RangeInclusive<u32>,
    ) -> Option<MappedPages> {
        let mapped = self.0.resident.mapped(asset, pages)?;
        self.0.mapped.fetch_add(1, Ordering::Relaxed);
        Some(mapped)
    }

    fn cached(&self, asset: &Asset, pages: &RangeInclusive<u32>) -> Option<Slices> {
        let mut slices = Slices::default();
        let mut hits = 0;
        for number in numbers(asset, pages) {
            let Some(all) = pages_in(asset, number) else {
                continue;
            };
            let piece = self.0.pieces.get(&(asset.pack, number))?;
            slices.push(cut(asset, pages, all, &piece));
            hits += 1;
        }
        self.0.hits.fetch_add(hits, Ordering::Relaxed);
        Some(slices)
    }

    /// Frames of pages `pages` of an asset, end to end, each checked against its hash; for `asker`.
    ///
    /// # Errors
    /// Where the store fails, or has other bytes.
    pub(super) async fn pages(
        &self,
        asset: &Arc<Asset>,
        pages: RangeInclusive<u32>,
        asker: Asker,
    ) -> Result<Slices, LibraryError> {
        if let Some(slices) = self.held(asset, pages.clone(), asker) {
            return Ok(slices);
        }
        let numbers = numbers(asset, &pages);
        let wanted = numbers.filter_map(|number| Some((number, pages_in(asset, number)?)));
        let read: Result<Vec<Bytes>, LibraryError> = stream::iter(wanted)
            .map(|(number, all)| {
                let pages = &pages;
                async move {
                    let piece = self.piece(asset, number, all.clone(), asker).await?;
                    Ok(cut(asset, pages, all, &piece))
                }
            })
            .buffered(READS_AHEAD)
            .try_collect()
            .await;
        match read {
            Ok(slices) => Ok(slices.into_iter().collect()),
            // A pack that is damaged elsewhere still has these.
            Err(LibraryError::Damaged { .. }) => {
                let bytes = bytes_of(asset, &pages);
                let room = self.room(bytes.end - bytes.start).await;
                let read = read_pages(&self.0.library, asset, pages).await?;
                Ok(std::iter::once(room.keep(read)).collect())
            }
            Err(error) => Err(error),
        }
    }

    async fn piece(
        &self,
        asset: &Arc<Asset>,
        number: u64,
        pages: RangeInclusive<u32>,
        asker: Asker,
    ) -> Result<Bytes, LibraryError> {
        if let Some(piece) = self.0.pieces.get(&(asset.pack, number)) {
            self.0.hits.fetch_add(1, Ordering::Relaxed);
            return Ok(piece);
        }
        self.0.misses.fetch_add(1, Ordering::Relaxed);
        let read = async {
            let bytes = bytes_of(asset, &pages);
            // The turn before the room: who waits for room waits in no order, and so must be few.
            let _turn = self.0.reads.enter(asker, bytes.end - bytes.start).await;
            let room = self.room(bytes.end - bytes.start).await;
            let piece = room.keep(read_pages(&self.0.library, asset, pages).await?);
            if self.0.library.is_remote() {
                for number in read_ahead::dependents(asset, number) {
                    self.begin(asset, number, asker);
                }
            }
            self.open(asset).await;
            Ok(piece)
        };
        let key = (asset.pack, number);
        self.0.pieces.get_or_insert_async(&key, read).await
    }

    /// An object that is no pack, checked against its hash; for `asker`. What opens a scene is the same for all who open it.
    ///
    /// # Errors
    /// Where the store fails, or has other bytes.
    pub(super) async fn object(
        &self,
        hash: &ContentHash,
        asker: Asker,
    ) -> Result<Bytes, LibraryError> {
        let key = (*hash, WHOLE);
        if let Some(object) = self.0.pieces.get(&key) {
            self.0.hits.fetch_add(1, Ordering::Relaxed);
            return Ok(object);
        }
        self.0.misses.fetch_add(1, Ordering::Relaxed);
        let read = async {
            let _turn = self.0.reads.enter(asker, OBJECT_BYTES).await;
            let room = self.room(OBJECT_BYTES).await;
            Ok(room.keep(self.0.library.object(hash).await?))
        };
        self.0.pieces.get_or_insert_async(&key, read).await
    }

    /// What `make` gives, made once for all who ask.
    ///
    /// # Errors
    /// Where `make` fails.
    pub(super) async fn made(
        &self,
        what: Made,
        hash: &ContentHash,
        make: impl Future<Output = Result<Bytes, LibraryError>>,
    ) -> Result<Bytes, LibraryError> {
        if let Some(held) = self.held_made(what, hash) {
            return Ok(held);
        }
        self.0.misses.fetch_add(1, Ordering::Relaxed);
        let make = async { Ok(self.0.memory.keep(make.await?)) };
        let key = (*hash, WHOLE - what as u64);
        self.0.pieces.get_or_insert_async(&key, make).await
    }

    /// The same, if it is in memory.
    pub(super) fn held_made(&self, what: Made, hash: &ContentHash) -> Option<Bytes> {
        let held = self.0.pieces.get(&(*hash, WHOLE - what as u64))?;
        self.0.hits.fetch_add(1, Ordering::Relaxed);
        Some(held)
    }

    /// From now on what the system has in memory of an asset's pack is read at once, if the library is a folder.
    async fn open(&self, asset: &Arc<Asset>) {
        let (cache, asset) = (self.clone(), Arc::clone(asset));
        if let Some(folder) = self
            .0
            .library
            .folder()
            .filter(|_| !self.0.resident.has(&asset))
        {
            let folder = Arc::clone(folder);
            let open = move || cache.0.resident.open(&folder, &asset);
            // A runtime that ends has nobody who would read.
            let _ = tokio::task::spawn_blocking(open).await;
        }
    }

    /// Begins to read a piece that nobody waits for, if the store is idle.
    fn begin(&self, asset: &Arc<Asset>, number: u64, asker: Asker) {
        let key = (asset.pack, number);
        let pages = pages_in(asset, number).filter(|_| !self.0.pieces.contains_key(&key));
        let Some(pages) = pages else {
            return;
        };
        let bytes = bytes_of(asset, &pages);
        let Some(turn) = self.0.reads.try_enter(asker, bytes.end - bytes.start) else {
            return;
        };
        let (cache, asset) = (self.clone(), Arc::clone(asset));
        tokio::spawn(async move {
            cache.0.ahead.fetch_add(1, Ordering::Relaxed);
            let read = async {
                let room = cache.room(bytes.end - bytes.start).await;
                let piece = read_pages(&cache.0.library, &asset, pages).await?;
                Ok::<_, LibraryError>(room.keep(piece))
            };
            // Nobody asked: who does will see the error.
            let _ = cache.0.pieces.get_or_insert_async(&key, read).await;
            drop(turn);
        });
    }

    /// Closes files that nobody reads any longer, for ever.
    pub(super) async fn close_unused(&self) {
        self.0.resident.close_unused().await;
    }

    /// Waits for room for what is not, or not yet, in the cache.
    pub(super) async fn room(&self, bytes: u64) -> Room {
        let cached = || self.0.pieces.weight();
        self.0.memory.room(bytes, cached).await
    }

    /// What answers hold.
    pub(super) fn memory(&self) -> &Arc<Memory> {
        &self.0.memory
    }

    /// For `/metrics`.
    pub(super) fn counts(&self) -> CacheCounts {
        CacheCounts {
            hits: self.0.hits.load(Ordering::Relaxed),
            misses: self.0.misses.load(Ordering::Relaxed),
            ahead: self.0.ahead.load(Ordering::Relaxed),
            resident: self.0.resident_reads.load(Ordering::Relaxed),
            mapped: self.0.mapped.load(Ordering::Relaxed),
            bytes: self.0.pieces.weight(),
        }
    }
}

/// Reads pages from the store and checks them; once more where they are others, for they may have been changed on the way.
pub(super) async fn read_pages(
    library: &Library,
    asset: &Asset,
    pages: RangeInclusive<u32>,
) -> Result<Bytes, LibraryError> {
    let bytes = bytes_of(asset, &pages);
    let mut tries = 2;
    loop {
        tries -= 1;
        let read = library.pack_range(&asset.pack, bytes.clone()).await?;
        let wrong = pages.clone().find(|&page| {
            let entry = &asset.pages[page as usize];
            let begin = (entry.offset - bytes.start) as usize;
            ContentHash::of(&read[begin..begin + entry.bytes as usize]) != entry.hash
        });
        match wrong {
            None => return Ok(read),
            Some(page) if tries == 0 => {
                let found = format!("other bytes for page {page}");
                let error = FormatError::new("page hash", "that of the page table", found);
                return Err(library.damaged(object_path(&asset.pack), error));
            }
            Some(_) => {}
        }
    }
}

/// Consecutive runs of pages of at most about [`RUN_BYTES`].
pub(super) fn runs(
    asset: &Arc<Asset>,
    pages: RangeInclusive<u32>,
) -> impl Iterator<Item = RangeInclusive<u32>> + Send + use<> {
    let asset = Arc::clone(asset);
    let (mut next, last) = pages.into_inner();
    std::iter::from_fn(move || {
        let first = next;
        let begin = asset
            .pages
            .get(first as usize)
            .filter(|_| first <= last)?
            .offset;
        let fits = |page: &PageEntry| page.offset + u64::from(page.bytes) <= begin + RUN_BYTES;
        let after = asset.pages.partition_point(fits) as u32;
        next = after.clamp(first + 1, last + 1);
        Some(first..=next - 1)
    })
}

/// Where pages lie in their pack.
pub(super) fn bytes_of(asset: &Asset, pages: &RangeInclusive<u32>) -> Range<u64> {
    let entry = |page: u32| asset.pages.get(page as usize);
    match (entry(*pages.start()), entry(*pages.end())) {
        (Some(first), Some(last)) => first.offset..last.offset + u64::from(last.bytes),
        _ => 0..0,
    }
}

/// Numbers of the pieces that have pages of a range.
fn numbers(asset: &Asset, pages: &RangeInclusive<u32>) -> Range<u64> {
    let number = |page: u32| {
        asset
            .pages
            .get(page as usize)
            .map(|page| page.offset / PIECE_BYTES)
    };
    match (number(*pages.start()), number(*pages.end())) {
        (Some(first), Some(last)) => first..last + 1,
        _ => 0..0,
    }
}

/// The pages of a piece; none where a long page fills it that began before.
fn pages_in(asset: &Asset, number: u64) -> Option<RangeInclusive<u32>> {
    let begins = |bytes: u64| asset.pages.partition_point(|page| page.offset < bytes) as u32;
    let (first, end) = (
        begins(number * PIECE_BYTES),
        begins((number + 1) * PIECE_BYTES),
    );
    (first < end).then(|| first..=end - 1)
}

/// What a piece, which has pages `all`, has of `pages`.
fn cut(
    asset: &Asset,
    pages: &RangeInclusive<u32>,
    all: RangeInclusive<u32>,
    piece: &Bytes,
) -> Bytes {
    let begin = bytes_of(asset, &all).start;
    let both = *pages.start().max(all.start())..=*pages.end().min(all.end());
    let bytes = bytes_of(asset, &both);
    piece.slice((bytes.start - begin) as usize..(bytes.end - begin) as usize)
}
