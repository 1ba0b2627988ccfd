//! Pages from memory: one read for all who wait, nothing remembered of failures, the bytes of the pack whatever is held.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::sync::Arc;

use futures_util::future::join_all;
use lodestream_server::library::Library;
use reqwest::StatusCode;
use support::made::{self, Made};
use support::server::{Running, client};
use support::watched::Watched;

async fn served(pages: u32, page_bytes: usize) -> (Arc<Watched>, Running, Made) {
    let store = Watched::new();
    let library = Library::over(store.clone(), "watched");
    let asset = made::asset(&library, 5, pages, page_bytes).await;
    (store, Running::start(library).await, asset)
}

fn path(asset: &Made, first: u32, last: u32) -> String {
    format!("/v1/assets/{}/pages/{first}-{last}", asset.hash)
}

#[tokio::test]
async fn all_who_want_a_piece_wait_for_one_read() {
    // Twelve pages in one piece.
    let (store, server, asset) = served(12, 10_000).await;
    let client = client();
    let asked = (0..48).map(|index| {
        let page = index % 12;
        let request = client.get(server.url(&path(&asset, page, page)));
        async move { (page, request.send().await.unwrap().bytes().await.unwrap()) }
    });
    for (page, body) in join_all(asked).await {
        assert_eq!(body, asset.frame(page));
    }
    assert_eq!(store.ranges(), 1);
    let metrics = client.get(server.url("/metrics")).send().await.unwrap();
    let metrics = metrics.text().await.unwrap();
    let held = format!("lodestream_page_cache_bytes {}", asset.pack.len());
    assert!(metrics.contains(&held), "{metrics}");
}

#[tokio::test]
async fn a_failed_read_is_not_remembered() {
    let (store, server, asset) = served(3, 200_000).await;
    let client = client();
    let get = |first, last| client.get(server.url(&path(&asset, first, last))).send();
    // The page table is read, the pages are not.
    let head = client.head(server.url(&path(&asset, 0, 0))).send().await;
    assert_eq!(head.unwrap().status(), StatusCode::OK);
    store.fail_reads(true);
    assert!(get(0, 2).await.unwrap().status().is_server_error());
    store.fail_reads(false);
    let whole = get(0, 2).await.unwrap();
    assert_eq!(whole.status(), StatusCode::OK);
    assert_eq!(whole.bytes().await.unwrap(), asset.pack);
    let read = store.ranges();
    assert_eq!(get(1, 2).await.unwrap().bytes().await.unwrap().len(), {
        asset.frame(1).len() + asset.frame(2).len()
    });
    assert_eq!(store.ranges(), read, "from memory");
}

/// The servers of these tests have a cache of 1 MiB.
#[tokio::test]
async fn a_pack_larger_than_the_cache_is_served_in_bounded_memory() {
    let (_, server, asset) = served(150, 30_000).await;
    let client = client();
    for round in 0..3u32 {
        for step in 0..50 {
            let first = (step * 37 + round * 11) % 140;
            let last = first + step % 9;
            let body = client.get(server.url(&path(&asset, first, last))).send();
            let body = body.await.unwrap().bytes().await.unwrap();
            let expected: Vec<u8> = (first..=last)
                .flat_map(|page| asset.frame(page).to_vec())
                .collect();
            assert_eq!(body, expected, "{first}-{last}");
        }
    }
    let metrics = client.get(server.url("/metrics")).send().await.unwrap();
    let metrics = metrics.text().await.unwrap();
    let value = |name: &str| -> u64 {
        let line = metrics.lines().find_map(|line| line.strip_prefix(name));
        line.unwrap().trim().parse().unwrap()
    };
    let held = value("lodestream_page_cache_bytes ");
    assert!((1..=1 << 20).contains(&held), "{held}");
    assert!(value("lodestream_page_cache_reads_total{result=\"hit\"} ") > 0);
    assert!(value("lodestream_page_cache_reads_total{result=\"miss\"} ") > 150);
}

/// Of four answers the first reads the pages; over HTTP/1.1 the third, which says what the client holds, is the router's, and so are all
/// after it on its connection; over HTTP/2 the front has what is in memory.
#[tokio::test]
async fn what_is_in_memory_is_answered_as_what_is_read() {
    let (_, server, asset) = served(9, 70_000).await;
    for client in [client(), support::server::client_h2()] {
        for (first, last) in [(0, 0), (1, 1), (2, 6), (0, 8)] {
            let mut answers = vec![];
            for holds in [None, None, Some("\"other\""), None] {
                let mut request = client.get(server.url(&path(&asset, first, last)));
                if let Some(holds) = holds {
                    request = request.header("if-none-match", holds);
                }
                let answer = request.send().await.unwrap();
                let mut headers = answer.headers().clone();
                assert!(headers.remove("date").is_some());
                let (status, version) = (answer.status(), answer.version());
                answers.push((status, version, headers, answer.bytes().await.unwrap()));
            }
            assert_eq!(answers[0], answers[1]);
            assert_eq!(answers[0], answers[2]);
            assert_eq!(answers[0], answers[3]);
            let expected: Vec<u8> = (first..=last)
                .flat_map(|page| asset.frame(page).to_vec())
                .collect();
            assert_eq!(answers[0].3, expected);
        }
        // What the front leaves to the router.
        let url = server.url(&path(&asset, 1, 1));
        let tag = client.get(&url).send().await.unwrap().headers()["etag"].clone();
        let held = client
            .get(&url)
            .header("if-none-match", tag)
            .send()
            .await
            .unwrap();
        assert_eq!(held.status(), StatusCode::NOT_MODIFIED);
        assert_eq!(
            client
                .head(&url)
                .send()
                .await
                .unwrap()
                .bytes()
                .await
                .unwrap(),
            ""
        );
        for wrong in ["9-9", "00-1", "1-0", "0-"] {
            let wrong = format!("/v1/assets/{}/pages/{wrong}", asset.hash);
            let answer = client.get(server.url(&wrong)).send().await.unwrap();
            assert!(answer.status().is_client_error(), "{wrong}");
        }
    }
    let metrics = client().get(server.url("/metrics")).send().await.unwrap();
    let metrics = metrics.text().await.unwrap();
    let count =
        "lodestream_requests_total{route=\"/v1/assets/{hash}/pages/{range}\",status=\"200\"} 36";
    assert!(metrics.contains(count), "{metrics}");
    assert!(
        metrics.contains("lodestream_requests_in_flight 1\n"),
        "{metrics}"
    );
}
