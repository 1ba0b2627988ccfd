//! Places in the page pool: the root arena, then slots of 128 KiB.
//!
//! ```text
//! 0              first_slot_word                                        words
//! | root pages   | slot 0        | slot 1        | ...                  |
//!   256 B granules  32768 words
//! ```

use lodestream_format::limits::{PAGE_BYTES, PAGE_WORDS, ROOT_ARENA_GRANULE_BYTES};

use super::error::StreamError;
use super::opened_scene::OpenedScene;

pub use lodestream_shaders::types::NOT_INSTALLED;

/// Fewest slots that a pool must have beside the root pages.
pub const MIN_SLOTS: u32 = 4;

const GRANULE_WORDS: u64 = ROOT_ARENA_GRANULE_BYTES as u64 / 4;

/// Where everything lies in the pool, in 32-bit words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PoolLayout {
    /// Scene-wide page and first word of each root page, ascending.
    pub roots: Vec<(u32, u32)>,
    /// First word of slot 0.
    pub first_slot_word: u32,
    /// Slots.
    pub slot_count: u32,
}

impl PoolLayout {
    /// Lays out a pool of at most `pool_bytes`. What does not make a whole slot is left unused, and so is what a 32-bit
    /// word offset cannot reach (16 GiB).
    ///
    /// # Errors
    /// [`StreamError::Pool`] where the root pages and [`MIN_SLOTS`] slots do not fit; it names both numbers.
    pub fn new(scene: &OpenedScene, pool_bytes: u64) -> Result<Self, StreamError> {
        let roots = scene.assets.iter().flat_map(|opened| {
            let entries = opened.asset.pages.iter().zip(opened.page_base..);
            let roots = entries.take(opened.asset.root_page_count as usize);
            roots.map(|(entry, page)| (page, entry.memory_words))
        });
        Self::over(roots, pool_bytes)
    }

    /// The same over the scene-wide numbers and memory words of the root pages, ascending.
    ///
    /// # Errors
    /// As [`PoolLayout::new`].
    pub fn over(
        root_words: impl Iterator<Item = (u32, u32)>,
        pool_bytes: u64,
    ) -> Result<Self, StreamError> {
        let mut roots = Vec::new();
        let mut word = 0u64;
        for (page, memory_words) in root_words {
            roots.push((page, word as u32));
            word += (memory_words as u64).next_multiple_of(GRANULE_WORDS);
        }
        let reach = (NOT_INSTALLED as u64).min(pool_bytes / 4);
        let slot_count = reach.saturating_sub(word) / PAGE_WORDS as u64;
        if slot_count < MIN_SLOTS as u64 {
            return Err(StreamError::Pool {
                pool_bytes,
                root_bytes: word * 4,
                slots: MIN_SLOTS,
                needed_bytes: word * 4 + MIN_SLOTS as u64 * PAGE_BYTES as u64,
            });
        }
        Ok(Self {
            roots,
            first_slot_word: word as u32,
            slot_count: slot_count as u32,
        })
    }

    /// First word of a slot.
    pub fn slot_word(&self, slot: u32) -> u32 {
        self.first_slot_word + slot * PAGE_WORDS as u32
    }

    /// Words of the whole pool: what its buffer must hold.
    pub fn words(&self) -> u32 {
        self.slot_word(self.slot_count)
    }

    /// Bytes of the whole pool.
    pub fn bytes(&self) -> u64 {
        self.words() as u64 * 4
    }
}

/// Which page lies in which slot.
#[derive(Debug, Clone)]
pub(crate) struct Slots {
    free: Vec<u32>,
    pages: Vec<Option<u32>>,
}

impl Slots {
    pub(crate) fn new(count: u32) -> Self {
        Self {
            // Popped from the end: low slots first, so that a small scene touches little memory.
            free: (0..count).rev().collect(),
            pages: vec![None; count as usize],
        }
    }

    pub(crate) fn take(&mut self, page: u32) -> Option<u32> {
        let slot = self.free.pop()?;
        self.pages[slot as usize] = Some(page);
        Some(slot)
    }

    pub(crate) fn give_back(&mut self, slot: u32) {
        if self.pages[slot as usize].take().is_some() {
            self.free.push(slot);
        }
    }

    pub(crate) fn has_free(&self) -> bool {
        !self.free.is_empty()
    }

    pub(crate) fn used(&self) -> usize {
        self.pages.len() - self.free.len()
    }

    /// Pages in slots, in slot order.
    pub(crate) fn pages(&self) -> impl Iterator<Item = u32> + '_ {
        self.pages.iter().copied().flatten()
    }
}
