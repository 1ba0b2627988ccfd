//! What is read before anybody asks: when pages had to be read from a store over the network, the pages that depend on them are what a
//! viewer that comes closer asks for next, so their pieces are read too while the store has nothing better to do. A folder's pages
//! are ahead already, in the system's memory.

use std::collections::BTreeSet;
use std::ops::Range;

use lodestream_format::Asset;

use super::page_cache::PIECE_BYTES;

/// Most pieces read ahead for one that was asked for.
const AHEAD_PIECES: usize = 4;

/// The first pieces after `piece` that have pages which depend on a page in it.
pub(super) fn dependents(asset: &Asset, piece: u64) -> BTreeSet<u64> {
    let pages = &asset.pages;
    let begins = |bytes: u64| pages.partition_point(|page| page.offset < bytes);
    let (first, end) = (
        begins(piece * PIECE_BYTES),
        begins((piece + 1) * PIECE_BYTES),
    );
    let parents: Range<u32> = first as u32..end as u32;
    let mut pieces = BTreeSet::new();
    // Dependencies come before what depends on them.
    for page in &pages[end..] {
        if pieces.len() == AHEAD_PIECES {
            break;
        }
        if page
            .dependencies
            .iter()
            .any(|parent| parents.contains(parent))
        {
            pieces.insert(page.offset / PIECE_BYTES);
        }
    }
    pieces
}
