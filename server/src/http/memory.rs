//! Bytes of the library that answers hold beside the cache: what was read for them and is not cached, or not any longer. They are bounded:
//! beyond [`BESIDE_BYTES`] nothing more is read until some are gone, and who takes nothing of an answer is given up soon
//! ([`Memory::patience`]). So clients that never read cost no more than that, however many they are.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use bytes::Bytes;
use tokio::sync::{Mutex, Notify};
use tokio::time::Instant;

/// Most bytes beside the cache.
const BESIDE_BYTES: u64 = 24 * 1024 * 1024;
/// Longest wait for room, and the time between two looks.
const LONGEST_WAIT: Duration = Duration::from_secs(10);
const LOOK_AGAIN: Duration = Duration::from_millis(100);
/// How long a client may take nothing of its answer.
const PATIENCE: Duration = Duration::from_secs(40);
/// The same where memory is short: all others may have to wait so long. Two packets that are lost one after the other take less.
const SHORT_PATIENCE: Duration = Duration::from_millis(750);

/// What there is.
#[derive(Debug, Default)]
pub(super) struct Memory {
    /// Bytes that were read, or are being read, and are not gone.
    alive: AtomicU64,
    /// Of these, in the cache; as it said last.
    cached: AtomicU64,
    /// Held by whoever is next to have room.
    next: Mutex<()>,
    freed: Notify,
}

/// Bytes that count until this is dropped.
#[derive(Debug)]
pub(super) struct Room {
    memory: Arc<Memory>,
    bytes: u64,
}

struct Kept {
    bytes: Bytes,
    _room: Room,
}

impl Memory {
    /// Waits until there is room for `bytes` more, while the cache holds what `cached` says, in the order in which it is asked for; a read
    /// that is alone always has it. Who was next for [`LONGEST_WAIT`] has it anyway: an answer may hold later pages while it waits for its
    /// first ones.
    pub(super) async fn room(self: &Arc<Self>, bytes: u64, cached: impl Fn() -> u64) -> Room {
        let _next = self.next.lock().await;
        let began = Instant::now();
        loop {
            let freed = self.freed.notified();
            self.set_cached(cached());
            let room = self.take(bytes);
            if self.beside() <= BESIDE_BYTES.max(bytes) || began.elapsed() >= LONGEST_WAIT {
                return room;
            }
            room.give_back();
            // The cache also makes room, and tells nobody.
            let _ = tokio::time::timeout(LOOK_AGAIN, freed).await;
        }
    }

    /// Counts `bytes` that are needed at once.
    pub(super) fn hold(self: &Arc<Self>, bytes: usize) -> Room {
        self.take(bytes as u64)
    }

    /// Counts `bytes` that are there already.
    pub(super) fn keep(self: &Arc<Self>, bytes: Bytes) -> Bytes {
        self.take(bytes.len() as u64).keep(bytes)
    }

    /// How much of what is alive the cache holds.
    pub(super) fn set_cached(&self, bytes: u64) {
        self.cached.store(bytes, Ordering::Relaxed);
    }

    /// Bytes beside the cache.
    pub(super) fn beside(&self) -> u64 {
        let alive = self.alive.load(Ordering::Relaxed);
        alive.saturating_sub(self.cached.load(Ordering::Relaxed))
    }

    /// Whether half of what may be beside the cache is.
    pub(super) fn is_short(&self) -> bool {
        self.beside() > BESIDE_BYTES / 2
    }

    /// How long a client may take nothing now.
    pub(super) fn patience(&self) -> Duration {
        match self.is_short() {
            true => SHORT_PATIENCE,
            false => PATIENCE,
        }
    }

    /// How often it is worth to look at [`Memory::patience`] again.
    pub(super) const fn look_again() -> Duration {
        SHORT_PATIENCE
    }

    fn take(self: &Arc<Self>, bytes: u64) -> Room {
        self.alive.fetch_add(bytes, Ordering::Relaxed);
        Room {
            memory: Arc::clone(self),
            bytes,
        }
    }
}

impl Room {
    /// `bytes`, which count for as long as any slice of them lives.
    pub(super) fn keep(mut self, bytes: Bytes) -> Bytes {
        let more = bytes.len() as u64;
        // What was read may be less than what there was room for.
        self.memory.alive.fetch_add(more, Ordering::Relaxed);
        self.memory.alive.fetch_sub(self.bytes, Ordering::Relaxed);
        self.bytes = more;
        Bytes::from_owner(Kept { bytes, _room: self })
    }

    /// Without waking anybody: what was not taken is no news.
    fn give_back(mut self) {
        self.memory.alive.fetch_sub(self.bytes, Ordering::Relaxed);
        self.bytes = 0;
    }
}

impl Drop for Room {
    fn drop(&mut self) {
        if self.bytes > 0 {
            self.memory.alive.fetch_sub(self.bytes, Ordering::Relaxed);
            self.memory.freed.notify_one();
        }
    }
}

impl AsRef<[u8]> for Kept {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIECE: u64 = 1024 * 1024;

    #[tokio::test]
    async fn what_is_beside_the_cache_is_bounded_and_every_read_has_its_turn() {
        let memory = Arc::new(Memory::default());
        let read = |memory: Arc<Memory>| async move {
            let room = memory.room(PIECE, || 0).await;
            tokio::task::yield_now().await;
            let piece = room.keep(Bytes::from(vec![0; PIECE as usize]));
            assert!(memory.beside() <= BESIDE_BYTES);
            tokio::task::yield_now().await;
            drop(piece);
        };
        let reads = (0..500).map(|_| tokio::spawn(read(Arc::clone(&memory))));
        for done in futures_util::future::join_all(reads).await {
            done.expect("within the bound");
        }
        assert_eq!(memory.beside(), 0);
    }

    #[tokio::test(start_paused = true)]
    async fn a_slice_keeps_its_piece_and_what_is_cached_does_not_count() {
        let memory = Arc::new(Memory::default());
        let held: Vec<_> = (0..BESIDE_BYTES / PIECE)
            .map(|_| {
                memory
                    .keep(Bytes::from(vec![0; PIECE as usize]))
                    .slice(..10)
            })
            .collect();
        assert_eq!(
            (memory.beside(), memory.patience()),
            (BESIDE_BYTES, SHORT_PATIENCE)
        );
        // Nothing is freed, but the cache takes what was read: noticed at the next look.
        let began = Instant::now();
        let cached = || match began.elapsed() < LOOK_AGAIN {
            true => 0,
            false => BESIDE_BYTES - PIECE,
        };
        drop(memory.room(1, cached).await);
        assert_eq!(began.elapsed(), LOOK_AGAIN);
        assert_eq!((memory.beside(), memory.patience()), (PIECE, PATIENCE));
        // Alone, however large; beside others only after a while.
        let large = memory.room(3 * BESIDE_BYTES, || BESIDE_BYTES).await;
        let began = Instant::now();
        drop(memory.room(1, || 0).await);
        assert!(began.elapsed() >= LONGEST_WAIT);
        drop((large, held));
        assert_eq!(memory.alive.load(Ordering::Relaxed), 0);
    }
}
