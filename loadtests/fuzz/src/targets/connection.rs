//! Bytes on a connection to the server: heads of HTTP/1.1, the preface of HTTP/2, and what follows them.

use std::net::SocketAddr;
use std::sync::OnceLock;

use lodestream_server::http::serve::Server;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::runtime::Runtime;

use super::input::{Input, with_hashes};
use super::served::{runtime, served};

pub const MOST_BYTES: [usize; 2] = [64 << 20, 4096];
/// Pieces that an input is sent in at most.
const MOST_PIECES: usize = 16;
/// What HTTP/2 begins with.
const PREFACE: &[u8] = b"PRI ";
const HEAD: &[u8] = b"HEAD ";

/// How the rest is cut, then what is sent; `$A`, `$P` and `$S` are hashes of asset, pack and scene.
pub fn run(data: &[u8]) {
    static LISTENING: OnceLock<(Runtime, SocketAddr)> = OnceLock::new();
    let (runtime, address) = LISTENING.get_or_init(|| {
        let runtime = runtime();
        let server = runtime.block_on(Server::bind("127.0.0.1:0"));
        let server = server.expect("a port");
        let address = server.address();
        runtime.spawn(server.run(served().state.clone(), std::future::pending()));
        (runtime, address)
    });
    let mut input = Input(data);
    let cut = usize::from(input.byte()) + 1;
    let sent = with_hashes(input.0, &served().hashes);
    let answer = runtime.block_on(exchange(*address, &sent, cut));
    // The length of an answer to HEAD is of no body: where the next answer begins is not known.
    let has_head = sent.windows(HEAD.len()).any(|it| it == HEAD);
    if !sent.starts_with(PREFACE) && !has_head && !answer.is_empty() {
        check(&answer);
    }
}

/// What comes back before the server closes; errors end it as well, since it may close before all was sent.
async fn exchange(address: SocketAddr, sent: &[u8], cut: usize) -> Vec<u8> {
    let mut answer = Vec::new();
    let Ok(mut socket) = TcpStream::connect(address).await else {
        return answer;
    };
    for piece in sent.chunks(cut.max(sent.len() / MOST_PIECES + 1)) {
        if socket.write_all(piece).await.is_err() {
            break;
        }
        tokio::task::yield_now().await;
    }
    let _ = socket.shutdown().await;
    let _ = socket.read_to_end(&mut answer).await;
    answer
}

/// Whole answers one after the other, the last of them perhaps cut short; pages are those that their tags name.
fn check(mut answers: &[u8]) {
    while !answers.is_empty() {
        assert!(
            answers.starts_with(b"HTTP/1."),
            "{}",
            answers.escape_ascii()
        );
        let end = answers.windows(4).position(|it| it == b"\r\n\r\n");
        let Some(end) = end else {
            return;
        };
        let (head, rest) = answers.split_at(end + 4);
        let head = String::from_utf8_lossy(head).to_ascii_lowercase();
        let field = |name: &str| {
            let mut lines = head.lines().filter_map(|line| line.split_once(": "));
            lines.find(|(own, _)| *own == name).map(|(_, value)| value)
        };
        let length = field("content-length").and_then(|it| it.parse::<usize>().ok());
        let Some(body) = length.and_then(|length| rest.get(..length)) else {
            // In chunks.
            return;
        };
        if head.starts_with("http/1.1 200") && !body.is_empty() {
            check_pages(field("etag").unwrap_or_default(), body);
        }
        answers = &rest[body.len()..];
    }
}

fn check_pages(tag: &str, body: &[u8]) {
    let served = served();
    let range = tag
        .trim_matches('"')
        .strip_prefix(&format!("{}.", served.hashes[0].1));
    if let Some((first, last)) = range.and_then(|it| it.split_once('-')) {
        let page = |text: &str| &served.asset.pages[text.parse::<usize>().expect("a number")];
        let (first, last) = (page(first), page(last));
        let range = first.offset as usize..(last.offset + u64::from(last.bytes)) as usize;
        assert_eq!(*body, served.pack[range]);
    }
}
