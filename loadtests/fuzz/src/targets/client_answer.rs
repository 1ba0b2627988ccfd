//! A server's answers as the client reads them: over HTTP/2, cut anyhow, with any status.

use std::convert::Infallible;
use std::sync::{Mutex, OnceLock};

use axum::body::{Body, Bytes};
use axum::http::{HeaderValue, Request, Response};
use hyper::body::Incoming;
use hyper::server::conn::http2;
use hyper::service::service_fn;
use hyper_util::rt::{TokioExecutor, TokioIo};
use lodestream_client::stream::{OpenedAsset, Source, StreamError};
use lodestream_format::wire::{Block, BlockKind, PageWant, PagesPost};
use lodestream_format::{Asset, ContentHash, Hierarchy};
use tokio::net::TcpListener;
use tokio::runtime::Runtime;

use super::blocks;
use super::input::Input;
use super::served::{runtime, served};

pub const MOST_BYTES: [usize; 2] = [64 << 20, 4096];
/// Between the bodies of one input: no JSON has it.
const NEXT: u8 = 0xfe;
/// Requests that one call of the client makes at most.
const MOST_REQUESTS: usize = 64;

/// What the server says next.
#[derive(Default)]
struct Said {
    status: u16,
    retry_after: Vec<u8>,
    cut: usize,
    bodies: Vec<Vec<u8>>,
    requests: usize,
}

static SAID: Mutex<Option<Said>> = Mutex::new(None);

struct Connected {
    runtime: Runtime,
    source: Source,
    opened: OpenedAsset,
}

/// What is asked for, the status, how the body is cut, `retry-after` behind its length, the body.
pub fn run(data: &[u8]) {
    let connected = connected();
    let mut input = Input(data);
    let (kind, status, cut) = (input.byte() % 5, input.byte(), input.byte());
    let status = [200, 404, 429, 503, 206, 500, 304].get(usize::from(status));
    let status = *status.unwrap_or(&200);
    let retry_after = input.sized().to_vec();
    let body = input.0;
    let bodies = match kind {
        2 => body
            .split(|&byte| byte == NEXT)
            .map(<[u8]>::to_vec)
            .collect(),
        _ => vec![body.to_vec()],
    };
    let (read, ended) = blocks::read(body, body.len().max(1));
    // The client would wait and ask again.
    if kind == 1 && status == 200 && ended == Ok(false) {
        return;
    }
    *SAID.lock().expect("the lock") = Some(Said {
        status,
        retry_after,
        cut: usize::from(cut) + 1,
        bodies,
        requests: 0,
    });
    let source = &connected.source;
    connected.runtime.block_on(async {
        match kind {
            0 => {
                let mut pages = Vec::new();
                let opened = &connected.opened;
                let last = opened.asset.pages.len() as u32 - 1;
                let post = PagesPost {
                    viewer: 1,
                    sequence: 1,
                    wants: vec![PageWant {
                        asset: opened.hash,
                        first: 0,
                        last,
                        priority: 1.0,
                    }],
                };
                let assets = std::slice::from_ref(opened);
                let result = source
                    .post_pages(&post, assets, |page| pages.push(page))
                    .await;
                if status == 200 {
                    // Of a broken answer the pages before have been taken, each that was asked for
                    // once.
                    assert!(pages.len() <= read.len() && pages.len() <= last as usize + 1);
                    let asked =
                        |block: &&Block| block.kind == BlockKind::Page && block.page <= last;
                    let asked = read.iter().filter(asked).count();
                    assert!(pages.len() <= asked);
                    if result.is_ok() {
                        assert_eq!((ended, pages.len()), (Ok(true), read.len()));
                    }
                } else {
                    assert!(result.is_err() && pages.is_empty());
                }
                check(result.err());
            }
            1 => check(source.open("a").await.err()),
            2 => check(source.scenes().await.err()),
            3 => {
                let hash = ContentHash::of(body);
                let object = source.object(&hash, MOST_BYTES[0] as u64).await;
                assert_eq!(object.is_ok(), status == 200, "{object:?}");
                check(source.object(&ContentHash([1; 32]), 1 << 20).await.err());
            }
            _ => {
                let pages = source.pages(&connected.opened, 0, 1).await;
                assert_eq!(pages.is_ok(), status == 200 && body.len() == 150);
                check(pages.err());
            }
        }
    });
}

fn check(error: Option<StreamError>) {
    if let Some(error) = error {
        assert!(!error.to_string().is_empty());
        let _ = error.retry();
    }
}

fn connected() -> &'static Connected {
    static CONNECTED: OnceLock<Connected> = OnceLock::new();
    CONNECTED.get_or_init(|| {
        let runtime = runtime();
        let address = runtime.block_on(async {
            let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
            let address = listener.local_addr().expect("an address");
            tokio::spawn(serve(listener));
            address
        });
        let source = Source::connect(&format!("http://{address}")).expect("a source");
        let asset: Asset = served().asset.clone();
        let opened = OpenedAsset {
            hash: served().hashes[0].1,
            asset,
            hierarchy: Hierarchy::default(),
            root_pages: vec![],
            page_base: 0,
        };
        Connected {
            runtime,
            source,
            opened,
        }
    })
}

async fn serve(listener: TcpListener) {
    while let Ok((socket, _)) = listener.accept().await {
        let service = service_fn(async |_: Request<Incoming>| Ok::<_, Infallible>(say()));
        let connection = http2::Builder::new(TokioExecutor::new());
        tokio::spawn(connection.serve_connection(TokioIo::new(socket), service));
    }
}

fn say() -> Response<Body> {
    let mut said = SAID.lock().expect("the lock");
    let said = said.get_or_insert_default();
    said.requests += 1;
    assert!(
        said.requests <= MOST_REQUESTS,
        "the client never stops asking"
    );
    let body = &said.bodies[(said.requests - 1) % said.bodies.len()];
    let pieces: Vec<_> = body
        .chunks(said.cut.max(body.len() / 64 + 1))
        .map(|piece| Ok::<_, Infallible>(Bytes::copy_from_slice(piece)))
        .collect();
    let response = Response::builder().status(said.status);
    let body = Body::from_stream(futures_util::stream::iter(pieces));
    let response = match HeaderValue::from_bytes(&said.retry_after) {
        Ok(value) => response.header("retry-after", value),
        Err(_) => response,
    };
    response.body(body).expect("an answer")
}
