//! Room for bytes and work that clients cause: a bound on all of it, and a share of each client.

use std::collections::{BTreeSet, HashMap, VecDeque};
use std::net::IpAddr;
use std::ops::Bound;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

/// Units, of whatever is bounded, that there are and that are taken.
#[derive(Debug)]
pub(super) struct Budget {
    total: usize,
    /// Most that one client takes; at most `total`.
    share: usize,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    taken: usize,
    /// Those that have taken something, or wait.
    clients: HashMap<IpAddr, Client>,
    /// Those that wait.
    waiting: BTreeSet<IpAddr>,
}

#[derive(Debug, Default)]
struct Client {
    taken: usize,
    waiting: VecDeque<(usize, oneshot::Sender<Claim>)>,
}

/// Units that one user of a client has taken, until this is dropped.
#[derive(Debug)]
pub(super) struct Claim {
    budget: Arc<Budget>,
    client: IpAddr,
    units: usize,
}

impl Budget {
    pub(super) fn new(total: usize, share: usize) -> Arc<Self> {
        Arc::new(Self {
            total,
            share: share.min(total),
            state: Mutex::default(),
        })
    }

    /// A claim on nothing yet.
    pub(super) fn claim(self: &Arc<Self>, client: IpAddr) -> Claim {
        self.granted(client, 0)
    }

    /// Whether the client has more than half of its share, or all have three quarters of
    /// everything.
    pub(super) fn is_short(&self, client: IpAddr) -> bool {
        let state = self.state();
        state.taken > self.total / 4 * 3 || state.taken_by(client) > self.share / 2
    }

    fn granted(self: &Arc<Self>, client: IpAddr, units: usize) -> Claim {
        Claim {
            budget: Arc::clone(self),
            client,
            units,
        }
    }

    fn try_take(&self, state: &mut State, client: IpAddr, units: usize) -> bool {
        let left = (self.total - state.taken).min(self.share - state.taken_by(client));
        if units > 0 && units <= left {
            state.taken += units;
            state.clients.entry(client).or_default().taken += units;
        }
        units <= left
    }

    /// Gives units back, and to those who wait; gives the claims that nobody waits for any longer.
    fn give_back(self: &Arc<Self>, client: IpAddr, units: usize) -> Vec<Claim> {
        let mut state = self.state();
        state.taken -= units;
        if let Some(of_client) = state.clients.get_mut(&client) {
            of_client.taken -= units;
        }
        state.forget(client);
        let behind = (Bound::Excluded(client), Bound::Unbounded);
        let behind = state.waiting.range(behind);
        // In a circle from the one who gave, so that none is always the last.
        let circle = behind.chain(state.waiting.range(..=client));
        let circle: Vec<_> = circle.copied().collect();
        let mut unwanted = Vec::new();
        for client in circle {
            if state.taken == self.total {
                break;
            }
            self.serve(&mut state, client, &mut unwanted);
            state.forget(client);
        }
        unwanted
    }

    /// Gives a client what it waits for, as far as there is any.
    fn serve(self: &Arc<Self>, state: &mut State, client: IpAddr, unwanted: &mut Vec<Claim>) {
        while let Some(units) = state.first_waiting(client) {
            if !self.try_take(state, client, units) {
                return;
            }
            let of_client = state.clients.get_mut(&client);
            let Some((units, sender)) = of_client.and_then(|it| it.waiting.pop_front()) else {
                return;
            };
            if let Err(claim) = sender.send(self.granted(client, units)) {
                unwanted.push(claim);
            }
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn taken_by(&self, client: IpAddr) -> usize {
        self.clients.get(&client).map_or(0, |client| client.taken)
    }

    /// The units that the first of a client's users waits for, of those that have not gone.
    fn first_waiting(&mut self, client: IpAddr) -> Option<usize> {
        let waiting = &mut self.clients.get_mut(&client)?.waiting;
        while waiting
            .front()
            .is_some_and(|(_, sender)| sender.is_closed())
        {
            waiting.pop_front();
        }
        waiting.front().map(|(units, _)| *units)
    }

    /// Leaves nothing behind of a client that has nothing and waits for nothing.
    fn forget(&mut self, client: IpAddr) {
        let Some(of_client) = self.clients.get(&client) else {
            return;
        };
        if of_client.waiting.is_empty() {
            self.waiting.remove(&client);
            if of_client.taken == 0 {
                self.clients.remove(&client);
            }
        }
    }
}

impl Claim {
    /// The units that it has taken.
    pub(super) fn units(&self) -> usize {
        self.units
    }

    /// Takes `units` more, if there are so many.
    pub(super) fn try_grow(&mut self, units: usize) -> bool {
        let mut state = self.budget.state();
        let fits = self.budget.try_take(&mut state, self.client, units);
        if fits {
            self.units += units;
        }
        fits
    }

    /// The same, and waits for them behind the client's others; for ever where the share is
    /// smaller.
    pub(super) async fn grow(&mut self, units: usize) {
        let granted = {
            let mut state = self.budget.state();
            let waits = state.first_waiting(self.client).is_some();
            if !waits && self.budget.try_take(&mut state, self.client, units) {
                self.units += units;
                return;
            }
            let (sender, granted) = oneshot::channel();
            let of_client = state.clients.entry(self.client).or_default();
            of_client.waiting.push_back((units, sender));
            state.waiting.insert(self.client);
            granted
        };
        // Never closed while somebody waits.
        if let Ok(mut claim) = granted.await {
            self.units += std::mem::take(&mut claim.units);
        }
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        let mut unwanted = match self.units {
            0 => return,
            units => self.budget.give_back(self.client, units),
        };
        // One after the other: dropped here they would go as deep as there are many.
        while let Some(mut claim) = unwanted.pop() {
            let units = std::mem::take(&mut claim.units);
            unwanted.extend(self.budget.give_back(claim.client, units));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;
    use tokio::time::timeout;

    fn client(last: u32) -> IpAddr {
        [10, 0, 0, last as u8].into()
    }

    fn is_clean(budget: &Budget) -> bool {
        let state = budget.state();
        state.taken == 0 && state.clients.is_empty() && state.waiting.is_empty()
    }

    #[test]
    fn a_client_takes_its_share_and_leaves_the_others_theirs() {
        let budget = Budget::new(10, 6);
        let (mut one, mut same) = (budget.claim(client(1)), budget.claim(client(1)));
        assert!(one.try_grow(4) && same.try_grow(2) && !same.try_grow(1));
        assert!(budget.is_short(client(1)) && !budget.is_short(client(2)));
        let mut other = budget.claim(client(2));
        assert!(!other.try_grow(5) && other.try_grow(4));
        assert!(budget.is_short(client(3)), "all is taken");
        drop(one);
        assert!(other.try_grow(2) && same.try_grow(2));
        drop((same, other));
        assert!(!budget.is_short(client(1)) && is_clean(&budget));
    }

    #[tokio::test(start_paused = true)]
    async fn units_that_are_taken_are_waited_for() {
        let budget = Budget::new(10, 10);
        let mut one = budget.claim(client(1));
        one.grow(8).await;
        let mut other = budget.claim(client(2));
        let patience = Duration::from_secs(5);
        assert!(timeout(patience, other.grow(3)).await.is_err());
        let free = async {
            tokio::time::sleep(patience / 2).await;
            drop(one);
        };
        let wait = timeout(patience, other.grow(3));
        assert!(tokio::join!(wait, free).0.is_ok());
        assert_eq!(other.units(), 3);
        drop(other);
        assert!(is_clean(&budget));
    }

    #[tokio::test(start_paused = true)]
    async fn neither_units_nor_those_who_wait_are_lost() {
        let budget = Budget::new(7, 4);
        let mut users = tokio::task::JoinSet::new();
        for number in 0..300u32 {
            let mut claim = budget.claim(client(number % 5));
            users.spawn(async move {
                let units = number as usize % 4 + 1;
                // Some go while they wait.
                let patience = match number % 3 {
                    0 => Duration::from_millis(u64::from(number % 50)),
                    _ => Duration::from_secs(600),
                };
                let is_there = timeout(patience, claim.grow(units)).await.is_ok();
                tokio::time::sleep(Duration::from_millis(3)).await;
                is_there || patience < Duration::from_secs(1)
            });
        }
        while let Some(user) = users.join_next().await {
            assert!(user.expect("no panic"), "waits for ever");
        }
        assert!(is_clean(&budget));
    }
}
