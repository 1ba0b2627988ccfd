//! Limits: requests a second and connections that one client may have. A client is an address, of IPv6 the first half.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Clients remembered before those that are idle are forgotten.
const SWEEP_CLIENTS: usize = 65_536;

/// What one client may do; all it likes where there is nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ClientLimits {
    /// Requests a second, and as many at once.
    pub requests_per_sec: Option<u32>,
    /// Connections at once.
    pub connections: Option<u32>,
}

/// The address that a request came from, as far as limits tell addresses apart.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClientAddress(pub IpAddr);

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
}

impl Limits {
    pub(super) fn new(limits: ClientLimits) -> Self {
        Self {
            limits,
            clients: Mutex::default(),
        }
    }

    /// Counts a connection; `None` where the client has as many as it may.
    pub(super) fn connect(self: &Arc<Self>, peer: IpAddr) -> Option<Connected> {
        let address = client_of(peer);
        if let Some(most) = self.limits.connections {
            let mut clients = self.clients();
            let client = self.client(&mut clients, address, Instant::now());
            if client.connections >= most {
                return None;
            }
            client.connections += 1;
        }
        Some(Connected {
            limits: Arc::clone(self),
            address,
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
}

impl Drop for Connected {
    fn drop(&mut self) {
        if self.limits.limits.connections.is_some()
            && let Some(client) = self.limits.clients().get_mut(&self.address)
        {
            client.connections = client.connections.saturating_sub(1);
        }
    }
}

/// Whoever has an IPv6 address has its network's other 2^64 too.
fn client_of(peer: IpAddr) -> IpAddr {
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
        let first = limits.connect(peer("2001:db8::1"));
        let second = limits.connect(peer("2001:db8::2"));
        assert!(first.is_some() && second.is_some());
        assert!(limits.connect(peer("2001:db8::3")).is_none());
        assert!(limits.connect(peer("2001:db8:0:1::1")).is_some());
        drop(first);
        assert!(limits.connect(peer("2001:db8::3")).is_some());
        assert!(limits.request(peer("2001:db8::3")).is_ok());
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
