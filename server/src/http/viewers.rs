//! Which post of a viewer counts: the one with the largest sequence. Only a table of numbers, bounded; losing an entry costs
//! no more than an answer that runs on although nobody wants it any longer.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::watch;

/// Most viewers remembered.
const MAX_VIEWERS: usize = 16_384;
/// A viewer that posts nothing for so long is forgotten.
const IDLE: Duration = Duration::from_secs(300);
/// Least time between two sweeps for idle viewers.
const SWEEP_EVERY: Duration = Duration::from_secs(60);

/// Viewers and their latest sequences.
#[derive(Debug, Default)]
pub(super) struct Viewers(Mutex<Table>);

#[derive(Debug, Default)]
struct Table {
    entries: HashMap<u64, Entry>,
    swept: Option<Instant>,
}

#[derive(Debug)]
struct Entry {
    latest: watch::Sender<u64>,
    used: Instant,
}

/// One post's claim to be answered.
#[derive(Debug)]
pub(super) struct Turn {
    sequence: u64,
    latest: watch::Receiver<u64>,
}

impl Viewers {
    /// Notes a post; an earlier one of the same viewer is superseded from now on, and so is this one if a later came first.
    pub(super) fn enter(&self, viewer: u64, sequence: u64) -> Turn {
        let mut table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        table.sweep(now);
        let entry = table.entries.entry(viewer).or_insert_with(|| Entry {
            latest: watch::Sender::new(sequence),
            used: now,
        });
        entry.used = now;
        entry.latest.send_if_modified(|latest| {
            let newer = sequence > *latest;
            *latest = sequence.max(*latest);
            newer
        });
        Turn {
            sequence,
            latest: entry.latest.subscribe(),
        }
    }

    /// Viewers remembered now.
    pub(super) fn count(&self) -> usize {
        let table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        table.entries.len()
    }
}

impl Table {
    fn sweep(&mut self, now: Instant) {
        let due = self
            .swept
            .is_none_or(|swept| now.duration_since(swept) >= SWEEP_EVERY);
        if due {
            self.swept = Some(now);
            self.entries
                .retain(|_, entry| now.duration_since(entry.used) < IDLE);
        }
        if self.entries.len() >= MAX_VIEWERS {
            let mut used: Vec<_> = self.entries.values().map(|entry| entry.used).collect();
            let (_, &mut median, _) = used.select_nth_unstable(MAX_VIEWERS / 2);
            self.entries.retain(|_, entry| entry.used > median);
        }
    }
}

impl Turn {
    /// [`Turn::superseded`], with the turn.
    pub(super) async fn ended(mut self) {
        self.superseded().await;
    }

    /// Waits until a later post of the viewer comes; for ever if the viewer has been forgotten.
    pub(super) async fn superseded(&mut self) {
        let sequence = self.sequence;
        if self
            .latest
            .wait_for(|&latest| latest > sequence)
            .await
            .is_err()
        {
            std::future::pending::<()>().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::FutureExt;

    fn is_superseded(turn: &mut Turn) -> bool {
        turn.superseded().now_or_never().is_some()
    }

    #[test]
    fn only_a_larger_sequence_of_the_same_viewer_supersedes() {
        let viewers = Viewers::default();
        let mut first = viewers.enter(1, 5);
        let mut other = viewers.enter(2, 9);
        let mut again = viewers.enter(1, 5);
        assert!(!is_superseded(&mut first) && !is_superseded(&mut again));
        let mut late = viewers.enter(1, 4);
        assert!(is_superseded(&mut late) && !is_superseded(&mut first));
        let mut next = viewers.enter(1, 6);
        assert!(is_superseded(&mut first) && is_superseded(&mut again));
        assert!(!is_superseded(&mut next) && !is_superseded(&mut other));
    }

    #[test]
    fn the_table_is_bounded_and_a_forgotten_viewer_is_not_superseded() {
        let viewers = Viewers::default();
        let mut first = viewers.enter(u64::MAX, 1);
        for viewer in 0..3 * MAX_VIEWERS as u64 {
            viewers.enter(viewer, 1);
            assert!(viewers.count() <= MAX_VIEWERS);
        }
        assert!(!is_superseded(&mut first));
    }
}
