//! How slow an answer may be. Time counts only while it is waited for, and bytes win it back up to
//! the grace, so that a large answer over a slow link goes on for hours and a trickle ends soon,
//! whatever came before it.
//!
//! On a slow link the server sends what is most urgent first, and other answers wait: bytes of any
//! answer count for all. An answer of which nothing comes while others do has ten times the grace.

use std::future::Future;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use super::super::error::StreamError;
use super::super::limits::StreamLimits;

/// An answer alone may be slower than all together: by this much in its grace, and as much in its
/// rate.
const ALONE: f64 = 10.0;

/// Bytes of all answers of a source.
#[derive(Debug, Default)]
pub(super) struct Link {
    came_bytes: AtomicU64,
}

/// Time that one answer has left.
pub(super) struct Pace {
    link: Arc<Link>,
    limits: StreamLimits,
    begun: Instant,
    came_bytes: u64,
    seen_link_bytes: u64,
    link_left_secs: f64,
    own_left_secs: f64,
}

impl Pace {
    /// For an answer that is asked for now.
    pub(super) fn new(link: &Arc<Link>, limits: &StreamLimits) -> Self {
        Self {
            seen_link_bytes: link.came_bytes.load(Ordering::Relaxed),
            link: link.clone(),
            limits: *limits,
            begun: Instant::now(),
            came_bytes: 0,
            link_left_secs: limits.grace.as_secs_f64(),
            own_left_secs: ALONE * limits.grace.as_secs_f64(),
        }
    }

    /// Counts bytes of this answer.
    pub(super) fn came(&mut self, bytes: usize) {
        self.came_bytes += bytes as u64;
        self.link
            .came_bytes
            .fetch_add(bytes as u64, Ordering::Relaxed);
        let grace_secs = ALONE * self.limits.grace.as_secs_f64();
        let won_secs = ALONE * bytes as f64 / self.limits.least_bytes_a_sec;
        self.own_left_secs = grace_secs.min(self.own_left_secs + won_secs);
    }

    /// Adds what came by any answer since the last call.
    fn see_link(&mut self) {
        let link_bytes = self.link.came_bytes.load(Ordering::Relaxed);
        let bytes = link_bytes - std::mem::replace(&mut self.seen_link_bytes, link_bytes);
        let won_secs = bytes as f64 / self.limits.least_bytes_a_sec;
        let grace_secs = self.limits.grace.as_secs_f64();
        self.link_left_secs = grace_secs.min(self.link_left_secs + won_secs);
    }

    fn left_secs(&mut self) -> f64 {
        self.see_link();
        self.link_left_secs.min(self.own_left_secs)
    }

    fn waited(&mut self, secs: f64) {
        self.link_left_secs -= secs;
        self.own_left_secs -= secs;
    }

    /// Waits for `work` as long as the pace allows.
    ///
    /// # Errors
    /// [`StreamError::Slow`] once nothing is left.
    pub(super) async fn keep<T>(
        &mut self,
        url: &str,
        work: impl Future<Output = T>,
    ) -> Result<T, StreamError> {
        let mut work = pin!(work);
        loop {
            let left_secs = self.left_secs();
            if left_secs <= 0.0 {
                return Err(StreamError::Slow {
                    url: url.to_owned(),
                    least_bytes_a_sec: self.limits.least_bytes_a_sec,
                    grace_secs: self.limits.grace.as_secs_f64(),
                    found_bytes: self.came_bytes,
                    secs: self.begun.elapsed().as_secs_f64(),
                });
            }
            let start = Instant::now();
            let done = tokio::time::timeout(Duration::from_secs_f64(left_secs), &mut work).await;
            self.waited(start.elapsed().as_secs_f64());
            if let Ok(done) = done {
                return Ok(done);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pace(link: &Arc<Link>) -> Pace {
        let limits = StreamLimits {
            grace: Duration::from_secs(30),
            least_bytes_a_sec: 500.0,
            ..StreamLimits::default()
        };
        Pace::new(link, &limits)
    }

    /// Seconds that answers go on which bring `bytes` every `pause_secs`; at most a day.
    fn lasts_secs(bytes: usize, pause_secs: f64) -> f64 {
        let mut pace = pace(&Arc::default());
        let mut secs = 0.0;
        while pace.left_secs() >= pause_secs && secs < 86_400.0 {
            pace.waited(pause_secs);
            pace.came(bytes);
            secs += pause_secs;
        }
        secs
    }

    #[test]
    fn modems_go_on_and_trickles_end_soon() {
        // 56 kbit/s in pieces of two seconds.
        assert_eq!(lasts_secs(14_000, 2.0), 86_400.0);
        assert_eq!(lasts_secs(600, 1.0), 86_400.0);
        assert!(lasts_secs(1, 1.0) < 31.0);
        assert!(lasts_secs(100, 1.0) < 40.0);
        assert!(lasts_secs(1 << 20, 60.0) < 61.0);
    }

    #[test]
    fn a_burst_buys_no_more_than_the_grace() {
        let mut pace = pace(&Arc::default());
        pace.came(1 << 30);
        assert_eq!(pace.left_secs(), 30.0);
        pace.waited(30.0);
        assert!(pace.left_secs() <= 0.0);
    }

    #[test]
    fn an_answer_waits_while_others_come_but_not_for_ever() {
        let link = Arc::new(Link::default());
        let (mut waits, mut comes) = (pace(&link), pace(&link));
        let mut secs = 0.0;
        while waits.left_secs() > 0.0 {
            waits.waited(10.0);
            comes.came(50_000);
            secs += 10.0;
        }
        assert_eq!(secs, 300.0);
    }
}
