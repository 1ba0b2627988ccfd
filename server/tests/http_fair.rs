//! Who is served first: the store's reads between viewers, urgency within a connection, what is read ahead.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::time::Duration;

use futures_util::future::join_all;
use lodestream_format::wire::{PageWant, PagesPost};
use lodestream_server::library::Library;
use support::made::{self, Made};
use support::server::{Running, blocks, client, client_h2};
use support::watched::Watched;

fn path(asset: &Made, first: u32, last: u32) -> String {
    format!("/v1/assets/{}/pages/{first}-{last}", asset.hash)
}

/// A piece a page, each page depends on the one before: what depends on page 1 is not read before somebody asks for that.
#[tokio::test]
async fn what_depends_on_a_page_is_read_ahead_from_a_store_over_the_network() {
    for (location, read) in [("s3://watched", 2), ("watched", 1)] {
        let store = Watched::new();
        let library = Library::over(store.clone(), location);
        let asset = made::asset(&library, 5, 12, 128 * 1024).await;
        let server = Running::start(library).await;
        let client = client();
        let page = client
            .get(server.url(&path(&asset, 0, 0)))
            .send()
            .await
            .unwrap();
        assert_eq!(page.bytes().await.unwrap(), asset.frame(0));
        let deadline = tokio::time::Instant::now() + Duration::from_secs(10);
        while store.ranges() < read && tokio::time::Instant::now() < deadline {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
        assert_eq!(store.ranges(), read, "{location}");
        server.stop().await;
    }
}

/// One viewer asks for all of a large asset in many requests, then another for four pages of a second one.
#[tokio::test]
async fn who_asks_for_little_does_not_wait_for_who_asks_for_all() {
    let store = Watched::new();
    let library = Library::over(store.clone(), "watched");
    let large = made::asset(&library, 5, 400, 100_000).await;
    let small = made::asset(&library, 6, 4, 100_000).await;
    let server = Running::start(library).await;
    let client = client_h2();
    // The page tables are read.
    for asset in [&large, &small] {
        client
            .head(server.url(&path(asset, 0, 0)))
            .send()
            .await
            .unwrap();
    }
    store.delay_reads(Duration::from_millis(40));
    let bulk = tokio::spawn({
        let asked: Vec<_> = (0..190)
            .map(|index| {
                client
                    .get(server.url(&path(&large, 2 * index, 2 * index + 1)))
                    .send()
            })
            .collect();
        async move {
            for answer in join_all(asked).await {
                answer.unwrap().bytes().await.unwrap();
            }
        }
    });
    while store.ranges() < 40 {
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    let before = store.ranges();
    let other = support::server::client();
    let post = PagesPost {
        viewer: 2,
        sequence: 1,
        wants: vec![PageWant {
            asset: small.hash,
            first: 0,
            last: 3,
            priority: 1.0,
        }],
    };
    let body = serde_json::to_vec(&post).unwrap();
    let answer = other
        .post(server.url("/v1/pages"))
        .body(body)
        .send()
        .await
        .unwrap();
    assert_eq!(blocks(&answer.bytes().await.unwrap()).0.len(), 4);
    let meanwhile = store.ranges() - before;
    // Its four pieces wait for one round of the 32 reads at once, and share a few more; the other viewer's 300 would be 10 rounds.
    assert!(meanwhile <= 4 * 32, "{meanwhile} reads");
    bulk.abort();
}

/// A hundred large answers of one connection are under way, of which the client reads slowly; an urgent one overtakes them.
#[tokio::test]
async fn an_urgent_answer_overtakes_what_a_connection_has_queued() {
    let library = Library::open("memory://").unwrap();
    let asset = made::asset(&library, 5, 1000, 100_000).await;
    let server = Running::start(library).await;
    let mut connection = support::h2::Slow::connect(&server).await;
    for index in 0..100 {
        connection
            .get(&path(&asset, 10 * index, 10 * index + 9), "u=5")
            .await;
    }
    connection.read(1 << 20).await;
    let before = connection.read_bytes();
    let urgent = connection.get(&path(&asset, 7, 7), "u=0").await;
    connection.read_until_end_of(urgent).await;
    let between = connection.read_bytes() - before;
    // What HTTP/2 and the socket had been given, what is on its way, and the answer.
    let most = 256 * 1024 + support::h2::RECEIVE_BYTES + 100_000;
    assert!(between <= most, "{between} bytes, expected at most {most}");
    server.stop().await;
}
