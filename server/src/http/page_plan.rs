//! The order in which posted wants are answered: most urgent first, each page once, neighbours joined into one read.

use lodestream_format::limits::MAX_PAGES_A_REQUEST;
use lodestream_format::wire::{PageWant, PagesPost};
use lodestream_format::{ContentHash, FormatError};

use super::error::HttpError;
use super::page_cache::RUN_BYTES;

/// Consecutive pages of one asset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    pub asset: ContentHash,
    pub first: u32,
    /// Inclusive.
    pub last: u32,
}

/// What is still to be answered.
#[derive(Debug)]
pub(super) struct PagePlan {
    /// Most urgent first; equally urgent ones by asset and page, which is coarse to fine. A
    /// range in the post is a run here: an unread answer holds no more than its post.
    runs: Vec<Run>,
    at: usize,
    /// Assets that are not there.
    missed: Vec<ContentHash>,
}

/// Assets of one post that may be missing, before those that are not in memory are not looked up
/// any longer: viewers ask for what their scene names.
const MOST_MISSED: usize = 64;

impl PagePlan {
    /// Checks a post's limits and orders its pages.
    pub(super) fn new(post: &PagesPost) -> Result<Self, HttpError> {
        let wrong = |at: usize, field: &str, expected: &str, found: String| {
            let at = format!("wants[{at}].{field}");
            HttpError::BadRequest(FormatError::new(at, expected, found))
        };
        let mut count = 0u64;
        for (index, want) in post.wants.iter().enumerate() {
            if !want.priority.is_finite() {
                let found = want.priority.to_string();
                return Err(wrong(index, "priority", "a finite number", found));
            }
            if want.first > want.last {
                let found = format!("{}", want.last);
                return Err(wrong(index, "last", "at least first", found));
            }
            count += (want.last - want.first) as u64 + 1;
        }
        if count > MAX_PAGES_A_REQUEST as u64 {
            let expected = format!("at most {MAX_PAGES_A_REQUEST}");
            return Err(HttpError::TooLarge(FormatError::new(
                "pages of all wants",
                expected,
                count,
            )));
        }
        Ok(Self {
            runs: order(&post.wants),
            at: 0,
            missed: Vec::new(),
        })
    }

    /// Bytes that it holds.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.runs[..])
    }

    /// Remembers that an asset is not there.
    pub(super) fn miss(&mut self, asset: ContentHash) {
        self.missed.push(asset);
    }

    /// Whether it is known that the asset is not there.
    pub(super) fn is_missed(&self, asset: &ContentHash) -> bool {
        self.missed.contains(asset)
    }

    /// Whether assets may still be looked up.
    pub(super) fn may_look(&self) -> bool {
        self.missed.len() < MOST_MISSED
    }

    /// The asset of the next run.
    pub(super) fn next_asset(&self) -> Option<ContentHash> {
        self.runs.get(self.at).map(|run| run.asset)
    }

    /// The next pages that one read answers, given the bytes of each page of that asset.
    pub(super) fn next_run(&mut self, page_bytes: impl Fn(u32) -> u64) -> Option<Run> {
        let left = self.runs.get_mut(self.at)?;
        let mut run = Run {
            last: left.first,
            ..*left
        };
        let mut bytes = page_bytes(run.first);
        while run.last < left.last {
            bytes = bytes.saturating_add(page_bytes(run.last + 1));
            if bytes > RUN_BYTES {
                left.first = run.last + 1;
                return Some(run);
            }
            run.last += 1;
        }
        self.at += 1;
        Some(run)
    }
}

fn order(wants: &[PageWant]) -> Vec<Run> {
    let mut pages: Vec<_> = wants
        .iter()
        .flat_map(|want| (want.first..=want.last).map(|page| (want.asset, page, want.priority)))
        .collect();
    // A page wanted twice keeps its larger priority.
    pages.sort_unstable_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(b.2.total_cmp(&a.2)));
    pages.dedup_by_key(|page| (page.0, page.1));
    pages.sort_by(|a, b| b.2.total_cmp(&a.2));
    let mut runs: Vec<Run> = Vec::new();
    for (asset, page, _) in pages {
        match runs.last_mut() {
            Some(run) if run.asset == asset && run.last.checked_add(1) == Some(page) => {
                run.last = page;
            }
            _ => runs.push(Run {
                asset,
                first: page,
                last: page,
            }),
        }
    }
    runs.shrink_to_fit();
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn post(wants: &[(u8, u32, u32, f32)]) -> PagesPost {
        let wants = wants
            .iter()
            .map(|&(asset, first, last, priority)| PageWant {
                asset: ContentHash([asset; 32]),
                first,
                last,
                priority,
            });
        PagesPost {
            viewer: 1,
            sequence: 1,
            wants: wants.collect(),
        }
    }

    fn runs(wants: &[(u8, u32, u32, f32)], page_bytes: u64) -> Vec<(u8, u32, u32)> {
        let mut plan = PagePlan::new(&post(wants)).expect("valid");
        std::iter::from_fn(|| plan.next_run(|_| page_bytes))
            .map(|run| (run.asset.0[0], run.first, run.last))
            .collect()
    }

    #[test]
    fn urgent_pages_come_first_and_neighbours_join() {
        let wants = [(1, 4, 9, 1.0), (1, 0, 3, 5.0), (2, 7, 7, 9.0)];
        assert_eq!(runs(&wants, 1), [(2, 7, 7), (1, 0, 9)]);
        assert_eq!(
            runs(&wants, RUN_BYTES / 4),
            [(2, 7, 7), (1, 0, 3), (1, 4, 7), (1, 8, 9)]
        );
        assert_eq!(
            runs(&[(1, 0, 1, 1.0)], RUN_BYTES * 2),
            [(1, 0, 0), (1, 1, 1)]
        );
    }

    #[test]
    fn a_range_is_held_as_a_range() {
        let plan = PagePlan::new(&post(&[(1, 0, 65_000, 1.0), (1, 100, 200, 0.5)]));
        assert_eq!(plan.expect("valid").bytes(), size_of::<Run>());
    }

    #[test]
    fn limits_are_checked_before_anything_is_expanded() {
        assert!(PagePlan::new(&post(&[(1, 0, u32::MAX, 1.0)])).is_err());
        assert!(PagePlan::new(&post(&[(1, 3, 2, 1.0)])).is_err());
        assert!(PagePlan::new(&post(&[(1, 0, 0, f32::INFINITY)])).is_err());
        assert!(PagePlan::new(&post(&[])).is_ok());
    }

    proptest! {
        #[test]
        fn every_page_comes_once_in_falling_priority(
            wants in prop::collection::vec((0u8..3, 0u32..20, 0u32..6, -2i32..4), 0..20),
            page_bytes in 1u64..RUN_BYTES,
        ) {
            let wants: Vec<_> = wants.into_iter()
                .map(|(asset, first, more, priority)| (asset, first, first + more, priority as f32))
                .collect();
            let mut largest = std::collections::BTreeMap::new();
            for &(asset, first, last, priority) in &wants {
                for page in first..=last {
                    let known = largest.entry((asset, page)).or_insert(priority);
                    *known = known.max(priority);
                }
            }
            let got: Vec<_> = runs(&wants, page_bytes).into_iter()
                .inspect(|run| assert!(run.1 == run.2 || (run.2 - run.1 + 1) as u64 * page_bytes <= RUN_BYTES))
                .flat_map(|(asset, first, last)| (first..=last).map(move |page| (asset, page)))
                .collect();
            prop_assert!(got.is_sorted_by(|a, b| largest[a] >= largest[b]));
            let mut unique = got.clone();
            unique.sort();
            prop_assert_eq!(unique, largest.into_keys().collect::<Vec<_>>());
        }
    }
}
