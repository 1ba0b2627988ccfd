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
    /// Most urgent first; equally urgent ones by asset and page, which is coarse to fine.
    pages: Vec<(ContentHash, u32)>,
    at: usize,
}

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
            pages: order(&post.wants),
            at: 0,
        })
    }

    /// The asset of the next run.
    pub(super) fn next_asset(&self) -> Option<ContentHash> {
        self.pages.get(self.at).map(|(asset, _)| *asset)
    }

    /// The next pages that one read answers, given the bytes of each page of that asset.
    pub(super) fn next_run(&mut self, page_bytes: impl Fn(u32) -> u64) -> Option<Run> {
        let &(asset, first) = self.pages.get(self.at)?;
        let (mut last, mut bytes) = (first, page_bytes(first));
        self.at += 1;
        while let Some(&(next_asset, next)) = self.pages.get(self.at) {
            bytes = bytes.saturating_add(page_bytes(next));
            if next_asset != asset || last.checked_add(1) != Some(next) || bytes > RUN_BYTES {
                break;
            }
            last = next;
            self.at += 1;
        }
        Some(Run { asset, first, last })
    }
}

fn order(wants: &[PageWant]) -> Vec<(ContentHash, u32)> {
    let mut pages: Vec<_> = wants
        .iter()
        .flat_map(|want| (want.first..=want.last).map(|page| (want.asset, page, want.priority)))
        .collect();
    // A page wanted twice keeps its larger priority.
    pages.sort_unstable_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(b.2.total_cmp(&a.2)));
    pages.dedup_by_key(|page| (page.0, page.1));
    pages.sort_by(|a, b| b.2.total_cmp(&a.2));
    pages
        .into_iter()
        .map(|(asset, page, _)| (asset, page))
        .collect()
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
