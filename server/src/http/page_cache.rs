//! Pieces of packs in memory, in front of the store: bounded by bytes, and one read for all who wait for a piece.
//!
//! A piece is larger than most pages, so that what lies beside a page, its siblings and what depends on it, is read with it. Answers
//! hold slices of pieces: nothing is copied.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use bytes::Bytes;
use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::{Asset, ContentHash};
use quick_cache::Weighter;
use quick_cache::sync::Cache;

use crate::library::{Library, LibraryError};

/// Bytes of a piece; the last one of a pack is shorter. A connection that reads nothing keeps at most what its page touches.
const PIECE_BYTES: u64 = 128 * 1024;
/// Reads of one range at a time.
const READS_AHEAD: usize = 8;

/// A pack, and the number of a piece of it.
type PieceKey = (ContentHash, u64);

#[derive(Debug, Clone)]
struct ByBytes;

impl Weighter<PieceKey, Bytes> for ByBytes {
    fn weight(&self, _: &PieceKey, piece: &Bytes) -> u64 {
        piece.len() as u64
    }
}

/// The cache; shared by all requests.
#[derive(Debug)]
pub(super) struct PageCache {
    pieces: Cache<PieceKey, Bytes, ByBytes>,
    hits: AtomicU64,
    misses: AtomicU64,
}

/// What it did so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CacheCounts {
    /// Pieces that were there.
    pub hits: u64,
    /// Pieces that had to be read or waited for.
    pub misses: u64,
    /// Bytes held now.
    pub bytes: u64,
}

impl PageCache {
    /// At most `limit_bytes` of pieces.
    pub(super) fn new(limit_bytes: usize) -> Self {
        let pieces = limit_bytes.div_ceil(PIECE_BYTES as usize);
        Self {
            pieces: Cache::with_weighter(pieces, limit_bytes as u64, ByBytes),
            hits: AtomicU64::new(0),
            misses: AtomicU64::new(0),
        }
    }

    /// Bytes `range` of a pack, if all of them are in memory.
    pub(super) fn held(&self, pack: &ContentHash, range: Range<u64>) -> Option<Slices> {
        let mut slices = Slices::default();
        for number in numbers(&range) {
            let piece = self.pieces.get(&(*pack, number))?;
            slices.push(cut(&range, number, &piece));
        }
        let hits = numbers(&range).count() as u64;
        self.hits.fetch_add(hits, Ordering::Relaxed);
        Some(slices)
    }

    /// Bytes `range` of an asset's pack.
    ///
    /// # Errors
    /// Where the store fails, or the pack ends before the range.
    pub(super) async fn range(
        &self,
        library: &Library,
        asset: &Asset,
        range: Range<u64>,
    ) -> Result<Slices, LibraryError> {
        if let Some(slices) = self.held(&asset.pack, range.clone()) {
            return Ok(slices);
        }
        let read: Result<Vec<Bytes>, LibraryError> = stream::iter(numbers(&range))
            .map(|number| {
                let range = &range;
                async move {
                    let piece = self.piece(library, asset, number).await?;
                    Ok(cut(range, number, &piece))
                }
            })
            .buffered(READS_AHEAD)
            .try_collect()
            .await;
        match read {
            Ok(slices) => Ok(slices.into_iter().collect()),
            // A pack that ends early still has what lies before its end.
            Err(LibraryError::Damaged { .. }) => {
                let bytes = library.object_range(&asset.pack, range).await?;
                Ok(std::iter::once(bytes).collect())
            }
            Err(error) => Err(error),
        }
    }

    async fn piece(
        &self,
        library: &Library,
        asset: &Asset,
        number: u64,
    ) -> Result<Bytes, LibraryError> {
        if let Some(piece) = self.pieces.get(&(asset.pack, number)) {
            self.hits.fetch_add(1, Ordering::Relaxed);
            return Ok(piece);
        }
        self.misses.fetch_add(1, Ordering::Relaxed);
        let pack_bytes = asset
            .pages
            .last()
            .map_or(0, |page| page.offset + page.bytes as u64);
        let first = number * PIECE_BYTES;
        let range = first..pack_bytes.min(first + PIECE_BYTES);
        let read = library.object_range(&asset.pack, range);
        self.pieces
            .get_or_insert_async(&(asset.pack, number), read)
            .await
    }

    /// For `/metrics`.
    pub(super) fn counts(&self) -> CacheCounts {
        CacheCounts {
            hits: self.hits.load(Ordering::Relaxed),
            misses: self.misses.load(Ordering::Relaxed),
            bytes: self.pieces.weight(),
        }
    }
}

/// Numbers of the pieces that a range touches.
fn numbers(range: &Range<u64>) -> Range<u64> {
    range.start / PIECE_BYTES..range.end.div_ceil(PIECE_BYTES)
}

/// What a piece has of a range.
fn cut(range: &Range<u64>, number: u64, piece: &Bytes) -> Bytes {
    let first = number * PIECE_BYTES;
    let begin = range.start.saturating_sub(first);
    let end = (range.end - first).min(piece.len() as u64);
    piece.slice(begin as usize..end as usize)
}

/// Bytes that are there, piece after piece.
#[derive(Debug, Default)]
pub(super) struct Slices {
    /// Most pages lie in one piece, so that nothing is allocated for them.
    first: Option<Bytes>,
    rest: VecDeque<Bytes>,
    bytes: u64,
}

impl Slices {
    /// Bytes that are left.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    fn push(&mut self, slice: Bytes) {
        self.bytes += slice.len() as u64;
        match self.first {
            None => self.first = Some(slice),
            Some(_) => self.rest.push_back(slice),
        }
    }

    /// The next `bytes` of what is left.
    pub(super) fn take_bytes(&mut self, mut bytes: usize) -> Vec<Bytes> {
        let mut taken = Vec::with_capacity(2);
        while bytes > 0 {
            let Some(mut slice) = self.next() else {
                break;
            };
            if slice.len() > bytes {
                let left = slice.split_off(bytes);
                self.bytes += left.len() as u64;
                if let Some(second) = self.first.replace(left) {
                    self.rest.push_front(second);
                }
            }
            bytes -= slice.len();
            taken.push(slice);
        }
        taken
    }
}

impl Iterator for Slices {
    type Item = Bytes;

    fn next(&mut self) -> Option<Bytes> {
        let slice = self.first.take()?;
        self.first = self.rest.pop_front();
        self.bytes -= slice.len() as u64;
        Some(slice)
    }
}

impl FromIterator<Bytes> for Slices {
    fn from_iter<T: IntoIterator<Item = Bytes>>(slices: T) -> Self {
        let mut all = Self::default();
        slices.into_iter().for_each(|slice| all.push(slice));
        all
    }
}
