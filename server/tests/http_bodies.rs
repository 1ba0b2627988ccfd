//! Posts that stall, trickle or never end: they are given up, and cost other clients nothing.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::convert::Infallible;
use std::net::{IpAddr, SocketAddr};

use bytes::Bytes;
use futures_util::{StreamExt, stream};
use lodestream_server::library::Library;
use reqwest::StatusCode;
use support::server::{Running, client, client_h2};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpSocket, TcpStream};
use tokio::task::JoinHandle;

const HEAD: &str = "POST /v1/pages HTTP/1.1\r\nHost: a\r\n";
/// Less than the most that a post may have, and more than the share of a client.
const STALLED_BYTES: usize = 16_000_000;
const OTHER: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(127, 0, 0, 2));

async fn connect(address: SocketAddr) -> TcpStream {
    let socket = TcpSocket::new_v4().unwrap();
    socket.connect(address).await.unwrap()
}

/// Sends `begin` and then nothing; gives what the server says until it closes.
fn stalls(address: SocketAddr, begin: Vec<u8>) -> JoinHandle<String> {
    tokio::spawn(async move {
        let mut stream = connect(address).await;
        // One that is refused may be closed before it is all written.
        let _ = stream.write_all(&begin).await;
        let mut said = vec![];
        let _ = stream.read_to_end(&mut said).await;
        String::from_utf8_lossy(&said).into_owned()
    })
}

fn announced(bytes: usize) -> Vec<u8> {
    let mut post = format!("{HEAD}Content-Length: 16777216\r\n\r\n").into_bytes();
    post.resize(post.len() + bytes, b' ');
    post
}

/// Without a length beforehand.
fn chunked(bytes: usize) -> Vec<u8> {
    let mut post = format!("{HEAD}Transfer-Encoding: chunked\r\n\r\n{bytes:x}\r\n").into_bytes();
    post.resize(post.len() + bytes, b' ');
    post
}

/// A post without wants, with spaces before it.
fn padded(bytes: usize) -> String {
    " ".repeat(bytes) + r#"{"viewer":9,"sequence":1,"wants":[]}"#
}

/// Clients of another address than those that stall, and of the same one.
fn others() -> [reqwest::Client; 2] {
    // Makes sure that there is a provider of cryptography.
    client();
    let of = |http2: bool| {
        let builder = reqwest::Client::builder().no_proxy().local_address(OTHER);
        match http2 {
            true => builder.http2_prior_knowledge().build().unwrap(),
            false => builder.build().unwrap(),
        }
    };
    [of(false), of(true)]
}

async fn post_status(client: &reqwest::Client, server: &Running, bytes: usize) -> StatusCode {
    let request = client.post(server.url("/v1/pages")).body(padded(bytes));
    request.send().await.unwrap().status()
}

#[tokio::test]
async fn posts_that_stall_leave_those_of_other_clients_alone() {
    let server = Running::start(Library::open("memory://").unwrap()).await;
    let mut stalled = vec![];
    for _ in 0..2 {
        stalled.push(stalls(server.address, announced(STALLED_BYTES)));
        stalled.push(stalls(server.address, chunked(STALLED_BYTES)));
    }
    stalled.extend((0..50).map(|_| stalls(server.address, announced(60_000))));
    let pieces = || {
        let begin = stream::iter(vec![
            Ok::<_, Infallible>(Bytes::from(vec![b' '; 1 << 20]));
            15
        ]);
        reqwest::Body::wrap_stream(begin.chain(stream::pending()))
    };
    let over_h2 = client_h2();
    let streams = (0..3).map(|_| over_h2.post(server.url("/v1/pages")).body(pieces()).send());
    let streams: Vec<_> = streams.map(tokio::spawn).collect();
    // They are there, and hold what they can, as long as these last.
    for round in 0..20 {
        for other in others() {
            for bytes in [0, 10_000, 100_000, 3_000_000] {
                let status = post_status(&other, &server, bytes).await;
                assert_eq!(status, StatusCode::OK, "{bytes} bytes, round {round}");
            }
        }
        for same in [client(), client_h2()] {
            assert_eq!(post_status(&same, &server, 0).await, StatusCode::OK);
        }
    }
    for stalled in stalled {
        let said = stalled.await.unwrap();
        // One that waits for room of its own client may be told that there is none.
        let given_up = ["HTTP/1.1 408", "HTTP/1.1 503", ""];
        assert!(given_up.iter().any(|it| said.starts_with(it)), "{said}");
    }
    for stream in streams {
        let answer = stream.await.unwrap();
        let status = answer.map(|answer| answer.status().as_u16());
        assert!(matches!(status, Ok(408 | 503) | Err(_)), "{status:?}");
    }
    // All room is there again, and posts that are larger together wait for each other's.
    let clients: Vec<_> = (0..4).map(|_| client()).collect();
    let large = clients
        .iter()
        .map(|one| post_status(one, &server, 15_000_000));
    for status in futures_util::future::join_all(large).await {
        assert_eq!(status, StatusCode::OK);
    }
    server.stop().await;
}

#[tokio::test]
async fn posts_that_trickle_or_stop_are_given_up() {
    let server = Running::start(Library::open("memory://").unwrap()).await;
    let mut stalled = vec![
        stalls(server.address, announced(0)),
        stalls(server.address, announced(3)),
        stalls(server.address, chunked(3)),
        stalls(
            server.address,
            format!("{HEAD}Transfer-Encoding: chunked\r\n\r\nFF").into(),
        ),
    ];
    let address = server.address;
    // A byte now and then, in chunks of one or of those announced.
    for (head, piece) in [
        (
            format!("{HEAD}Transfer-Encoding: chunked\r\n\r\n"),
            "1\r\n \r\n",
        ),
        (format!("{HEAD}Content-Length: 1000\r\n\r\n"), " "),
    ] {
        stalled.push(tokio::spawn(async move {
            let mut stream = connect(address).await;
            stream.write_all(head.as_bytes()).await.unwrap();
            let mut said = vec![0; 100];
            loop {
                let read = stream.read(&mut said);
                match tokio::time::timeout(std::time::Duration::from_millis(200), read).await {
                    Ok(read) => {
                        said.truncate(read.unwrap_or(0));
                        return String::from_utf8_lossy(&said).into_owned();
                    }
                    Err(_) => drop(stream.write_all(piece.as_bytes()).await),
                }
            }
        }));
    }
    let drip = || {
        let drip = stream::unfold((), |()| async {
            tokio::time::sleep(std::time::Duration::from_millis(200)).await;
            Some((Ok::<_, Infallible>(Bytes::from_static(b" ")), ()))
        });
        reqwest::Body::wrap_stream(drip)
    };
    let slow = client_h2()
        .post(server.url("/v1/pages"))
        .body(drip())
        .send();
    for stalled in stalled {
        let said = stalled.await.unwrap();
        assert!(said.starts_with("HTTP/1.1 408"), "{said}");
    }
    assert_eq!(slow.await.unwrap().status(), StatusCode::REQUEST_TIMEOUT);
    server.stop().await;
}
