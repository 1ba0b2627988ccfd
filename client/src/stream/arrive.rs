//! What came, or did not: out of flight into host memory, or into a back-off.

use std::collections::btree_map::Entry;

use lodestream_format::FormatError;

use super::error::{Retry, StreamError};
use super::page_state::{PageEvent, PageState};
use super::residency::{NO_FETCH, PageForm, Residency};

/// Wait after the first failure.
const FIRST_BACK_OFF_SECS: f64 = 0.25;
/// Longest wait.
const MAX_BACK_OFF_SECS: f64 = 30.0;

impl<Form: PageForm> Residency<Form> {
    /// Takes a page that came, or the reason why it did not. A page that is not in flight (any more) is passed over.
    pub fn arrived(&mut self, page: u32, result: Result<Form, StreamError>, now_secs: f64) {
        if page >= self.pages.count() || self.state(page) != PageState::InFlight {
            self.stats.pages_superseded += 1;
            return;
        }
        let bytes = self.pages.frame_bytes(page) as u64;
        self.in_flight_bytes -= bytes;
        if result.is_ok() {
            self.window.delivered(bytes);
        }
        self.leave_fetch(page, result.is_ok(), now_secs);
        let local = page - self.pages.asset_pages(page).start;
        match result {
            Ok(form) if form.page() == local => {
                self.stats.pages_fetched += 1;
                self.stats.bytes_fetched += bytes;
                self.decoded_bytes += bytes;
                self.records[page as usize].failures = 0;
                self.step(page, PageEvent::Arrive);
                self.decoded.insert(page, form);
            }
            Ok(form) => {
                let expected = format!("page {local} of its asset");
                let error = FormatError::new("page", expected, form.page());
                self.fail(
                    page,
                    StreamError::format(format!("scene page {page}"))(error),
                    now_secs,
                );
            }
            Err(error) => self.fail(page, error, now_secs),
        }
    }

    fn leave_fetch(&mut self, page: u32, came: bool, now_secs: f64) {
        let id = std::mem::replace(&mut self.records[page as usize].fetch, NO_FETCH);
        if let Entry::Occupied(mut entry) = self.fetches.entry(id) {
            entry.get_mut().pages.retain(|&other| other != page);
            if entry.get().pages.is_empty() {
                let fetch = entry.remove();
                if came {
                    self.window.finished(fetch.ticket, now_secs);
                }
            }
        }
    }

    fn fail(&mut self, page: u32, error: StreamError, now_secs: f64) {
        let record = &mut self.records[page as usize];
        record.failures = record.failures.saturating_add(1);
        let attempts = record.failures;
        let doubled = FIRST_BACK_OFF_SECS * 2f64.powi(attempts.min(16) as i32 - 1);
        let wait_secs = match error.retry() {
            Retry::BackOff => doubled.min(MAX_BACK_OFF_SECS),
            Retry::After(secs) => {
                secs.clamp(doubled.min(MAX_BACK_OFF_SECS), 10.0 * MAX_BACK_OFF_SECS)
            }
            Retry::Late => MAX_BACK_OFF_SECS,
        };
        // Pages that failed together come back spread over a quarter of the wait.
        let spread = (page.wrapping_mul(0x9e37_79b1) >> 16) as f64 / 65_536.0;
        let retry_at_secs = now_secs + wait_secs * (1.0 + 0.25 * spread);
        tracing::warn!(page, attempts, wait_secs, %error, "page failed");
        self.stats.failures += 1;
        self.stats.last_failure = Some(error.to_string());
        self.step(
            page,
            PageEvent::Fail {
                retry_at_secs,
                attempts,
            },
        );
    }
}
