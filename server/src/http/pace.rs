//! The pace of bodies: one that stalls or trickles is given up with 408, so that no client holds
//! room by sending nothing. Only time spent waiting for the client counts, never the server's own.

use std::time::Duration;

use bytes::Bytes;
use futures_util::{Stream, StreamExt};
use lodestream_format::FormatError;
use tokio::time::{Instant, timeout};

use super::error::HttpError;

/// Time between two looks at the pace, which may change while a client is waited for.
const LOOK_AGAIN: Duration = Duration::from_millis(250);

/// The slowest that a body may come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pace {
    /// Longest wait for the next bytes.
    pub idle: Duration,
    /// Wait that is free, over the whole body.
    pub grace: Duration,
    /// Bytes that each second of waiting beyond the grace must have brought; above 0.
    pub min_bytes_per_sec: u64,
}

impl Pace {
    /// The wait that `bytes` pay for.
    fn allowed(&self, bytes: u64) -> Duration {
        self.grace + Duration::from_secs_f64(bytes as f64 / self.min_bytes_per_sec as f64)
    }
}

/// A body that keeps a pace, or fails.
pub(super) struct PacedBody<S, P> {
    /// The body's name in errors.
    name: &'static str,
    pieces: S,
    pace: P,
    bytes: u64,
    waited: Duration,
    /// Waited since the last bytes.
    idle: Duration,
}

impl<S, E, P> PacedBody<S, P>
where
    S: Stream<Item = Result<Bytes, E>> + Unpin,
    E: std::fmt::Display,
    P: Fn() -> Pace,
{
    /// The body `name`, whose pace is asked for again and again.
    pub(super) fn new(name: &'static str, pieces: S, pace: P) -> Self {
        Self {
            name,
            pieces,
            pace,
            bytes: 0,
            waited: Duration::ZERO,
            idle: Duration::ZERO,
        }
    }

    /// The next bytes, at least one; none at the end.
    ///
    /// # Errors
    /// [`HttpError::Slow`] where they do not come at the pace, [`HttpError::BadRequest`] where the
    /// body is cut.
    pub(super) async fn next(&mut self) -> Result<Option<Bytes>, HttpError> {
        loop {
            let pace = (self.pace)();
            let left = pace.allowed(self.bytes).saturating_sub(self.waited);
            let left = left.min(pace.idle.saturating_sub(self.idle));
            let began = Instant::now();
            // Polls the body before the clock: bytes that are there are taken in any case.
            let piece = timeout(left.min(LOOK_AGAIN), self.pieces.next()).await;
            let waited = began.elapsed();
            self.waited += waited;
            self.idle += waited;
            match piece {
                Err(_) if waited >= left => return Err(HttpError::Slow),
                // Empty pieces are no progress.
                Err(_) => {}
                Ok(Some(Ok(piece))) if piece.is_empty() => {}
                Ok(Some(Ok(piece))) => {
                    self.bytes += piece.len() as u64;
                    self.idle = Duration::ZERO;
                    return Ok(Some(piece));
                }
                Ok(Some(Err(error))) => {
                    let error = FormatError::new(self.name, "a whole body", error);
                    return Err(HttpError::BadRequest(error));
                }
                Ok(None) => return Ok(None),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::stream;
    use std::convert::Infallible;
    use std::sync::atomic::{AtomicBool, Ordering};

    const PACE: Pace = Pace {
        idle: Duration::from_secs(10),
        grace: Duration::from_secs(5),
        min_bytes_per_sec: 100,
    };

    /// `count` pieces of `bytes`, each after `every`; then nothing more, for ever.
    fn drip(
        count: usize,
        bytes: usize,
        every: Duration,
    ) -> impl Stream<Item = Result<Bytes, Infallible>> + Unpin {
        let pieces = stream::iter(0..count).then(move |_| async move {
            tokio::time::sleep(every).await;
            Ok(Bytes::from(vec![0; bytes]))
        });
        Box::pin(pieces.chain(stream::pending()))
    }

    /// Bytes taken and seconds passed until the body is given up.
    async fn given_up(
        pieces: impl Stream<Item = Result<Bytes, Infallible>> + Unpin,
        pace: impl Fn() -> Pace,
    ) -> (usize, u64) {
        let began = Instant::now();
        let mut body = PacedBody::new("post", pieces, pace);
        let mut bytes = 0;
        loop {
            match body.next().await {
                Ok(Some(piece)) => bytes += piece.len(),
                Ok(None) => panic!("a body without an end ended"),
                Err(HttpError::Slow) => return (bytes, began.elapsed().as_secs()),
                Err(error) => panic!("{error}"),
            }
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_body_that_stalls_is_given_up_once_its_bytes_are_paid_for() {
        let second = Duration::from_secs(1);
        assert_eq!(given_up(drip(0, 0, second), || PACE).await, (0, 5));
        // 2,000 bytes pay for 20 s beyond the grace, but not for a pause of more than 10 s.
        assert_eq!(given_up(drip(1, 2000, second), || PACE).await, (2000, 11));
        assert_eq!(given_up(drip(1, 200, second), || PACE).await, (200, 7));
    }

    #[tokio::test(start_paused = true)]
    async fn a_body_that_trickles_is_given_up_and_one_that_keeps_the_pace_is_not() {
        let second = Duration::from_secs(1);
        let (bytes, secs) = given_up(drip(1000, 1, second), || PACE).await;
        assert!((4..=6).contains(&bytes) && secs <= 6, "{bytes} {secs}");
        let (bytes, _) = given_up(drip(1000, 0, second), || PACE).await;
        assert_eq!(bytes, 0, "empty pieces are no progress");
        let (bytes, secs) = given_up(drip(300, 100, second), || PACE).await;
        assert_eq!((bytes, secs), (30_000, 305));
    }

    #[tokio::test(start_paused = true)]
    async fn a_stricter_pace_counts_at_once() {
        let short = AtomicBool::new(false);
        let pace = || Pace {
            idle: match short.load(Ordering::Relaxed) {
                true => Duration::from_secs(1),
                false => Duration::from_secs(600),
            },
            ..PACE
        };
        let hurry = async {
            tokio::time::sleep(Duration::from_secs(100)).await;
            short.store(true, Ordering::Relaxed);
        };
        let body = given_up(drip(1, 1_000_000, Duration::ZERO), pace);
        let ((bytes, secs), ()) = tokio::join!(body, hurry);
        assert_eq!((bytes, secs), (1_000_000, 100));
    }

    #[tokio::test(start_paused = true)]
    async fn the_time_that_the_server_takes_is_not_the_clients() {
        let pieces = drip(3, 1, Duration::from_secs(1));
        let mut body = PacedBody::new("post", pieces, || PACE);
        for _ in 0..3 {
            assert!(body.next().await.expect("in time").is_some());
            tokio::time::sleep(Duration::from_secs(600)).await;
        }
        let cut = stream::iter([Err::<Bytes, _>("reset")]);
        let error = PacedBody::new("post", cut, || PACE).next().await;
        assert!(matches!(error, Err(HttpError::BadRequest(_))));
    }
}
