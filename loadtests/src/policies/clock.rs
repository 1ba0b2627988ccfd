//! Clock, also second chance (Corbató, "A paging experiment with the Multics system", 1968): pages stand in a ring, a hand
//! goes round, clears the mark of pages that were wanted since it last came by, and takes the first without a mark.

use std::collections::{HashMap, HashSet, VecDeque};

use lodestream_client::stream::{Candidate, EvictionPolicy};

/// An approximation of LRU that needs one bit a page.
#[derive(Debug, Clone, Default)]
pub struct Clock {
    /// Installed pages; the hand stands before the first.
    ring: VecDeque<u32>,
    marked: HashSet<u32>,
}

impl EvictionPolicy for Clock {
    fn name(&self) -> &'static str {
        "clock"
    }

    fn wanted(&mut self, page: u32, _: f32, _: u64) {
        self.marked.insert(page);
    }

    fn installed(&mut self, page: u32, _: u64) {
        self.ring.push_back(page);
    }

    fn evicted(&mut self, page: u32, _: u64) {
        self.ring.retain(|&other| other != page);
        self.marked.remove(&page);
    }

    fn victim(&mut self, candidates: &[Candidate], _: u64) -> usize {
        let places: HashMap<u32, usize> = (0..)
            .zip(candidates)
            .map(|(index, candidate)| (candidate.page, index))
            .collect();
        // Two rounds: the first clears every candidate's mark at the latest.
        for _ in 0..2 * self.ring.len() {
            let Some(&page) = self.ring.front() else {
                break;
            };
            let place = places.get(&page);
            if let Some(&index) = place
                && !self.marked.remove(&page)
            {
                return index;
            }
            self.ring.rotate_left(1);
        }
        0
    }
}
