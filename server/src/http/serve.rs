//! Sockets and shutdown: HTTP/1.1 and HTTP/2 on one port, in cleartext (HTTP/2 with prior knowledge) or over TLS.
//!
//! `axum::serve` leaves Nagle's algorithm on (40 ms stalls) and hyper's header timeout without a timer (connections that are
//! silent stay for ever), hence this loop.

use std::future::{Future, poll_fn};
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::task::Poll;
use std::time::Duration;

use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::Semaphore;

use super::AppState;
use super::front::Front;
use super::gather::Gather;
use super::http1;
use super::socket::{OverTcp, PREFACE_BYTES, Socket};
use super::tls::Tls;
use super::workers::Workers;

/// Longest wait for a request's head, also between two requests of one connection.
const HEAD_TIMEOUT: Duration = Duration::from_secs(30);
/// A socket that has so much that is not on its way takes no more; what it takes then may be a segment, 64 KiB, more than that.
const UNSENT_BYTES: u32 = 64 * 1024;
/// The same for HTTP/2, where something more urgent may come.
const HTTP2_UNSENT_BYTES: u32 = 16 * 1024;
/// Time between two pings of a silent HTTP/2 connection, and for their answer.
const PING: Duration = Duration::from_secs(20);
/// Longest wait for requests in flight after a signal.
const DRAIN: Duration = Duration::from_secs(10);
/// Connections that wait to be accepted; the system may allow fewer.
const QUEUE: u32 = 4096;
/// Most connections at once; later ones wait in the listener's queue.
const MAX_CONNECTIONS: usize = 16_384;

/// A bound listener.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    tls: Option<Tls>,
    workers: Option<Workers>,
}

impl Server {
    /// Binds `listen`, `host:port`; port 0 takes any free one.
    pub async fn bind(listen: &str) -> io::Result<Self> {
        let listener = bind(listen).await?;
        let address = listener.local_addr()?;
        Ok(Self {
            listener,
            address,
            tls: None,
            workers: None,
        })
    }

    /// Serves connections on `threads` of its own, and not on the runtime that it runs on.
    pub fn with_threads(self, threads: usize) -> io::Result<Self> {
        Ok(Self {
            workers: Some(Workers::start(threads)?),
            ..self
        })
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
        let service = Front::new(state.clone());
        let connections = Arc::new(Semaphore::new(MAX_CONNECTIONS));
        let graceful = GracefulShutdown::new();
        let builder = builder();
        let reload = self.tls.clone().map(|tls| tokio::spawn(tls.reload()));
        let pages = state.0.pages.clone();
        let close = tokio::spawn(async move { pages.close_unused().await });
        let mut shutdown = std::pin::pin!(shutdown);
        loop {
            let accepted = async {
                // Never closed, so the permit always comes.
                let permit = Arc::clone(&connections).acquire_owned().await;
                (self.listener.accept().await, permit)
            };
            let (stream, peer, permit) = tokio::select! {
                () = &mut shutdown => break,
                accepted = accepted => match accepted {
                    (Ok((stream, peer)), permit) => (stream, peer, permit),
                    (Err(error), _) => {
                        pause_after(error).await;
                        continue;
                    }
                },
            };
            if prepare(&stream).is_err() {
                // The peer is gone already.
                continue;
            }
            let Some(client) = state.0.limits.connect(peer.ip()) else {
                tracing::debug!("{peer}: closed, since it has as many connections as it may");
                continue;
            };
            let (builder, service) = (builder.clone(), service.of(client));
            let (watcher, tls) = (graceful.watcher(), self.tls.clone());
            let Ok(stream) = stream.into_std() else {
                continue;
            };
            let served = async move {
                let Ok(stream) = TcpStream::from_std(stream) else {
                    return;
                };
                match tls {
                    None => connection(stream, &builder, service, watcher).await,
                    Some(tls) => {
                        if let Some(stream) = Box::pin(tls.accept(stream)).await {
                            Box::pin(connection(stream, &builder, service, watcher)).await;
                        }
                    }
                }
                drop(permit);
            };
            match &mut self.workers {
                Some(workers) => workers.give(|| drop(tokio::spawn(served))),
                None => drop(tokio::spawn(served)),
            }
        }
        if let Some(reload) = reload {
            reload.abort();
        }
        close.abort();
        state.drain();
        drop(self.listener);
        if tokio::time::timeout(DRAIN, graceful.shutdown())
            .await
            .is_err()
        {
            tracing::warn!("connections cut after {} s", DRAIN.as_secs());
        }
    }
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

fn builder() -> Builder<TokioExecutor> {
    let mut builder = Builder::new(TokioExecutor::new());
    builder
        .http1()
        .timer(TokioTimer::new())
        .half_close(true)
        .header_read_timeout(HEAD_TIMEOUT);
    builder
        .http2()
        .timer(TokioTimer::new())
        .keep_alive_interval(PING)
        .keep_alive_timeout(PING)
        .max_concurrent_streams(200);
    builder
}

/// Serves one connection until it ends: pages by [`http1`], all else by hyper.
async fn connection<S>(
    stream: S,
    builder: &Builder<TokioExecutor>,
    service: Front,
    watcher: Watcher,
) where
    S: OverTcp + AsyncRead + AsyncWrite + Send + Unpin + 'static,
{
    let memory = Arc::clone(service.state().0.pages.memory());
    let mut socket = Socket::new(stream, Arc::clone(&memory));
    let done = match http1::serve(&mut socket, &service, HEAD_TIMEOUT).await {
        Ok(None) => Ok(()),
        Ok(Some(read)) => {
            let is_http2 = read.starts_with(b"PRI");
            if is_http2 && let Err(error) = take_no_more(socket.stream().tcp(), HTTP2_UNSENT_BYTES)
            {
                tracing::debug!("connection: {error}");
                return;
            }
            socket.unread(read);
            socket.read_within(HEAD_TIMEOUT, PREFACE_BYTES);
            let sending = Arc::clone(service.sending());
            let gathered = is_http2.then(|| Arc::clone(&sending));
            let gather = Gather::new(socket, Arc::clone(&memory), gathered);
            let connection = builder.serve_connection(TokioIo::new(gather.clone()), service);
            // Boxed: many connections never get here, and this is most of their size.
            let mut served = Box::pin(watcher.watch(connection.into_owned()));
            let served = poll_fn(|context| {
                let served = served.as_mut().poll(context);
                match gather.poll_send(context) {
                    Ok(()) => served,
                    Err(error) => Poll::Ready(Err(error.into())),
                }
            });
            tokio::select! {
                served = served => served,
                () = sending.stalled(&memory) => Err("nothing of the answers was taken".into()),
            }
        }
        Err(error) => Err(error.into()),
    };
    if let Err(error) = done {
        tracing::debug!("connection: {error}");
    }
}

/// Sends at once, and lets what is written last go out soon: the system takes no more than it is about to send.
fn prepare(stream: &TcpStream) -> io::Result<()> {
    stream.set_nodelay(true)?;
    take_no_more(stream, UNSENT_BYTES)
}

#[cfg(target_os = "linux")]
fn take_no_more(stream: &TcpStream, unsent_bytes: u32) -> io::Result<()> {
    socket2::SockRef::from(stream).set_tcp_notsent_lowat(unsent_bytes)
}

#[cfg(not(target_os = "linux"))]
fn take_no_more(_: &TcpStream, _: u32) -> io::Result<()> {
    Ok(())
}

/// A connection that went before it was accepted is nothing; anything else (no descriptors left) passes with time.
async fn pause_after(error: io::Error) {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    if !matches!(
        error.kind(),
        ConnectionAborted | ConnectionRefused | ConnectionReset
    ) {
        tracing::error!("accept: {error}");
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
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
