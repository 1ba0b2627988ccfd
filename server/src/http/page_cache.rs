//! Pieces of packs in memory, in front of the store: bounded by bytes, and one read for all who wait for a piece.
//!
//! A piece is larger than most pages, so that what lies beside a page, its siblings and what depends on it, is read with it. Answers
//! hold slices of pieces: nothing is copied.

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

    /// Bytes `range` of an asset's pack, in order, as slices.
    ///
    /// # Errors
    /// Where the store fails, or the pack ends before the range.
    pub(super) async fn range(
        &self,
        library: &Library,
        asset: &Asset,
        range: Range<u64>,
    ) -> Result<Vec<Bytes>, LibraryError> {
        if range.is_empty() {
            return Ok(Vec::new());
        }
        let numbers = range.start / PIECE_BYTES..=(range.end - 1) / PIECE_BYTES;
        let cached: Vec<Bytes> = numbers
            .clone()
            .map_while(|number| self.pieces.get(&(asset.pack, number)))
            .collect();
        let hits = cached.len() as u64;
        let misses = numbers.end() - numbers.start() + 1 - hits;
        self.hits.fetch_add(hits, Ordering::Relaxed);
        let slice = |(number, piece): (u64, Bytes)| {
            let first = number * PIECE_BYTES;
            let begin = range.start.saturating_sub(first);
            let end = (range.end - first).min(piece.len() as u64);
            piece.slice(begin as usize..end as usize)
        };
        let start = *numbers.start();
        let mut slices: Vec<Bytes> = (start..).zip(cached).map(slice).collect();
        if misses == 0 {
            return Ok(slices);
        }
        self.misses.fetch_add(misses, Ordering::Relaxed);
        let read: Result<Vec<(u64, Bytes)>, LibraryError> =
            stream::iter(start + hits..=*numbers.end())
                .map(
                    |number| async move { Ok((number, self.piece(library, asset, number).await?)) },
                )
                .buffered(READS_AHEAD)
                .try_collect()
                .await;
        match read {
            Ok(pieces) => {
                slices.extend(pieces.into_iter().map(slice));
                Ok(slices)
            }
            // A pack that ends early still has what lies before its end.
            Err(LibraryError::Damaged { .. }) => {
                Ok(vec![library.object_range(&asset.pack, range).await?])
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
