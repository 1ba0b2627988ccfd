//! What one client may ask of a server, and the document that says what there is to ask.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use lodestream_server::http::limits::ClientLimits;
use lodestream_server::library::Library;
use reqwest::StatusCode;
use support::made;
use support::server::{Running, client, client_h2, header};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

async fn library() -> (Library, String) {
    let library = Library::open("memory://").unwrap();
    let asset = made::asset(&library, 1, 3, 1000).await;
    let pages = format!("/v1/assets/{}/pages/0-2", asset.hash);
    made::scene(&library, "city", &[asset]).await;
    (library, pages)
}

#[tokio::test]
async fn a_client_that_asks_too_often_is_told_when_to_come_back() {
    let (library, pages) = library().await;
    let limits = ClientLimits {
        requests_per_sec: Some(5),
        connections: None,
    };
    let server = Running::start_limited(library, limits).await;
    for client in [client(), client_h2()] {
        // Pages from memory are counted as what the router answers.
        for path in ["/v1/scenes", &pages] {
            let mut refused = 0;
            for _ in 0..40 {
                let answer = client.get(server.url(path)).send().await.unwrap();
                if answer.status() == StatusCode::TOO_MANY_REQUESTS {
                    let secs: u64 = header(&answer, "retry-after").parse().unwrap();
                    assert!(secs >= 1);
                    assert_eq!(header(&answer, "access-control-allow-origin"), "*");
                    refused += 1;
                } else {
                    assert_eq!(answer.status(), StatusCode::OK);
                }
            }
            assert!(refused > 20, "{refused} of {path}");
            let health = client.get(server.url("/healthz")).send().await.unwrap();
            assert_eq!(health.status(), StatusCode::OK);
        }
    }
    tokio::time::sleep(std::time::Duration::from_millis(1100)).await;
    let counters = client().get(server.url("/metrics")).send().await.unwrap();
    let counters = counters.text().await.unwrap();
    assert!(counters.contains("status=\"429\""), "{counters}");
    server.stop().await;
}

#[tokio::test]
async fn a_client_has_so_many_connections_and_no_more() {
    let (library, _) = library().await;
    let limits = ClientLimits {
        requests_per_sec: None,
        connections: Some(2),
    };
    let server = Running::start_limited(library, limits).await;
    let connect = async || TcpStream::connect(server.address).await.unwrap();
    let say = async |stream: &mut TcpStream, words: &str| {
        // A closed connection may say so at either.
        if stream.write_all(words.as_bytes()).await.is_err() {
            return String::new();
        }
        let mut bytes = [0; 1024];
        let read = stream.read(&mut bytes).await.unwrap_or(0);
        String::from_utf8_lossy(&bytes[..read]).into_owned()
    };
    let ask = async |stream: &mut TcpStream| {
        let answer = say(stream, "GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n").await;
        answer.starts_with("HTTP/1.1 200")
    };
    // In use until its body comes; the server says that it waits for it.
    let begin = async |stream: &mut TcpStream| {
        let post = "POST /v1/pages HTTP/1.1\r\nHost: x\r\nContent-Length: 40\r\n";
        let answer = say(stream, &format!("{post}Expect: 100-continue\r\n\r\n")).await;
        assert!(answer.starts_with("HTTP/1.1 100"), "{answer}");
    };
    let (mut first, mut second) = (connect().await, connect().await);
    begin(&mut first).await;
    begin(&mut second).await;
    assert!(!ask(&mut connect().await).await, "both are in use");
    second.write_all(&[b' '; 40]).await.unwrap();
    let mut answer = [0; 1024];
    assert!(second.read(&mut answer).await.unwrap() > 0);
    // The one that is not makes room; the server has to notice that first.
    for attempt in 0.. {
        if ask(&mut connect().await).await {
            break;
        }
        assert!(attempt < 200, "no connection beside an idle one");
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    }
    while second.read(&mut answer).await.is_ok_and(|read| read > 0) {}
    first.write_all(&[b' '; 40]).await.unwrap();
    let read = first.read(&mut answer).await.unwrap();
    assert!(answer[..read].starts_with(b"HTTP/1.1 400"), "still there");
    server.stop().await;
}

#[tokio::test]
async fn the_routes_are_described() {
    let (library, _) = library().await;
    let server = Running::start(library).await;
    let url = server.url("/v1/openapi.json");
    let answer = client().get(url).send().await.unwrap();
    assert_eq!(header(&answer, "content-type"), "application/json");
    let document: serde_json::Value =
        serde_json::from_slice(&answer.bytes().await.unwrap()).unwrap();
    assert_eq!(document["openapi"], "3.1.0");
    server.stop().await;
}
