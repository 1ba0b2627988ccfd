//! When a connection was last of use, and that it is told to end: to make room for others, or
//! because nobody uses it.

use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use futures_util::task::AtomicWaker;
use tokio::time::Instant;

/// Of one connection.
#[derive(Debug)]
pub(super) struct Activity {
    born: Instant,
    /// Requests that are not answered.
    requests: AtomicU32,
    /// When the last of them was, in milliseconds since `born`.
    idle_ms: AtomicU64,
    /// Since when the client takes nothing of an answer, in milliseconds since `born`, and one; 0
    /// while it does.
    stalled_ms: AtomicU64,
    is_told: AtomicBool,
    waker: AtomicWaker,
}

/// A request that is not answered, until this is dropped.
#[derive(Debug)]
pub(super) struct InFlight(Arc<Activity>);

impl Default for Activity {
    fn default() -> Self {
        Self {
            born: Instant::now(),
            requests: AtomicU32::new(0),
            idle_ms: AtomicU64::new(0),
            stalled_ms: AtomicU64::new(0),
            is_told: AtomicBool::new(false),
            waker: AtomicWaker::new(),
        }
    }
}

impl Activity {
    /// A request begins.
    pub(super) fn begin(self: &Arc<Self>) -> InFlight {
        self.requests.fetch_add(1, Ordering::Relaxed);
        InFlight(Arc::clone(self))
    }

    /// The same, where a connection has one request at a time; it lasts until
    /// [`Activity::set_idle`].
    pub(super) fn set_busy(&self) {
        self.requests.store(1, Ordering::Relaxed);
    }

    /// That request is answered.
    pub(super) fn set_idle(&self, now: Instant) {
        self.idle_ms.store(self.millis(now), Ordering::Relaxed);
        self.requests.store(0, Ordering::Release);
    }

    /// The client takes nothing since then; or takes something again.
    pub(super) fn set_stalled(&self, since: Option<Instant>) {
        let millis = since.map_or(0, |since| self.millis(since) + 1);
        self.stalled_ms.store(millis, Ordering::Relaxed);
    }

    fn millis(&self, at: Instant) -> u64 {
        at.saturating_duration_since(self.born).as_millis() as u64
    }

    /// Since when no request is in flight.
    pub(super) fn idle_since(&self) -> Option<Instant> {
        let is_idle = self.requests.load(Ordering::Acquire) == 0;
        let since = self.idle_ms.load(Ordering::Relaxed);
        is_idle.then(|| self.born + Duration::from_millis(since))
    }

    /// Since when its client takes nothing of an answer.
    pub(super) fn stalled_since(&self) -> Option<Instant> {
        let since = self.stalled_ms.load(Ordering::Relaxed).checked_sub(1)?;
        Some(self.born + Duration::from_millis(since))
    }

    /// Ends when no request was in flight for `time`, from now on.
    pub(super) async fn idle_for(&self, time: Duration) {
        let began = Instant::now();
        loop {
            let now = Instant::now();
            let until = self.idle_since().unwrap_or(now).max(began) + time;
            if until <= now {
                return;
            }
            tokio::time::sleep_until(until).await;
        }
    }

    /// Tells the connection to end; whether nobody had before.
    pub(super) fn end(&self) -> bool {
        let is_first = !self.is_told.swap(true, Ordering::AcqRel);
        self.waker.wake();
        is_first
    }

    /// Whether it is told to end.
    pub(super) fn is_told(&self) -> bool {
        self.is_told.load(Ordering::Acquire)
    }

    /// Ready when it is told to end; for one task at a time.
    pub(super) fn poll_told(&self, context: &mut Context<'_>) -> Poll<()> {
        if !self.is_told() {
            self.waker.register(context.waker());
        }
        match self.is_told() {
            true => Poll::Ready(()),
            false => Poll::Pending,
        }
    }

    /// The output of `future`, unless the connection is told to end before. By reference: a future
    /// that is moved into another one takes its size twice.
    pub(super) async fn unless_told<F: Future>(
        &self,
        mut future: Pin<&mut F>,
    ) -> Option<F::Output> {
        poll_fn(|context| match future.as_mut().poll(context) {
            Poll::Ready(done) => Poll::Ready(Some(done)),
            Poll::Pending => self.poll_told(context).map(|()| None),
        })
        .await
    }
}

impl Drop for InFlight {
    fn drop(&mut self) {
        let now = self.0.millis(Instant::now());
        self.0.idle_ms.store(now, Ordering::Relaxed);
        self.0.requests.fetch_sub(1, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::pin::pin;

    const SECOND: Duration = Duration::from_secs(1);

    #[tokio::test(start_paused = true)]
    async fn idle_is_what_has_no_request_for_the_whole_time() {
        let activity = Arc::<Activity>::default();
        let began = Instant::now();
        activity.idle_for(2 * SECOND).await;
        assert_eq!(began.elapsed(), 2 * SECOND);
        let requests = async {
            for _ in 0..5 {
                let first = activity.begin();
                tokio::time::sleep(3 * SECOND).await;
                let second = activity.begin();
                drop(first);
                assert!(activity.idle_since().is_none());
                tokio::time::sleep(SECOND).await;
                drop(second);
                tokio::time::sleep(SECOND).await;
            }
            Instant::now()
        };
        let (last, ()) = tokio::join!(requests, activity.idle_for(2 * SECOND));
        assert!((SECOND..=3 * SECOND).contains(&last.elapsed()));
    }

    #[tokio::test(start_paused = true)]
    async fn a_connection_that_is_told_to_end_does_so_at_once() {
        let activity = Arc::<Activity>::default();
        let began = Instant::now();
        let tells = async {
            tokio::time::sleep(SECOND).await;
            (activity.end(), activity.end())
        };
        let mut serves = pin!(tokio::time::sleep(60 * SECOND));
        let (done, told) = tokio::join!(activity.unless_told(serves.as_mut()), tells);
        assert_eq!((done, told), (None, (true, false)));
        assert_eq!(began.elapsed(), SECOND);
        let done = activity.unless_told(pin!(async { 7 })).await;
        assert_eq!(done, Some(7), "what is done is done");
    }
}
