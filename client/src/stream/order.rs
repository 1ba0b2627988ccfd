//! What to fetch next: most error removed per byte first, dependencies before what needs them, neighbours together.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::page_state::{PageEvent, PageState};
use super::residency::{InFlight, PageForm, Residency};
use super::want::is_hidden;

/// Pages to fetch in one request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fetch {
    /// Names the fetch in [`Residency::cancelled`].
    pub id: u64,
    /// Index of the asset in the opened scene.
    pub asset_index: usize,
    /// First page, counted from the asset's first.
    pub first_page: u32,
    /// Last page, inclusive.
    pub last_page: u32,
    /// Priority of the most urgent of the pages, pixels.
    pub priority_px: f32,
}

/// Neighbours are joined up to this many bytes.
const MAX_JOINED_BYTES: u64 = 256 * 1024;
/// A neighbour joins with at least this share of the priority of the page that it joins.
const JOIN_PRIORITY: f32 = 0.5;
/// Fetches in flight whatever the window says, so that the estimate has something to measure.
const MIN_FETCHES: usize = 4;

#[derive(PartialEq)]
struct Turn {
    px_a_byte: f32,
    page: u32,
}

impl Eq for Turn {}

impl Ord for Turn {
    fn cmp(&self, other: &Self) -> Ordering {
        self.px_a_byte
            .total_cmp(&other.px_a_byte)
            .then(other.page.cmp(&self.page))
    }
}

impl PartialOrd for Turn {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<Form: PageForm> Residency<Form> {
    /// Fetches to send now, most urgent first. All that is wanted and not sent is put in order anew with every call.
    pub fn next_fetches(&mut self, now_secs: f64) -> Vec<Fetch> {
        let mut fetches = Vec::new();
        self.window.tick(now_secs, self.fetches.is_empty());
        if !self.has_room() {
            return fetches;
        }
        let blocked = self.blocked();
        // Hidden pages wait until every visible one is installed or has failed.
        let seen = |page: u32| !is_hidden(self.records[page as usize].priority_px);
        let mut left = self.missing.iter().zip(&blocked);
        let sees_missing = left.any(|(&page, &blocked)| !blocked && seen(page));
        let turns = self.missing.iter().zip(&blocked);
        let mut turns: BinaryHeap<Turn> = turns
            .filter(|&(&page, &blocked)| !blocked && self.state(page) == PageState::Wanted)
            .filter(|&(&page, _)| !sees_missing || seen(page))
            .map(|(&page, _)| Turn {
                px_a_byte: self.records[page as usize].priority_px
                    / self.pages.frame_bytes(page) as f32,
                page,
            })
            .collect();
        while let Some(turn) = turns.pop() {
            for page in self.wanted_chain(turn.page) {
                // An earlier fetch of the same chain may have taken the page along.
                if self.state(page) != PageState::Wanted {
                    continue;
                }
                if !self.has_room() {
                    return fetches;
                }
                fetches.push(self.issue(page, now_secs));
            }
        }
        fetches
    }

    fn has_room(&self) -> bool {
        let window_bytes = self.window.bytes().min(self.max_in_flight_bytes);
        let held_bytes = self.in_flight_bytes + self.decoded_bytes;
        self.fetches.len() < MIN_FETCHES
            || (self.in_flight_bytes < window_bytes && held_bytes < self.max_in_flight_bytes)
    }

    pub(super) fn end_back_offs(&mut self, now_secs: f64) {
        for index in 0..self.missing.len() {
            let page = self.missing[index];
            if let PageState::Failed { retry_at_secs, .. } = self.state(page)
                && retry_at_secs <= now_secs
            {
                self.step(page, PageEvent::Retry);
            }
        }
    }

    /// For each missing page: whether it failed, or depends on a page that did. Fetching the latter would only fill host memory.
    pub(super) fn blocked(&self) -> Vec<bool> {
        let mut blocked = vec![false; self.missing.len()];
        let failed = |&page: &u32| matches!(self.state(page), PageState::Failed { .. });
        if !self.missing.iter().any(failed) {
            return blocked;
        }
        for (index, &page) in self.missing.iter().enumerate() {
            blocked[index] = failed(&page)
                || self.pages.dependencies(page).iter().any(|dependency| {
                    // Dependencies stand before the page in the ascending list.
                    let at = self.missing[..index].binary_search(dependency);
                    at.is_ok_and(|at| blocked[at])
                });
        }
        blocked
    }

    /// The page and all that it depends on, as far as they wait for their turn, dependencies first.
    fn wanted_chain(&self, page: u32) -> Vec<u32> {
        let mut chain = vec![page];
        let mut next = 0;
        while let Some(&page) = chain.get(next) {
            next += 1;
            for &dependency in self.pages.dependencies(page) {
                if self.state(dependency) == PageState::Wanted && !chain.contains(&dependency) {
                    chain.push(dependency);
                }
            }
        }
        // A page that is in flight hides nothing: what it depends on was sent before it.
        chain.sort_unstable();
        chain
    }

    fn issue(&mut self, page: u32, now_secs: f64) -> Fetch {
        let range = self.joined(page);
        let asset_pages = self.pages.asset_pages(page);
        self.last_fetch += 1;
        let id = self.last_fetch;
        let mut priority_px = 0.0f32;
        for page in range.clone() {
            self.in_flight_bytes += self.pages.frame_bytes(page) as u64;
            self.records[page as usize].fetch = id;
            priority_px = priority_px.max(self.records[page as usize].priority_px);
            self.step(page, PageEvent::Issue);
        }
        let fetch = Fetch {
            id,
            asset_index: self.pages.asset_index(page),
            first_page: range.start - asset_pages.start,
            last_page: range.end - 1 - asset_pages.start,
            priority_px,
        };
        let in_flight = InFlight {
            ticket: self.window.issued(now_secs, self.fetches.is_empty()),
            pages: range.collect(),
        };
        self.fetches.insert(id, in_flight);
        self.stats.fetches += 1;
        fetch
    }

    /// `page` and its neighbours in the same asset that may come along.
    fn joined(&self, page: u32) -> std::ops::Range<u32> {
        let asset = self.pages.asset_pages(page);
        let least_px = JOIN_PRIORITY * self.records[page as usize].priority_px;
        let mut range = page..page + 1;
        let mut bytes = self.pages.frame_bytes(page) as u64;
        let mut joins = |page: u32, range: &std::ops::Range<u32>| {
            let sum = bytes + self.pages.frame_bytes(page) as u64;
            let ready = |dependency: &u32| match self.state(*dependency) {
                PageState::Wanted | PageState::Absent => range.contains(dependency),
                PageState::Failed { .. } => false,
                _ => true,
            };
            let fits = sum <= MAX_JOINED_BYTES
                && self.state(page) == PageState::Wanted
                && self.records[page as usize].priority_px >= least_px
                && self.pages.dependencies(page).iter().all(ready);
            if fits {
                bytes = sum;
            }
            fits
        };
        while range.end < asset.end && joins(range.end, &range) {
            range.end += 1;
        }
        while range.start > asset.start && joins(range.start - 1, &range) {
            range.start -= 1;
        }
        range
    }
}
