//! How many bytes to have in flight: bandwidth times latency, both measured from the fetches themselves.
//!
//! After BBR (Cardwell et al., "BBR: Congestion-Based Congestion Control", 2016): the bandwidth is the largest delivery
//! rate of late, the latency the smallest time of a fetch of late, and twice their product stays in flight. Twice, so that
//! an estimate that is too small doubles with every round, and the link stays busy while answers wait for the next frame.
//!
//! Twice the product makes a queue, and every fetch then measures latency and queue. An old latency is therefore never
//! replaced by such a fetch, or queue and estimate would drive each other up: when it is due, the window shuts until few
//! fetches are left, and one that was issued then is measured.

use std::collections::VecDeque;

/// Rates older than this no longer count, and a latency so old is measured anew.
const SAMPLE_LIFE_SECS: f64 = 10.0;
/// Rates kept at most.
const MAX_SAMPLES: usize = 256;
/// Window before the first sample.
const FIRST_WINDOW_BYTES: u64 = 1 << 20;
/// A frame is the finest time that a fetch can take as seen from the frame thread.
const SHORTEST_FETCH_SECS: f64 = 1e-3;

/// Taken when a fetch begins, given back when it ends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ticket {
    issued_secs: f64,
    delivered_bytes: u64,
    /// Whether little or nothing was in flight, so that the fetch measures no queue.
    is_alone: bool,
}

#[derive(Debug, Clone, Default)]
pub(crate) struct Window {
    delivered_bytes: u64,
    rates: VecDeque<Rate>,
    latency: Option<Latency>,
    is_shut: bool,
}

#[derive(Debug, Clone, Copy)]
struct Rate {
    at_secs: f64,
    bytes_a_sec: f64,
}

#[derive(Debug, Clone, Copy)]
struct Latency {
    at_secs: f64,
    secs: f64,
}

impl Window {
    /// To be called before fetches are issued; `is_idle`: nothing is in flight.
    pub(crate) fn tick(&mut self, now_secs: f64, is_idle: bool) {
        self.is_shut = !is_idle && self.is_latency_due(now_secs);
    }

    fn is_latency_due(&self, now_secs: f64) -> bool {
        self.latency
            .is_some_and(|latency| now_secs - latency.at_secs > SAMPLE_LIFE_SECS)
    }

    pub(crate) fn issued(&self, now_secs: f64, is_idle: bool) -> Ticket {
        Ticket {
            issued_secs: now_secs,
            delivered_bytes: self.delivered_bytes,
            is_alone: is_idle || self.is_shut,
        }
    }

    /// A page of `bytes` came.
    pub(crate) fn delivered(&mut self, bytes: u64) {
        self.delivered_bytes += bytes;
    }

    /// All of a fetch came.
    pub(crate) fn finished(&mut self, ticket: Ticket, now_secs: f64) {
        let secs = (now_secs - ticket.issued_secs).max(SHORTEST_FETCH_SECS);
        let bytes = self.delivered_bytes - ticket.delivered_bytes;
        self.rates.push_back(Rate {
            at_secs: now_secs,
            bytes_a_sec: bytes as f64 / secs,
        });
        let stale = |rate: &Rate| now_secs - rate.at_secs > SAMPLE_LIFE_SECS;
        while self.rates.len() > MAX_SAMPLES || self.rates.front().is_some_and(stale) {
            self.rates.pop_front();
        }
        let is_news = ticket.is_alone && self.is_latency_due(now_secs);
        if is_news || self.latency.is_none_or(|latency| secs <= latency.secs) {
            self.latency = Some(Latency {
                at_secs: now_secs,
                secs,
            });
        }
    }

    /// Largest delivery rate of late, bytes a second; 0 before the first sample.
    pub(crate) fn bytes_a_sec(&self) -> f64 {
        let rates = self.rates.iter().map(|rate| rate.bytes_a_sec);
        rates.fold(0.0, f64::max)
    }

    /// Shortest fetch of late, seconds; 0 before the first sample.
    pub(crate) fn latency_secs(&self) -> f64 {
        self.latency.map_or(0.0, |latency| latency.secs)
    }

    /// Bytes to have in flight; 0 while the latency is measured, when only the fewest fetches are kept in flight.
    pub(crate) fn bytes(&self) -> u64 {
        match (self.latency, self.is_shut) {
            (None, _) => FIRST_WINDOW_BYTES,
            (Some(_), true) => 0,
            (Some(latency), false) => (2.0 * self.bytes_a_sec() * latency.secs) as u64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A link of so many bytes a second and a latency that may change, asked for fetches of 64 KiB at 60 frames a second.
    /// Gives the share of the link that was used in the last half of the time, and the most seconds of queue.
    fn drive(link_bytes_a_sec: f64, latency_at: impl Fn(f64) -> f64, secs: f64) -> (f64, f64) {
        const FETCH_BYTES: u64 = 65_536;
        let mut window = Window::default();
        let mut fetches: VecDeque<(Ticket, f64)> = VecDeque::new();
        let (mut link_free_secs, mut late_bytes, mut longest_queue) = (0.0f64, 0, 0.0f64);
        let frames = (secs * 60.0) as u64;
        for frame in 0..frames {
            let now_secs = frame as f64 / 60.0;
            let latency_secs = latency_at(now_secs);
            while let Some(&(ticket, done_secs)) = fetches.front()
                && done_secs <= now_secs
            {
                fetches.pop_front();
                window.delivered(FETCH_BYTES);
                window.finished(ticket, now_secs);
                if frame > frames / 2 {
                    late_bytes += FETCH_BYTES;
                }
            }
            window.tick(now_secs, fetches.is_empty());
            while fetches.len() < 4 || (fetches.len() as u64) * FETCH_BYTES < window.bytes() {
                let sent_secs = link_free_secs.max(now_secs + latency_secs);
                longest_queue = longest_queue.max(sent_secs - now_secs - latency_secs);
                link_free_secs = sent_secs + FETCH_BYTES as f64 / link_bytes_a_sec;
                let ticket = window.issued(now_secs, fetches.is_empty());
                fetches.push_back((ticket, link_free_secs));
            }
        }
        (
            late_bytes as f64 / (link_bytes_a_sec * secs / 2.0),
            longest_queue,
        )
    }

    /// A minute: long enough for a latency that queue and estimate drive up to show.
    #[test]
    fn any_link_is_kept_busy_without_a_long_queue() {
        for mbps in [2.0, 10.0, 100.0, 1000.0] {
            for latency_ms in [1.0, 38.0, 200.0] {
                let link = mbps * 1e6 / 8.0;
                let (used, queue) = drive(link, |_| latency_ms / 1e3, 60.0);
                assert!(used > 0.9, "{mbps} Mbps {latency_ms} ms: {used} used");
                // Four fetches of 64 KiB or the first window of 1 MiB, whichever is the longer on a slow link, else twice the
                // product of bandwidth and latency, frame times included.
                let bound =
                    (1.1 * (1u64 << 20) as f64 / link).max(3.0 * (latency_ms / 1e3 + 3.0 / 60.0));
                assert!(
                    queue < bound,
                    "{mbps} Mbps {latency_ms} ms: {queue} s of queue"
                );
            }
        }
    }

    /// On a link that is never idle, only the shut window can tell that the latency rose.
    #[test]
    fn a_latency_that_rises_on_a_busy_link_is_found_out() {
        let latency_at = |now_secs: f64| if now_secs < 5.0 { 0.005 } else { 0.2 };
        let (used, _) = drive(100e6 / 8.0, latency_at, 60.0);
        assert!(used > 0.9, "{used} used");
    }
}
