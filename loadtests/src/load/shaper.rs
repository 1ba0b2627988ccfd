//! A link of a bandwidth and a latency: a TCP proxy on loopback, one a viewer. What comes from the server goes through a
//! token bucket that all connections of the viewer share, and arrives a latency later; what goes to the server passes at
//! once, so the latency is that of a round trip.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use bytes::{Bytes, BytesMut};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::task::{AbortHandle, JoinSet};

use crate::policies::LinkSpeed;

/// Bytes that cross the link as one.
const CHUNK_BYTES: usize = 16 * 1024;
/// Timers are not finer than this; less is waited for with the next chunk.
const FINEST_SLEEP: Duration = Duration::from_millis(1);

/// Why there is no link.
#[derive(Debug, thiserror::Error)]
pub enum ShaperError {
    /// A library folder, or a URL whose bytes a proxy cannot pass on.
    #[error("{0}: expected an http:// URL for a link of a given bandwidth or latency")]
    Url(String),
    /// No socket.
    #[error("link to {url}: {source}")]
    Socket {
        /// The server.
        url: String,
        /// What the system said.
        source: std::io::Error,
    },
}

/// A running link; dropping it cuts all its connections.
#[derive(Debug)]
pub(super) struct Shaper {
    address: SocketAddr,
    task: AbortHandle,
}

/// When the link is free again.
#[derive(Debug)]
struct Bucket {
    bytes_a_sec: f64,
    latency: Duration,
    free: Mutex<Instant>,
}

impl Shaper {
    /// Opens a link to the server of `url`.
    pub(super) async fn start(url: &str, speed: LinkSpeed) -> Result<Self, ShaperError> {
        let server = server_of(url).ok_or_else(|| ShaperError::Url(url.to_owned()))?;
        let socket = |source| ShaperError::Socket {
            url: url.to_owned(),
            source,
        };
        let listener = TcpListener::bind(("127.0.0.1", 0)).await.map_err(socket)?;
        let address = listener.local_addr().map_err(socket)?;
        let bucket = Arc::new(Bucket {
            bytes_a_sec: speed.bandwidth_mbps * 1e6 / 8.0,
            latency: Duration::from_secs_f64(speed.latency_ms / 1e3),
            free: Mutex::new(Instant::now()),
        });
        let task = tokio::spawn(accept(listener, server, bucket)).abort_handle();
        Ok(Self { address, task })
    }

    /// What the viewer connects to.
    pub(super) fn url(&self) -> String {
        format!("http://{}", self.address)
    }
}

impl Drop for Shaper {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// `host:port` of a plain-text URL.
fn server_of(url: &str) -> Option<String> {
    let url = reqwest::Url::parse(url)
        .ok()
        .filter(|url| url.scheme() == "http")?;
    Some(format!(
        "{}:{}",
        url.host_str()?,
        url.port_or_known_default()?
    ))
}

async fn accept(listener: TcpListener, server: String, bucket: Arc<Bucket>) {
    // Dropped with this task, and then every connection is.
    let mut connections = JoinSet::new();
    while let Ok((viewer, _)) = listener.accept().await {
        let (server, bucket) = (server.clone(), bucket.clone());
        connections.spawn(async move {
            if let Err(error) = connect(viewer, &server, bucket).await {
                tracing::debug!("link to {server}: {error}");
            }
        });
    }
}

async fn connect(viewer: TcpStream, server: &str, bucket: Arc<Bucket>) -> std::io::Result<()> {
    let server = TcpStream::connect(server).await?;
    viewer.set_nodelay(true)?;
    server.set_nodelay(true)?;
    let ((mut from_viewer, to_viewer), (from_server, mut to_server)) =
        (viewer.into_split(), server.into_split());
    let (sender, receiver) = unbounded_channel();
    let up = async {
        tokio::io::copy(&mut from_viewer, &mut to_server).await?;
        to_server.shutdown().await
    };
    let results = tokio::join!(
        up,
        pace(from_server, sender, &bucket),
        deliver(receiver, to_viewer)
    );
    results.0.and(results.1).and(results.2)
}

/// Reads no faster than the link carries, so what is under way is bounded by bandwidth times latency.
async fn pace(
    mut from: OwnedReadHalf,
    sender: UnboundedSender<(Instant, Bytes)>,
    bucket: &Bucket,
) -> std::io::Result<()> {
    loop {
        let mut chunk = BytesMut::with_capacity(CHUNK_BYTES);
        if from.read_buf(&mut chunk).await? == 0 {
            return Ok(());
        }
        let carried = bucket.take(chunk.len());
        if carried > Instant::now() + FINEST_SLEEP {
            tokio::time::sleep_until(carried.into()).await;
        }
        if sender
            .send((carried + bucket.latency, chunk.freeze()))
            .is_err()
        {
            return Ok(());
        }
    }
}

async fn deliver(
    mut receiver: UnboundedReceiver<(Instant, Bytes)>,
    mut to: OwnedWriteHalf,
) -> std::io::Result<()> {
    while let Some((at, chunk)) = receiver.recv().await {
        tokio::time::sleep_until(at.into()).await;
        to.write_all(&chunk).await?;
    }
    to.shutdown().await
}

impl Bucket {
    /// When the last of `bytes` has crossed the link.
    fn take(&self, bytes: usize) -> Instant {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        let crossing = Duration::from_secs_f64(bytes as f64 / self.bytes_a_sec);
        *free = (*free).max(Instant::now()) + crossing;
        *free
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A test's way to fail.
    use super::*;

    #[test]
    fn only_plain_text_urls_have_a_server_to_link_to() {
        assert_eq!(
            server_of("http://127.0.0.1:7878/x"),
            Some("127.0.0.1:7878".into())
        );
        assert_eq!(
            server_of("http://example.org"),
            Some("example.org:80".into())
        );
        assert_eq!(server_of("https://example.org"), None);
        assert_eq!(server_of("library"), None);
    }

    #[tokio::test]
    async fn a_link_takes_its_latency_and_its_bandwidth() {
        const ANSWER_BYTES: usize = 100_000;
        let server = TcpListener::bind(("127.0.0.1", 0)).await.unwrap();
        let url = format!("http://{}", server.local_addr().unwrap());
        tokio::spawn(async move {
            let (mut stream, _) = server.accept().await.unwrap();
            stream.read_u8().await.unwrap();
            stream.write_all(&vec![7; ANSWER_BYTES]).await.unwrap();
        });
        // A megabyte a second: 100 ms for the answer, after 150 ms.
        let shaper = Shaper::start(
            &url,
            LinkSpeed {
                bandwidth_mbps: 8.0,
                latency_ms: 150.0,
            },
        )
        .await
        .unwrap();
        let mut viewer = TcpStream::connect(shaper.address).await.unwrap();
        let asked = Instant::now();
        viewer.write_u8(1).await.unwrap();
        viewer.read_u8().await.unwrap();
        let first = asked.elapsed().as_secs_f64();
        let mut rest = Vec::new();
        viewer.read_to_end(&mut rest).await.unwrap();
        let all = asked.elapsed().as_secs_f64();
        assert_eq!(rest, vec![7; ANSWER_BYTES - 1]);
        // Never sooner than the link allows; a busy machine may be later.
        assert!(first >= 0.15 && all >= 0.25, "{first} {all}");
    }
}
