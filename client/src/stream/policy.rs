//! Which page leaves when a wanted one needs its slot.
//!
//! A policy chooses among [`Candidate`]s only: pages that the camera does not want now, that no installed page depends
//! on, and that are no root pages. Whatever it answers, every invariant of residency holds; only bytes and seconds change.

use std::cmp::Ordering;

/// A page that may leave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Scene-wide page.
    pub page: u32,
    /// The update that wanted it last; 0 if none did.
    pub last_wanted_update: u64,
    /// Projected errors that it removed then, summed over instances, pixels.
    pub priority_px: f32,
    /// Bytes that fetching it again takes.
    pub frame_bytes: u32,
}

/// Chooses victims. The other methods tell it what happens, for policies that keep books of their own.
pub trait EvictionPolicy: Send {
    /// The policy's name in reports.
    fn name(&self) -> &'static str;

    /// Update `update` wants `page`, resident or not.
    fn wanted(&mut self, page: u32, priority_px: f32, update: u64) {
        let _ = (page, priority_px, update);
    }

    /// `page` was installed.
    fn installed(&mut self, page: u32, update: u64) {
        let _ = (page, update);
    }

    /// `page` was evicted.
    fn evicted(&mut self, page: u32, update: u64) {
        let _ = (page, update);
    }

    /// Index of the page to evict among `candidates`, which are never empty; a number past them means the last.
    fn victim(&mut self, candidates: &[Candidate], update: u64) -> usize;
}

/// Index of the smallest candidate; of equals the one with the largest page number, which is the finest.
pub fn smallest(
    candidates: &[Candidate],
    compare: impl Fn(&Candidate, &Candidate) -> Ordering,
) -> usize {
    candidates
        .iter()
        .enumerate()
        .min_by(|(_, a), (_, b)| compare(a, b).then(b.page.cmp(&a.page)))
        .map_or(0, |(index, _)| index)
}

/// Evicts what was wanted longest ago.
#[derive(Debug, Clone, Copy, Default)]
pub struct Lru;

impl EvictionPolicy for Lru {
    fn name(&self) -> &'static str {
        "lru"
    }

    fn victim(&mut self, candidates: &[Candidate], _: u64) -> usize {
        smallest(candidates, |a, b| {
            a.last_wanted_update.cmp(&b.last_wanted_update)
        })
    }
}

/// Evicts what removed the smallest projected error when it was wanted last, however long ago.
#[derive(Debug, Clone, Copy, Default)]
pub struct LowestError;

impl EvictionPolicy for LowestError {
    fn name(&self) -> &'static str {
        "lowest-error"
    }

    fn victim(&mut self, candidates: &[Candidate], _: u64) -> usize {
        smallest(candidates, |a, b| a.priority_px.total_cmp(&b.priority_px))
    }
}

/// The default: evicts the smallest error, where an error halves with every [`DecayedError::half_life_updates`] that the
/// page was not wanted.
///
/// LRU alone cannot tell pages that left the view together (a turn of the head drops hundreds in one update), and the
/// error alone never lets go of a page that was once close. The decayed error is the error that the page would remove if
/// the camera came back, times a guess of how likely that is; within one update it orders by error, and after a few
/// half-lives it orders by age.
#[derive(Debug, Clone, Copy)]
pub struct DecayedError {
    /// Updates after which an unwanted page's error counts half; two seconds at 60 updates a second by default.
    pub half_life_updates: f32,
}

impl Default for DecayedError {
    fn default() -> Self {
        Self {
            half_life_updates: 120.0,
        }
    }
}

impl EvictionPolicy for DecayedError {
    fn name(&self) -> &'static str {
        "decayed-error"
    }

    fn victim(&mut self, candidates: &[Candidate], update: u64) -> usize {
        // Compared as logarithms: nothing underflows however old a page is.
        let worth = |candidate: &Candidate| {
            let age = update.saturating_sub(candidate.last_wanted_update) as f32;
            candidate.priority_px.max(1e-30).log2() - age / self.half_life_updates
        };
        smallest(candidates, |a, b| worth(a).total_cmp(&worth(b)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(page: u32, last_wanted_update: u64, priority_px: f32) -> Candidate {
        Candidate {
            page,
            last_wanted_update,
            priority_px,
            frame_bytes: 1,
        }
    }

    #[test]
    fn each_policy_has_its_victim() {
        let candidates = [
            candidate(1, 900, 1.5),
            candidate(2, 100, 40.0),
            candidate(3, 900, 30.0),
            candidate(4, 100, 40.0),
        ];
        // The older of two, and of equals the finer.
        assert_eq!(Lru.victim(&candidates, 1000), 3);
        assert_eq!(LowestError.victim(&candidates, 1000), 0);
        // 40 px, 900 updates ago are 7.5 half-lives: 0.2 px; 1.5 px 100 updates ago are 0.8 px.
        assert_eq!(DecayedError::default().victim(&candidates, 1000), 3);
        assert_eq!(DecayedError::default().victim(&candidates[..1], 1000), 0);
        // Of what left together, the smallest error goes first.
        let together = [candidate(7, 5, 3.0), candidate(8, 5, 2.0)];
        assert_eq!(DecayedError::default().victim(&together, 10_000_000), 1);
    }
}
