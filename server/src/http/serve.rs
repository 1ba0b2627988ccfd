//! Sockets and shutdown: HTTP/1.1 and HTTP/2 on one port, in cleartext (HTTP/2 with prior knowledge) or over TLS.
//!
//! `axum::serve` leaves Nagle's algorithm on (40 ms stalls) and hyper's header timeout without a timer (connections that are
//! silent stay for ever), hence this loop.

use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::net::{TcpListener, TcpSocket, TcpStream};

use super::connection::{Served, Spoken};
use super::connections::Connections;
use super::cors::Cors;
use super::front::Front;
use super::limits;
use super::tls::Tls;
use super::workers::Workers;
use super::{AppState, Serves, descriptors, error_log};

/// A socket that has so much that is not on its way takes no more; what it takes then may be a segment, 64 KiB, more than that.
const UNSENT_BYTES: u32 = 64 * 1024;
/// Longest wait for requests in flight after a signal.
const DRAIN: Duration = Duration::from_secs(10);
/// Connections that wait to be accepted; the system may allow fewer.
const QUEUE: u32 = 4096;
/// Connections that only ask for metrics; they come out of the descriptors that are kept back.
const METRICS_CONNECTIONS: usize = 16;
/// Pause where the system gives no connection: it has no descriptors or no memory left.
const PAUSE: Duration = Duration::from_millis(200);

/// A bound listener.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    tls: Option<Tls>,
    workers: Option<Workers>,
    most_connections: usize,
    cors: Cors,
    serves: Serves,
}

impl Server {
    /// Binds `listen`, `host:port`; port 0 takes any free one.
    ///
    /// # Errors
    /// Where the system does not give the address, or too few descriptors to serve anything.
    pub async fn bind(listen: &str) -> io::Result<Self> {
        let listener = bind(listen).await?;
        let address = listener.local_addr()?;
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Ok(Self {
            listener,
            address,
            tls: None,
            workers: None,
            most_connections: descriptors::connections(threads)?,
            cors: Cors::default(),
            serves: Serves::default(),
        })
    }

    /// Serves connections on `threads` of its own, and not on the runtime that it runs on.
    pub fn with_threads(self, threads: usize) -> io::Result<Self> {
        Ok(Self {
            most_connections: descriptors::connections(threads)?,
            workers: Some(Workers::start(threads)?),
            ..self
        })
    }

    /// Lets browsers show answers to pages of these origins alone.
    pub fn with_cors(self, cors: Cors) -> Self {
        Self { cors, ..self }
    }

    /// Has only some of the routes; of metrics alone few connections are enough.
    pub fn with_routes(self, serves: Serves) -> Self {
        let most_connections = match serves {
            Serves::Metrics => self.most_connections.min(METRICS_CONNECTIONS),
            Serves::All | Serves::Library => self.most_connections,
        };
        Self {
            serves,
            most_connections,
            ..self
        }
    }

    /// Speaks TLS, and nothing else.
    pub fn with_tls(self, tls: Tls) -> Self {
        Self {
            tls: Some(tls),
            ..self
        }
    }

    /// The address that was bound.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until `shutdown` ends, then lets requests in flight finish, for up to ten seconds.
    pub async fn run(mut self, state: AppState, shutdown: impl Future<Output = ()>) {
        let front = Front::new(state.clone(), self.serves, Arc::new(self.cors));
        let connections = Arc::new(Connections::new(self.most_connections));
        let most = state.0.limits.most_connections(connections.most());
        let served = Served::default();
        let pages = state.0.pages.clone();
        let close = tokio::spawn(async move { pages.close_unused().await });
        let mut shutdown = pin!(shutdown);
        loop {
            let accepted = async {
                let permit = connections.room().await;
                (self.listener.accept().await, permit)
            };
            let (stream, peer, permit) = tokio::select! {
                () = &mut shutdown => break,
                accepted = accepted => match accepted {
                    (Ok((stream, peer)), permit) => (stream, peer, permit),
                    (Err(error), permit) => {
                        drop(permit);
                        if !is_peers(&error) {
                            error_log::error("accept", &error);
                            connections.end_some();
                            tokio::time::sleep(PAUSE).await;
                        }
                        continue;
                    }
                },
            };
            if prepare(&stream).is_err() {
                // The peer is gone already.
                continue;
            }
            let connect = || state.0.limits.connect(peer.ip(), most);
            let client = connect().or_else(|| {
                let client = limits::client_of(peer.ip());
                connections.make_room_of(client, most).then(connect)?
            });
            let Some(client) = client else {
                tracing::debug!("{peer}: closed, since it has as many connections as it may");
                continue;
            };
            let entered = connections.enter(permit, next_number(), Arc::new(client));
            let front = front.of(&entered);
            let (served, tls) = (served.clone(), self.tls.clone());
            let Ok(stream) = stream.into_std() else {
                continue;
            };
            let serve = async move {
                let Ok(stream) = TcpStream::from_std(stream) else {
                    return;
                };
                match tls {
                    None => served.serve(stream, front, Spoken::Any).await,
                    Some(tls) => {
                        let mut accept = Box::pin(tls.accept(stream));
                        let accepted = entered.activity().unless_told(accept.as_mut()).await;
                        drop(accept);
                        if let Some((stream, spoken)) = accepted.flatten() {
                            Box::pin(served.serve(stream, front, spoken)).await;
                        }
                    }
                }
                drop(entered);
            };
            match &mut self.workers {
                Some(workers) => workers.give(|| drop(tokio::spawn(serve))),
                None => drop(tokio::spawn(serve)),
            }
        }
        close.abort();
        state.drain();
        drop(self.listener);
        if tokio::time::timeout(DRAIN, connections.gone())
            .await
            .is_err()
        {
            tracing::warn!("connections cut after {} s", DRAIN.as_secs());
        }
    }
}

/// Which connection of this process it is.
fn next_number() -> u64 {
    static CONNECTIONS: AtomicU64 = AtomicU64::new(1);
    CONNECTIONS.fetch_add(1, Ordering::Relaxed)
}

/// As `TcpListener::bind`, with a longer queue: a thousand viewers may come at once.
async fn bind(listen: &str) -> io::Result<TcpListener> {
    let mut last = io::Error::new(io::ErrorKind::InvalidInput, "no address");
    for address in tokio::net::lookup_host(listen).await? {
        let socket = match address {
            SocketAddr::V4(_) => TcpSocket::new_v4(),
            SocketAddr::V6(_) => TcpSocket::new_v6(),
        };
        let bound = socket.and_then(|socket| {
            socket.set_reuseaddr(true)?;
            socket.bind(address)?;
            socket.listen(QUEUE)
        });
        match bound {
            Ok(listener) => return Ok(listener),
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// Sends at once, and lets what is written last go out soon: the system takes no more than it is about to send.
fn prepare(stream: &TcpStream) -> io::Result<()> {
    stream.set_nodelay(true)?;
    take_no_more(stream, UNSENT_BYTES)
}

#[cfg(target_os = "linux")]
pub(super) fn take_no_more(stream: &TcpStream, unsent_bytes: u32) -> io::Result<()> {
    socket2::SockRef::from(stream).set_tcp_notsent_lowat(unsent_bytes)
}

#[cfg(not(target_os = "linux"))]
pub(super) fn take_no_more(_: &TcpStream, _: u32) -> io::Result<()> {
    Ok(())
}

/// Whether a connection went before it was accepted, which is nothing; anything else (no
/// descriptors left) passes with time.
fn is_peers(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(
        error.kind(),
        ConnectionAborted | ConnectionRefused | ConnectionReset
    )
}

/// SIGTERM and SIGINT; taken from the moment this is made, so that none between "listening" and the first wait is lost.
#[derive(Debug)]
pub struct StopSignal {
    #[cfg(unix)]
    signals: [tokio::signal::unix::Signal; 2],
}

impl StopSignal {
    /// Takes the signals; needs a runtime.
    pub fn install() -> io::Result<Self> {
        #[cfg(unix)]
        {
            use tokio::signal::unix::{SignalKind, signal};
            Ok(Self {
                signals: [
                    signal(SignalKind::terminate())?,
                    signal(SignalKind::interrupt())?,
                ],
            })
        }
        #[cfg(not(unix))]
        Ok(Self {})
    }

    /// Ends when the process is told to stop.
    pub async fn wait(mut self) {
        #[cfg(unix)]
        {
            let [terminate, interrupt] = &mut self.signals;
            tokio::select! {
                _ = terminate.recv() => {}
                _ = interrupt.recv() => {}
            }
        }
        #[cfg(not(unix))]
        if tokio::signal::ctrl_c().await.is_err() {
            // Without the signal the process can still be killed.
            std::future::pending::<()>().await;
        }
    }
}
