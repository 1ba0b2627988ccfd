//! First in, first out: what was installed longest ago leaves, however often it was wanted since.

use std::collections::HashMap;

use lodestream_client::stream::{Candidate, EvictionPolicy};

/// The baseline that keeps no history of wants.
#[derive(Debug, Clone, Default)]
pub struct Fifo {
    /// When each page was installed, counted in installs.
    installs: HashMap<u32, u64>,
    count: u64,
}

impl EvictionPolicy for Fifo {
    fn name(&self) -> &'static str {
        "fifo"
    }

    fn installed(&mut self, page: u32, _: u64) {
        self.count += 1;
        self.installs.insert(page, self.count);
    }

    fn evicted(&mut self, page: u32, _: u64) {
        self.installs.remove(&page);
    }

    fn victim(&mut self, candidates: &[Candidate], _: u64) -> usize {
        let age = |candidate: &Candidate| self.installs.get(&candidate.page).copied().unwrap_or(0);
        let oldest = candidates
            .iter()
            .enumerate()
            .min_by_key(|(_, candidate)| age(candidate));
        oldest.map_or(0, |(index, _)| index)
    }
}
