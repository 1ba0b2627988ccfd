//! Whose read of the store comes next. A store takes so many reads at once; the others wait, and of those who wait the one who has had the
//! fewest bytes goes first (start-time fair queuing: who comes anew begins where the others are, not at nothing). One viewer that
//! asks for everything so costs another one no more than half of the store.

use std::collections::{HashMap, VecDeque};
use std::convert::Infallible;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use tokio::sync::oneshot;

/// Reads of the store at once: a network store gives some 50 MB/s with so many pieces of 128 KiB at 80 ms, and is not flooded.
const MOST: usize = 32;

/// Who reads: a viewer, or a connection of one that does not say who it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Asker {
    Viewer(u64),
    Connection(u64),
}

impl<S: Sync> FromRequestParts<S> for Asker {
    type Rejection = Infallible;

    /// The connection that a request came by; all that came by none are one.
    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        let asker = parts.extensions.get().copied();
        Ok(asker.unwrap_or(Self::Connection(0)))
    }
}

/// The reads that run and those that wait.
#[derive(Debug, Default)]
pub(super) struct FairReads(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    running: usize,
    /// Bytes that the asker had had who was last let in.
    clock: u64,
    askers: HashMap<Asker, Line>,
}

/// Reads of one asker.
#[derive(Debug, Default)]
struct Line {
    had_bytes: u64,
    running: usize,
    waiting: VecDeque<(u64, oneshot::Sender<Turn>)>,
}

/// A read that runs, until this is dropped.
#[derive(Debug)]
pub(super) struct Turn {
    reads: Arc<FairReads>,
    asker: Asker,
}

impl FairReads {
    /// Waits for the turn of a read of `bytes`.
    pub(super) async fn enter(self: &Arc<Self>, asker: Asker, bytes: u64) -> Turn {
        let turn = {
            let mut state = self.state();
            if state.running < MOST {
                state.let_in(asker, bytes);
                return self.turn(asker);
            }
            let (sender, turn) = oneshot::channel();
            let line = state.line(asker);
            line.waiting.push_back((bytes, sender));
            turn
        };
        // Never closed while the read waits; a turn that is not taken goes to the next when it is dropped.
        turn.await
            .unwrap_or_else(|_| unreachable!("a line lost a read"))
    }

    /// The turn of a read that nobody waits for, if the store is half idle.
    pub(super) fn try_enter(self: &Arc<Self>, asker: Asker, bytes: u64) -> Option<Turn> {
        let mut state = self.state();
        (state.running < MOST / 2).then(|| state.let_in(asker, bytes))?;
        drop(state);
        Some(self.turn(asker))
    }

    fn turn(self: &Arc<Self>, asker: Asker) -> Turn {
        Turn {
            reads: Arc::clone(self),
            asker,
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends a read; gives the next one its turn.
    fn leave(self: &Arc<Self>, asker: Asker) {
        let mut state = self.state();
        state.running -= 1;
        if let Some(line) = state.askers.get_mut(&asker) {
            line.running -= 1;
        }
        state.forget(asker);
        let next = state.next();
        drop(state);
        if let Some((asker, sender)) = next {
            // Where nobody waits any longer the turn comes back, is dropped, and so given to the next.
            let _ = sender.send(self.turn(asker));
        }
    }
}

impl State {
    fn line(&mut self, asker: Asker) -> &mut Line {
        let had_bytes = self.clock;
        self.askers.entry(asker).or_insert_with(|| Line {
            had_bytes,
            ..Line::default()
        })
    }

    fn let_in(&mut self, asker: Asker, bytes: u64) {
        self.running += 1;
        let line = self.line(asker);
        line.running += 1;
        line.had_bytes += bytes;
    }

    /// Lets the next read in for which somebody waits.
    fn next(&mut self) -> Option<(Asker, oneshot::Sender<Turn>)> {
        loop {
            let waiting = self
                .askers
                .iter()
                .filter(|(_, line)| !line.waiting.is_empty());
            let (&asker, _) = waiting.min_by_key(|(_, line)| line.had_bytes)?;
            let line = self.line(asker);
            let had_bytes = line.had_bytes;
            let (bytes, sender) = line.waiting.pop_front()?;
            if sender.is_closed() {
                self.forget(asker);
                continue;
            }
            self.clock = had_bytes;
            self.let_in(asker, bytes);
            return Some((asker, sender));
        }
    }

    fn forget(&mut self, asker: Asker) {
        let idle = |line: &Line| line.running == 0 && line.waiting.is_empty();
        if self.askers.get(&asker).is_some_and(idle) {
            self.askers.remove(&asker);
        }
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        self.reads.leave(self.asker);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::FutureExt;
    use futures_util::future::BoxFuture;
    use proptest::prelude::*;

    const BYTES: u64 = 100;

    fn wait(reads: &Arc<FairReads>, asker: u64) -> BoxFuture<'static, Turn> {
        let reads = Arc::clone(reads);
        async move { reads.enter(Asker::Viewer(asker), BYTES).await }.boxed()
    }

    /// Polls all; takes out those whose turn has come.
    fn let_in(waiting: &mut Vec<(u64, BoxFuture<'static, Turn>)>, running: &mut Vec<(u64, Turn)>) {
        for (asker, mut future) in std::mem::take(waiting) {
            match (&mut future).now_or_never() {
                Some(turn) => running.push((asker, turn)),
                None => waiting.push((asker, future)),
            }
        }
    }

    #[test]
    fn who_asks_for_little_does_not_wait_for_who_asks_for_all() {
        let reads = Arc::new(FairReads::default());
        let (mut waiting, mut running) = (vec![], vec![]);
        waiting.extend((0..1000).map(|_| (1, wait(&reads, 1))));
        let_in(&mut waiting, &mut running);
        assert_eq!((running.len(), waiting.len()), (MOST, 1000 - MOST));
        waiting.extend((0..4).map(|_| (2, wait(&reads, 2))));
        let_in(&mut waiting, &mut running);
        // Each read that ends lets one in: the small viewer's four are in within the next five.
        for _ in 0..5 {
            running.remove(0);
            let_in(&mut waiting, &mut running);
        }
        assert_eq!(running.iter().filter(|(asker, _)| *asker == 2).count(), 4);
    }

    #[test]
    fn what_nobody_waits_for_takes_only_half() {
        let reads = Arc::new(FairReads::default());
        let turns: Vec<_> = (0..MOST)
            .map_while(|_| reads.try_enter(Asker::Connection(0), BYTES))
            .collect();
        assert_eq!(turns.len(), MOST / 2);
        drop(turns);
        assert!(reads.state().askers.is_empty());
    }

    proptest! {
        /// Reads come, end and are given up in any order: never more than MOST run, none is lost, and while all have reads waiting no one
        /// gets more than a read's bytes ahead of another beyond what ran when they came.
        #[test]
        fn turns_are_neither_lost_nor_made(steps in prop::collection::vec((0u64..4, 0u8..4), 1..400)) {
            let reads = Arc::new(FairReads::default());
            let (mut waiting, mut running) = (vec![], vec![]);
            for (asker, what) in steps {
                match what {
                    0 | 1 => waiting.extend((0..8).map(|_| (asker, wait(&reads, asker)))),
                    2 if !running.is_empty() => drop(running.remove(asker as usize % running.len())),
                    3 if !waiting.is_empty() => drop(waiting.remove(asker as usize % waiting.len())),
                    _ => {}
                }
                let_in(&mut waiting, &mut running);
                // A turn given to a read that was given up is passed on once that is noticed.
                let_in(&mut waiting, &mut running);
                prop_assert!(running.len() <= MOST);
                prop_assert!(waiting.is_empty() || running.len() == MOST);
                prop_assert_eq!(reads.state().running, running.len());
            }
            drop(waiting);
            drop(running);
            let state = reads.state();
            prop_assert_eq!((state.running, state.askers.len()), (0, 0));
        }
    }
}
