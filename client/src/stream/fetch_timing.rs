//! How long fetches take, for load tests: from the update that issued one to the last of its bytes, whatever the transport.

use std::collections::HashMap;
use std::ops::Range;
use std::time::Instant;

use super::error::StreamError;

/// A fetch that ended and was not called off.
#[derive(Debug, Clone)]
pub struct FetchTiming {
    /// The tick that issued it, counted from 1.
    pub update: u64,
    /// When that was.
    pub issued: Instant,
    /// When the last of its pages had come, before any was decompressed.
    pub ended: Instant,
    /// Its pages.
    pub pages: u32,
    /// Their bytes; 0 where it failed.
    pub bytes: u64,
    /// Why it failed, or the first of its pages did.
    pub error: Option<StreamError>,
}

/// Fetches under way, once somebody wants to know.
#[derive(Debug, Default)]
pub(crate) struct FetchTimings {
    /// The ticks so far.
    pub(crate) update: u64,
    under_way: HashMap<u64, UnderWay>,
    fetch_of_page: HashMap<u32, u64>,
    ended: Vec<FetchTiming>,
}

#[derive(Debug)]
struct UnderWay {
    pages_left: u32,
    timing: FetchTiming,
}

impl FetchTimings {
    pub(crate) fn issued(&mut self, fetch: u64, pages: Range<u32>, bytes: u64, now: Instant) {
        let count = pages.end - pages.start;
        self.fetch_of_page.extend(pages.map(|page| (page, fetch)));
        let timing = FetchTiming {
            update: self.update,
            issued: now,
            ended: now,
            pages: count,
            bytes,
            error: None,
        };
        self.under_way.insert(
            fetch,
            UnderWay {
                pages_left: count,
                timing,
            },
        );
    }

    /// What was called off is not measured: nobody waits for it any more.
    pub(crate) fn cancelled(&mut self, fetch: u64) {
        self.under_way.remove(&fetch);
        self.fetch_of_page.retain(|_, of| *of != fetch);
    }

    pub(crate) fn arrived(&mut self, page: u32, came: Instant, error: Option<&StreamError>) {
        let Some(fetch) = self.fetch_of_page.remove(&page) else {
            return;
        };
        let Some(under_way) = self.under_way.get_mut(&fetch) else {
            return;
        };
        under_way.pages_left -= 1;
        let timing = &mut under_way.timing;
        timing.ended = timing.ended.max(came);
        if let Some(error) = error {
            timing.bytes = 0;
            timing.error.get_or_insert_with(|| error.clone());
        }
        if under_way.pages_left == 0
            && let Some(under_way) = self.under_way.remove(&fetch)
        {
            self.ended.push(under_way.timing);
        }
    }

    pub(crate) fn take(&mut self) -> Vec<FetchTiming> {
        std::mem::take(&mut self.ended)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_fetch_ends_with_its_last_page_and_cancelled_ones_never_do() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut timings = FetchTimings {
            update: 7,
            ..FetchTimings::default()
        };
        timings.issued(1, 10..12, 500, at(0));
        timings.issued(2, 20..21, 100, at(0));
        timings.issued(3, 30..31, 100, at(5));
        timings.cancelled(2);
        timings.arrived(20, at(9), None);
        timings.arrived(11, at(8), None);
        assert!(timings.take().is_empty());
        timings.arrived(10, at(6), None);
        let error = StreamError::NotFound {
            place: "here".into(),
        };
        timings.arrived(30, at(9), Some(&error));
        let ended = timings.take();
        assert_eq!(ended.len(), 2);
        assert_eq!(
            (ended[0].update, ended[0].pages, ended[0].bytes),
            (7, 2, 500)
        );
        assert_eq!((ended[0].ended, ended[0].error.as_ref()), (at(8), None));
        assert_eq!((ended[1].bytes, ended[1].error.as_ref()), (0, Some(&error)));
        assert!(timings.fetch_of_page.is_empty() && timings.under_way.is_empty());
    }
}
