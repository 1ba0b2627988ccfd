//! Limits: requests a second and connections that one client may have. A client is an address, of IPv6 the first half.

use std::collections::HashMap;
use std::convert::Infallible;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;

/// Clients remembered before those that are idle are forgotten.
const SWEEP_CLIENTS: usize = 65_536;

/// The limits of one client.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ClientLimits {
    /// Requests a second, and as many at once; as many as it likes where there is nothing.
    pub requests_per_sec: Option<u32>,
    /// Connections at once; three quarters of what the server takes where there is nothing.
    pub connections: Option<u32>,
}

/// The address that a request came from, as far as limits tell addresses apart.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClientAddress(pub IpAddr);

impl ClientAddress {
    /// Stands for all clients that came by no socket.
    pub(super) const NONE: Self = Self(IpAddr::V4(Ipv4Addr::UNSPECIFIED));
}

impl<S: Sync> FromRequestParts<S> for ClientAddress {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(parts.extensions.get().copied().unwrap_or(Self::NONE))
    }
}

/// The clients that are limited.
#[derive(Debug, Default)]
pub(super) struct Limits {
    limits: ClientLimits,
    clients: Mutex<HashMap<IpAddr, Client>>,
}

#[derive(Debug)]
struct Client {
    connections: u32,
    /// Requests that it may make now.
    allowed: f64,
    since: Instant,
}

/// A client's connection; it counts until this is dropped.
#[derive(Debug)]
pub(super) struct Connected {
    limits: Arc<Limits>,
    address: IpAddr,
    counts: AtomicBool,
}

impl Limits {
    pub(super) fn new(limits: ClientLimits) -> Self {
        Self {
            limits,
            clients: Mutex::default(),
        }
    }

    /// Most connections of one client to a server that takes `all`. Some are
    /// left to others.
    pub(super) fn most_connections(&self, all: usize) -> u32 {
        let share = (all - all / 4).try_into().unwrap_or(u32::MAX);
        self.limits.connections.unwrap_or(share)
    }

    /// Counts a connection; `None` where the client has `most`.
    pub(super) fn connect(self: &Arc<Self>, peer: IpAddr, most: u32) -> Option<Connected> {
        let address = client_of(peer);
        let mut clients = self.clients();
        let client = self.client(&mut clients, address, Instant::now());
        if client.connections >= most {
            return None;
        }
        client.connections += 1;
        drop(clients);
        Some(Connected {
            limits: Arc::clone(self),
            address,
            counts: AtomicBool::new(true),
        })
    }

    /// Counts a request; else the whole seconds, at least one, after which there is room for the next.
    pub(super) fn request(&self, peer: IpAddr) -> Result<(), u64> {
        match self.limits.requests_per_sec {
            Some(_) => self.request_at(client_of(peer), Instant::now()),
            None => Ok(()),
        }
    }

    fn request_at(&self, address: IpAddr, now: Instant) -> Result<(), u64> {
        let rate = self.rate();
        let mut clients = self.clients();
        let client = self.client(&mut clients, address, now);
        let passed = now.saturating_duration_since(client.since).as_secs_f64();
        client.allowed = (client.allowed + passed * rate).min(rate);
        client.since = now;
        if client.allowed < 1.0 {
            let secs = (1.0 - client.allowed) / rate;
            return Err((secs.ceil() as u64).max(1));
        }
        client.allowed -= 1.0;
        Ok(())
    }

    fn rate(&self) -> f64 {
        f64::from(self.limits.requests_per_sec.unwrap_or(0).max(1))
    }

    fn clients(&self) -> MutexGuard<'_, HashMap<IpAddr, Client>> {
        self.clients.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn client<'a>(
        &self,
        clients: &'a mut HashMap<IpAddr, Client>,
        address: IpAddr,
        now: Instant,
    ) -> &'a mut Client {
        let rate = self.rate();
        if clients.len() >= SWEEP_CLIENTS && !clients.contains_key(&address) {
            // Who has no connection and may ask as much as a new one is as good as new.
            clients.retain(|_, client| {
                let passed = now.saturating_duration_since(client.since).as_secs_f64();
                client.connections > 0 || client.allowed + passed * rate < rate
            });
        }
        clients.entry(address).or_insert(Client {
            connections: 0,
            allowed: rate,
            since: now,
        })
    }
}

impl Connected {
    /// Where it comes from.
    pub(super) fn address(&self) -> ClientAddress {
        ClientAddress(self.address)
    }

    /// [`Limits::request`] of this client.
    pub(super) fn request(&self) -> Result<(), u64> {
        self.limits.request(self.address)
    }

    /// Counts no longer: it is about to end.
    pub(super) fn release(&self) {
        if self.counts.swap(false, Ordering::AcqRel)
            && let Some(client) = self.limits.clients().get_mut(&self.address)
        {
            client.connections = client.connections.saturating_sub(1);
        }
    }
}

impl Drop for Connected {
    fn drop(&mut self) {
        self.release();
    }
}

/// An IPv6 address comes with its network's other 2^64.
pub(super) fn client_of(peer: IpAddr) -> IpAddr {
    match peer {
        IpAddr::V4(_) => peer,
        IpAddr::V6(v6) => match v6.to_ipv4_mapped() {
            Some(v4) => v4.into(),
            None => std::net::Ipv6Addr::from_bits(v6.to_bits() & !u128::from(u64::MAX)).into(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn limits(requests: Option<u32>, connections: Option<u32>) -> Arc<Limits> {
        Arc::new(Limits::new(ClientLimits {
            requests_per_sec: requests,
            connections,
        }))
    }

    fn address(last: u8) -> IpAddr {
        [10, 0, 0, last].into()
    }

    #[test]
    fn requests_come_back_with_time_and_clients_do_not_share() {
        let limits = limits(Some(4), None);
        let now = Instant::now();
        let ask = |client: u8, millis: u64| {
            limits.request_at(address(client), now + Duration::from_millis(millis))
        };
        assert!((0..4).all(|_| ask(1, 0).is_ok()));
        assert_eq!((ask(1, 0), ask(2, 0)), (Err(1), Ok(())));
        assert_eq!(ask(1, 260), Ok(()));
        assert_eq!(ask(1, 260), Err(1));
        // No more than a second's worth is saved up.
        assert!((0..4).all(|_| ask(1, 60_000).is_ok()));
        assert_eq!(ask(1, 60_000), Err(1));
    }

    #[test]
    fn connections_count_while_they_last() {
        let limits = limits(None, Some(2));
        let peer = |text: &str| -> IpAddr { text.parse().expect("an address") };
        let connect = |text: &str| limits.connect(peer(text), limits.most_connections(100));
        let first = connect("2001:db8::1");
        let second = connect("2001:db8::2");
        assert!(first.is_some() && second.is_some());
        assert!(connect("2001:db8::3").is_none());
        assert!(connect("2001:db8:0:1::1").is_some());
        drop(first);
        let third = connect("2001:db8::3").expect("room");
        assert!(connect("2001:db8::4").is_none());
        third.release();
        let fourth = connect("2001:db8::4");
        drop(third);
        assert!(fourth.is_some() && connect("2001:db8::5").is_none());
        assert!(limits.request(peer("2001:db8::3")).is_ok());
    }

    #[test]
    fn one_client_leaves_a_quarter_of_the_connections_to_others() {
        let most = |limit, all| limits(None, limit).most_connections(all);
        assert_eq!((most(None, 16_384), most(None, 10)), (12_288, 8));
        assert_eq!(most(Some(3), 16_384), 3);
    }

    #[test]
    fn idle_clients_are_forgotten_before_there_are_too_many() {
        let limits = limits(Some(1), None);
        let now = Instant::now();
        for client in 0..SWEEP_CLIENTS as u32 + 10 {
            // A second later all of the first are as good as new.
            let at = now + Duration::from_millis(u64::from(client) / 32);
            let _ = limits.request_at(IpAddr::from(client.to_be_bytes()), at);
        }
        assert!(limits.clients().len() < SWEEP_CLIENTS);
    }
}
