//! The connections of a server. There are so many and no more; where there is no room for another,
//! the one goes that was of no use for the longest time, so that those who come do not wait behind
//! those who only stay.

use std::cmp::Reverse;
use std::collections::HashMap;
use std::future::Future;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::Instant;

use super::activity::Activity;
use super::limits::Connected;

/// Of so many connections one is kept free; as many end at once.
const FREE_SHARE: usize = 64;
/// A client that takes nothing of an answer for so long may go before those that come.
const STALLED: Duration = Duration::from_secs(2);
/// Time between two looks for one that may go, while there are none.
const LOOK_AGAIN: Duration = Duration::from_millis(100);

/// All of them.
#[derive(Debug)]
pub(super) struct Connections {
    permits: Arc<Semaphore>,
    most: usize,
    /// Those that are told to end and have not.
    ending: AtomicUsize,
    open: Mutex<HashMap<u64, Open>>,
}

#[derive(Debug)]
struct Open {
    activity: Arc<Activity>,
    client: Arc<Connected>,
}

/// One of them, until this is dropped.
#[derive(Debug)]
pub(super) struct Entered {
    connections: Arc<Connections>,
    number: u64,
    activity: Arc<Activity>,
    client: Arc<Connected>,
    _permit: OwnedSemaphorePermit,
}

impl Connections {
    /// At most `most`.
    pub(super) fn new(most: usize) -> Self {
        Self {
            permits: Arc::new(Semaphore::new(most)),
            most,
            ending: AtomicUsize::new(0),
            open: Mutex::default(),
        }
    }

    /// Most at once.
    pub(super) fn most(&self) -> usize {
        self.most
    }

    /// Tells some to end: the system has no descriptors left, whatever was reckoned with.
    pub(super) fn end_some(&self) {
        self.end_useless(None, (self.most / FREE_SHARE).max(1));
    }

    /// Waits until there is room for another, and makes some.
    pub(super) async fn room(&self) -> OwnedSemaphorePermit {
        loop {
            self.keep_free();
            let permit = Arc::clone(&self.permits).acquire_owned();
            if let Ok(Ok(permit)) = tokio::time::timeout(LOOK_AGAIN, permit).await {
                return permit;
            }
        }
    }

    /// Tells as many to end as are wanted beyond those that are free or on their way out.
    pub(super) fn keep_free(&self) {
        let share = (self.most / FREE_SHARE).max(1);
        let free = self.permits.available_permits() + self.ending.load(Ordering::Relaxed);
        if free < share {
            self.end_useless(None, 2 * share - free);
        }
    }

    /// Makes room for another connection of a client that has all it may have; whether there is
    /// some.
    pub(super) fn make_room_of(&self, client: std::net::IpAddr, most: u32) -> bool {
        let share = (most as usize / FREE_SHARE).max(1);
        self.end_useless(Some(client), share) > 0
    }

    /// Tells those to end that were of no use for the longest time, `count` at most, of one client
    /// where it is given; gives how many.
    fn end_useless(&self, client: Option<std::net::IpAddr>, count: usize) -> usize {
        let open = self.open();
        let now = Instant::now();
        let useless = open.iter().filter_map(|(&number, open)| {
            let is_asked = client.is_none_or(|client| open.client.address().0 == client);
            if !is_asked || open.activity.is_told() {
                return None;
            }
            let idle = open.activity.idle_since();
            let stalled = open.activity.stalled_since();
            let stalled = stalled.filter(|&since| now.saturating_duration_since(since) >= STALLED);
            // Idle ones first, then by time; the number makes it an order.
            let since = idle.or(stalled)?;
            Some((Reverse(idle.is_some()), since, number))
        });
        let mut useless: Vec<_> = useless.collect();
        if useless.len() > count {
            useless.select_nth_unstable(count);
            useless.truncate(count);
        }
        for (_, _, number) in &useless {
            let Some(open) = open.get(number) else {
                continue;
            };
            if open.activity.end() {
                self.ending.fetch_add(1, Ordering::Relaxed);
                open.client.release();
            }
        }
        useless.len()
    }

    /// Counts a connection of `client`.
    pub(super) fn enter(
        self: &Arc<Self>,
        permit: OwnedSemaphorePermit,
        number: u64,
        client: Arc<Connected>,
    ) -> Entered {
        let activity = Arc::<Activity>::default();
        let entered = Entered {
            connections: Arc::clone(self),
            number,
            activity: Arc::clone(&activity),
            client: Arc::clone(&client),
            _permit: permit,
        };
        self.open().insert(number, Open { activity, client });
        entered
    }

    /// Ends when there is none.
    pub(super) fn gone(&self) -> impl Future<Output = ()> {
        let all = Arc::clone(&self.permits).acquire_many_owned(self.most as u32);
        // Never closed.
        async move { drop(all.await) }
    }

    fn open(&self) -> MutexGuard<'_, HashMap<u64, Open>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Entered {
    /// Which it is, of all that there were.
    pub(super) fn number(&self) -> u64 {
        self.number
    }

    /// When it was of use.
    pub(super) fn activity(&self) -> &Arc<Activity> {
        &self.activity
    }

    /// Whose it is.
    pub(super) fn client(&self) -> &Arc<Connected> {
        &self.client
    }
}

impl Drop for Entered {
    fn drop(&mut self) {
        let mut open = self.connections.open();
        open.remove(&self.number);
        // Under the lock, so that nobody tells it to end between the look and the removal.
        if self.activity.is_told() {
            self.connections.ending.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::limits::{ClientLimits, Limits};
    use std::net::IpAddr;

    struct Rig {
        connections: Arc<Connections>,
        limits: Arc<Limits>,
        numbers: u64,
    }

    impl Rig {
        fn new(most: usize) -> Self {
            Self {
                connections: Arc::new(Connections::new(most)),
                limits: Arc::new(Limits::new(ClientLimits::default())),
                numbers: 0,
            }
        }

        async fn enter(&mut self, client: u8) -> Entered {
            let permit = self.connections.room().await;
            let client = IpAddr::from([10, 0, 0, client]);
            let client = self.limits.connect(client, u32::MAX).expect("room");
            self.numbers += 1;
            self.connections
                .enter(permit, self.numbers, Arc::new(client))
        }
    }

    fn told(entered: &[Entered]) -> Vec<bool> {
        let told = entered.iter().map(|entered| entered.activity.is_told());
        told.collect()
    }

    const SECOND: Duration = Duration::from_secs(1);

    #[tokio::test(start_paused = true)]
    async fn the_longest_idle_goes_first_and_none_that_is_in_use() {
        let mut rig = Rig::new(4);
        let mut entered = vec![];
        for _ in 0..4 {
            entered.push(rig.enter(1).await);
            tokio::time::sleep(SECOND).await;
        }
        // One of four is kept free, and as many again end at once.
        assert_eq!(told(&entered), [false; 4]);
        let in_use = entered[0].activity.begin();
        rig.connections.keep_free();
        assert_eq!(told(&entered), [false, true, true, false]);
        rig.connections.keep_free();
        assert_eq!(
            told(&entered),
            [false, true, true, false],
            "two end already"
        );
        entered.drain(1..3);
        assert_eq!(rig.connections.ending.load(Ordering::Relaxed), 0);
        entered.push(rig.enter(1).await);
        entered.push(rig.enter(1).await);
        rig.connections.keep_free();
        assert_eq!(told(&entered), [false, true, true, false]);
        drop(in_use);
    }

    #[tokio::test(start_paused = true)]
    async fn where_all_are_in_use_those_go_that_take_nothing() {
        let mut rig = Rig::new(2);
        let entered = [rig.enter(1).await, rig.enter(2).await];
        let _in_use = [entered[0].activity.begin(), entered[1].activity.begin()];
        entered[1].activity.set_stalled(Some(Instant::now()));
        rig.connections.keep_free();
        assert_eq!(told(&entered), [false; 2], "not for long yet");
        let waits = tokio::time::timeout(STALLED + SECOND, rig.connections.room());
        assert!(waits.await.is_err());
        assert_eq!(told(&entered), [false, true]);
        let [first, second] = entered;
        drop(second);
        let _third = rig.enter(3).await;
        drop(first);
    }

    #[tokio::test(start_paused = true)]
    async fn room_of_a_client_is_made_of_its_own_connections() {
        let mut rig = Rig::new(100);
        let entered = [rig.enter(1).await, rig.enter(2).await, rig.enter(2).await];
        let second = IpAddr::from([10, 0, 0, 2]);
        assert!(rig.limits.connect(second, 2).is_none());
        assert!(rig.connections.make_room_of(second, 2));
        assert_eq!(told(&entered), [false, true, false]);
        assert!(rig.limits.connect(second, 2).is_some(), "one was let go of");
        let _in_use = entered[2].activity.begin();
        assert!(!rig.connections.make_room_of(second, 2));
        drop(entered);
        tokio::time::timeout(SECOND, rig.connections.gone())
            .await
            .expect("all are gone");
    }
}
