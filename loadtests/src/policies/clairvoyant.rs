//! The bound: a policy that knows what will be wanted (Belady, "A study of replacement algorithms for a virtual-storage
//! computer", 1966).
//!
//! Where pages depend on nothing this has the fewest faults that any policy can have: keeping a page over a gap between
//! two wants takes one place in every update of the gap, and dropping the gap that ends last is optimal for intervals
//! over a varying number of places. With dependencies it is no proven bound (a parent cannot leave before its children,
//! and the problem is NP-hard), but none of the policies here knows as much.

use std::sync::{Arc, Mutex, PoisonError};

use lodestream_client::stream::{Candidate, EvictionPolicy, Lru};

/// The updates that want each page, ascending.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Future {
    wants: Vec<Vec<u64>>,
}

impl Future {
    /// Nothing is known of any page yet.
    fn with_pages(pages: usize) -> Self {
        Self {
            wants: vec![Vec::new(); pages],
        }
    }

    /// The first update after `update` that wants `page`; the largest number if none does.
    fn next(&self, page: u32, update: u64) -> u64 {
        let wants = &self.wants[page as usize];
        let next = wants.partition_point(|&want| want <= update);
        wants.get(next).copied().unwrap_or(u64::MAX)
    }
}

/// Writes the future down in a first replay, which evicts as LRU does. What is wanted does not depend on who evicts: it
/// follows from the trace and the governor, and the governor looks at wants alone.
#[derive(Debug, Clone)]
pub struct Recorder {
    future: Arc<Mutex<Future>>,
}

impl Recorder {
    /// Over a scene of so many pages.
    pub fn new(pages: usize) -> Self {
        Self {
            future: Arc::new(Mutex::new(Future::with_pages(pages))),
        }
    }

    /// What was written down.
    pub fn future(&self) -> Future {
        self.future
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }
}

impl EvictionPolicy for Recorder {
    fn name(&self) -> &'static str {
        "recorder"
    }

    fn wanted(&mut self, page: u32, _: f32, update: u64) {
        let mut future = self.future.lock().unwrap_or_else(PoisonError::into_inner);
        future.wants[page as usize].push(update);
    }

    fn victim(&mut self, candidates: &[Candidate], update: u64) -> usize {
        Lru.victim(candidates, update)
    }
}

/// Evicts what will be wanted last; of equals what is the cheapest to fetch again, then the finest.
#[derive(Debug, Clone)]
pub struct Clairvoyant {
    future: Arc<Future>,
}

impl Clairvoyant {
    /// Knows `future`.
    pub fn new(future: Future) -> Self {
        Self {
            future: Arc::new(future),
        }
    }
}

impl EvictionPolicy for Clairvoyant {
    fn name(&self) -> &'static str {
        "clairvoyant"
    }

    fn victim(&mut self, candidates: &[Candidate], update: u64) -> usize {
        let worth = |candidate: &Candidate| {
            let next = self.future.next(candidate.page, update);
            (
                std::cmp::Reverse(next),
                candidate.frame_bytes,
                std::cmp::Reverse(candidate.page),
            )
        };
        let last = candidates
            .iter()
            .enumerate()
            .min_by_key(|(_, candidate)| worth(candidate));
        last.map_or(0, |(index, _)| index)
    }
}
