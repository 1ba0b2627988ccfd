//! A server on a free port in this process, and clients for it.

use std::net::SocketAddr;
use std::sync::Once;

use lodestream_format::wire::{Block, BlockReader};
use lodestream_server::http::limits::ClientLimits;
use lodestream_server::http::serve::Server;
use lodestream_server::http::{AppState, StateOptions};
use lodestream_server::library::Library;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::sync::oneshot;

/// A running server; it goes down when this is dropped.
pub struct Running {
    pub address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    done: Option<tokio::task::JoinHandle<()>>,
}

impl Running {
    pub async fn start(library: Library) -> Self {
        Self::start_limited(library, ClientLimits::default()).await
    }

    pub async fn start_limited(library: Library, limits: ClientLimits) -> Self {
        let options = StateOptions {
            cache_bytes: 1 << 20,
            limits,
            ..StateOptions::default()
        };
        Self::start_with(library, options).await
    }

    pub async fn start_with(library: Library, options: StateOptions) -> Self {
        Self::over(AppState::with_options(library, options)).await
    }

    /// With so many bytes of pages and tables in memory.
    pub async fn start_with_cache(library: Library, cache_bytes: usize) -> Self {
        Self::over(AppState::new(library, cache_bytes)).await
    }

    async fn over(state: AppState) -> Self {
        let server = Server::bind("127.0.0.1:0").await.expect("binds");
        Self::run(server, state)
    }

    /// Over a server that is set up otherwise.
    pub fn run(server: Server, state: AppState) -> Self {
        let address = server.address();
        let (stop, stopped) = oneshot::channel();
        let done = tokio::spawn(server.run(state, async {
            let _ = stopped.await;
        }));
        Self {
            address,
            stop: Some(stop),
            done: Some(done),
        }
    }

    pub fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.address)
    }

    /// Stops it and waits until it is down.
    pub async fn stop(mut self) {
        drop(self.stop.take());
        if let Some(done) = self.done.take() {
            done.await.expect("no panic");
        }
    }
}

/// HTTP/1.1.
pub fn client() -> reqwest::Client {
    provider();
    reqwest::Client::builder()
        .no_proxy()
        .build()
        .expect("a client")
}

/// Cleartext HTTP/2, known beforehand.
pub fn client_h2() -> reqwest::Client {
    provider();
    reqwest::Client::builder()
        .no_proxy()
        .http2_prior_knowledge()
        .build()
        .expect("a client")
}

fn provider() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // Another test of this process may have been first.
        let _ = rustls::crypto::ring::default_provider().install_default();
    });
}

/// Sends a request line as it is, with no client in between that would clean the path; gives status and body.
pub async fn raw(address: SocketAddr, request: &str) -> (u16, String) {
    let mut stream = tokio::net::TcpStream::connect(address)
        .await
        .expect("connects");
    let text = format!("{request}\r\nHost: x\r\nConnection: close\r\n\r\n");
    stream.write_all(text.as_bytes()).await.expect("writes");
    let mut answer = vec![];
    stream.read_to_end(&mut answer).await.expect("reads");
    let answer = String::from_utf8_lossy(&answer).into_owned();
    let status = answer
        .split_whitespace()
        .nth(1)
        .and_then(|status| status.parse().ok());
    (status.expect("a status line"), answer)
}

/// All blocks of an answer, and whether its end came.
pub fn blocks(bytes: &[u8]) -> (Vec<Block>, bool) {
    let mut reader = BlockReader::default();
    reader.push(bytes);
    let mut blocks = vec![];
    while let Some(block) = reader.next_block().expect("whole blocks") {
        blocks.push(block);
    }
    (blocks, reader.is_ended())
}

/// A header's text, empty where there is none.
pub fn header<'a>(response: &'a reqwest::Response, name: &str) -> &'a str {
    response
        .headers()
        .get(name)
        .map_or("", |value| value.to_str().expect("text"))
}
