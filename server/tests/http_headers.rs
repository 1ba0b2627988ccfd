//! Fields of answers beside their contents: who may show them, that they are nothing else, and
//! where the counters are.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use lodestream_server::http::cors::Cors;
use lodestream_server::http::serve::Server;
use lodestream_server::http::{AppState, Serves};
use lodestream_server::library::Library;
use reqwest::{Response, StatusCode};
use support::made;
use support::server::{Running, client, client_h2, header};

const OURS: &str = "https://viewer.example";

/// A server, and a path to pages of it.
async fn served(set_up: impl FnOnce(Server) -> Server) -> (Running, String) {
    let library = Library::open("memory://").unwrap();
    let asset = made::asset(&library, 1, 3, 1000).await;
    let pages = format!("/v1/assets/{}/pages/0-2", asset.hash);
    made::scene(&library, "city", &[asset]).await;
    let server = Server::bind("127.0.0.1:0").await.unwrap();
    let state = AppState::new(library, 1 << 20);
    (Running::run(set_up(server), state), pages)
}

fn varies(answer: &Response) -> bool {
    let fields = answer.headers().get_all("vary");
    fields.iter().any(|field| field == "origin")
}

#[tokio::test]
async fn every_answer_says_that_it_is_nothing_else() {
    let (server, pages) = served(|server| server).await;
    for client in [client(), client_h2()] {
        // The first time pages are read, then they are in memory.
        for path in [
            &pages,
            &pages,
            "/v1/scenes",
            "/v1/scenes/none",
            "/nothing",
            "/v1/assets/x/pages/0-0",
            &pages,
        ] {
            let answer = client.get(server.url(path)).send().await.unwrap();
            assert_eq!(
                header(&answer, "x-content-type-options"),
                "nosniff",
                "{path}"
            );
            assert_eq!(
                header(&answer, "access-control-allow-origin"),
                "*",
                "{path}"
            );
            assert!(!varies(&answer), "{path}");
        }
    }
    server.stop().await;
}

#[tokio::test]
async fn pages_of_other_origins_are_shut_out_where_some_are_named() {
    let cors = Cors::of(&[OURS.to_owned()]).unwrap();
    let (server, pages) = served(|server| server.with_cors(cors)).await;
    for client in [client(), client_h2()] {
        for path in [&pages, "/v1/scenes", "/v1/scenes/none", &pages] {
            for (origin, allowed) in [
                (None, ""),
                (Some("https://other.example"), ""),
                (Some(OURS), OURS),
            ] {
                let request = client.get(server.url(path));
                let request = match origin {
                    Some(origin) => request.header("origin", origin),
                    None => request,
                };
                let answer = request.send().await.unwrap();
                let found = header(&answer, "access-control-allow-origin");
                assert_eq!(found, allowed, "{path} {origin:?}");
                assert_eq!(header(&answer, "x-content-type-options"), "nosniff");
                assert!(varies(&answer), "{path} {origin:?}");
            }
        }
        let asked = client.request(reqwest::Method::OPTIONS, server.url(&pages));
        let asked = asked.header("origin", OURS).send().await.unwrap();
        assert_eq!(header(&asked, "access-control-allow-origin"), OURS);
    }
    server.stop().await;
}

#[tokio::test]
async fn counters_are_on_a_listener_of_their_own_where_there_is_one() {
    for (serves, counters, library) in [
        (Serves::All, StatusCode::OK, StatusCode::OK),
        (Serves::Library, StatusCode::NOT_FOUND, StatusCode::OK),
        (Serves::Metrics, StatusCode::OK, StatusCode::NOT_FOUND),
    ] {
        let (server, pages) = served(|server| server.with_routes(serves)).await;
        for client in [client(), client_h2()] {
            for (path, status) in [
                ("/metrics", counters),
                ("/v1/scenes", library),
                (&pages, library),
                (&pages, library),
                ("/healthz", StatusCode::OK),
            ] {
                let answer = client.get(server.url(path)).send().await.unwrap();
                assert_eq!(answer.status(), status, "{serves:?} {path}");
            }
        }
        server.stop().await;
    }
}
