//! The cost to the store of missing objects and of the list of scenes.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::sync::Arc;
use std::time::{Duration, Instant};

use lodestream_format::ContentHash;
use lodestream_format::wire::{PageStatus, PageWant, PagesPost, ScenesPage};
use lodestream_server::library::Library;
use reqwest::StatusCode;
use support::made::{self, Made};
use support::server::{Running, blocks, client, client_h2};
use support::watched::Watched;

/// A library of the scene `city` in a store that counts.
async fn watched() -> (Arc<Watched>, Library, Made) {
    let store = Watched::new();
    let library = Library::over(store.clone(), "watched");
    let asset = made::asset(&library, 1, 3, 1000).await;
    made::scene(&library, "city", std::slice::from_ref(&asset)).await;
    (store, library, asset)
}

fn made_up(number: u32) -> ContentHash {
    ContentHash::of(&number.to_le_bytes())
}

fn want(asset: ContentHash, page: u32, priority: f32) -> PageWant {
    PageWant {
        asset,
        first: page,
        last: page,
        priority,
    }
}

async fn statuses(server: &Running, wants: Vec<PageWant>) -> Vec<(ContentHash, PageStatus)> {
    let post = PagesPost {
        viewer: 1,
        sequence: 1,
        wants,
    };
    let request = client().post(server.url("/v1/pages"));
    let request = request.body(serde_json::to_vec(&post).unwrap());
    let answer = request.send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK);
    let (blocks, ended) = blocks(&answer.bytes().await.unwrap());
    assert!(ended);
    let blocks = blocks.iter();
    blocks.map(|block| (block.hash, block.status)).collect()
}

#[tokio::test]
async fn a_post_for_what_is_not_there_costs_a_few_look_ups() {
    let (store, library, asset) = watched().await;
    let server = Running::start(library).await;
    // In memory, so that it is found whatever else is asked for.
    let found = statuses(&server, vec![want(asset.hash, 0, 1.0)]).await;
    assert_eq!(found, [(asset.hash, PageStatus::Ok)]);
    let before = store.looks();
    let mut wants: Vec<_> = (0..5000)
        .map(|number| want(made_up(number), 0, 2.0))
        .collect();
    wants.push(want(asset.hash, 0, 1.0));
    let found = statuses(&server, wants).await;
    assert_eq!(found.len(), 5001);
    assert_eq!(found[5000], (asset.hash, PageStatus::Ok));
    let is = |status| found.iter().filter(|it| it.1 == status).count();
    assert_eq!(is(PageStatus::NotFound), 64);
    // Not looked for, so that nothing is said of whether it is there.
    assert_eq!(is(PageStatus::Failed), 4936);
    assert_eq!(store.looks() - before, 64);
    // One that is not there, and then another, again and again: one look-up each.
    let before = store.looks();
    let wants = (0..4000).map(|at| want(made_up(9000 + at % 2), at, -(at as f32)));
    let found = statuses(&server, wants.collect()).await;
    assert!(found.iter().all(|it| it.1 == PageStatus::NotFound));
    assert_eq!((found.len(), store.looks() - before), (4000, 2));
    server.stop().await;
}

#[tokio::test]
async fn misses_are_not_looked_for_again_at_once() {
    let (store, library, asset) = watched().await;
    let server = Running::start(library.clone()).await;
    let late = bytes::Bytes::from_static(b"comes later");
    let hash = ContentHash::of(&late);
    for (client, number) in [(client(), 0), (client_h2(), 10)] {
        for path in [
            format!("/v1/objects/{}", made_up(number)),
            format!("/v1/assets/{}/pages/0-0", made_up(number + 1)),
            format!("/v1/scenes/none-{number}"),
            format!("/v1/scenes/nothing-{number}/open"),
            format!("/v1/objects/{hash}"),
        ] {
            let (before, began) = (store.looks(), Instant::now());
            for _ in 0..20 {
                let head = client.head(server.url(&path)).send().await.unwrap();
                assert_eq!(head.status(), StatusCode::NOT_FOUND, "{path}");
                let get = client.get(server.url(&path)).send().await.unwrap();
                assert_eq!(get.status(), StatusCode::NOT_FOUND, "{path}");
            }
            let lives = began.elapsed().as_millis() as u64 / 500;
            assert!(
                store.looks() - before <= 1 + lives,
                "{path}: {}",
                store.looks() - before
            );
        }
    }
    // Other errors stay what they are, each time.
    for _ in 0..3 {
        let bad = client().get(server.url("/v1/scenes/.hidden")).send();
        assert_eq!(bad.await.unwrap().status(), StatusCode::BAD_REQUEST);
    }
    made::put(&library, late).await;
    made::scene(&library, "none-0", &[asset]).await;
    for path in [
        format!("/v1/objects/{hash}"),
        "/v1/scenes/none-0".to_owned(),
    ] {
        found_at_last(|| async {
            let answer = client().get(server.url(&path)).send().await.unwrap();
            answer.status() == StatusCode::OK
        })
        .await;
    }
    server.stop().await;
}

/// Waits for what comes by itself.
async fn found_at_last<F: Future<Output = bool>>(found: impl Fn() -> F) {
    for _ in 0..600 {
        if found().await {
            return;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("not found within 30 s");
}

async fn list(server: &Running, query: &str) -> ScenesPage {
    let answer = client()
        .get(server.url(&format!("/v1/scenes?{query}")))
        .send();
    let answer = answer.await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK);
    serde_json::from_slice(&answer.bytes().await.unwrap()).unwrap()
}

fn names(page: &ScenesPage) -> Vec<&str> {
    page.scenes.iter().map(|scene| &*scene.name).collect()
}

#[tokio::test]
async fn the_scenes_are_listed_once_for_all_who_ask() {
    let (store, library, asset) = watched().await;
    for name in ["a", "b", "c"] {
        made::scene(&library, name, std::slice::from_ref(&asset)).await;
    }
    let server = Running::start(library.clone()).await;
    let (lists, looks, began) = (store.lists(), store.looks(), Instant::now());
    let asked = (0..200).map(|_| list(&server, "limit=2"));
    for page in futures_util::future::join_all(asked).await {
        assert_eq!(
            (names(&page), page.next.as_deref()),
            (vec!["a", "b"], Some("b"))
        );
    }
    let page = list(&server, "after=b").await;
    assert_eq!(
        (names(&page), page.next.as_deref()),
        (vec!["c", "city"], None)
    );
    let seconds = began.elapsed().as_secs();
    assert!(
        store.lists() - lists <= 1 + seconds,
        "{}",
        store.lists() - lists
    );
    assert_eq!(store.looks() - looks, 4, "a read of each reference");
    let reads = store.looks();
    found_at_last(|| async {
        list(&server, "").await;
        store.lists() - lists > 1 + seconds
    })
    .await;
    assert_eq!(
        store.looks(),
        reads,
        "what has not changed is not read again"
    );
    // Publications and removals by others show after a while.
    made::scene(&library, "b", &[asset.clone(), asset.clone()]).await;
    made::scene(&library, "new", &[asset]).await;
    library.remove("a").await.unwrap();
    let now = library.reference("b").await.unwrap();
    found_at_last(|| async {
        let page = list(&server, "").await;
        names(&page) == ["b", "c", "city", "new"] && page.scenes[0].reference == now
    })
    .await;
    server.stop().await;
}

#[tokio::test]
async fn a_removed_scene_is_left_out_and_a_hidden_one_is_an_error() {
    let (store, library, asset) = watched().await;
    made::scene(&library, "a", &[asset]).await;
    let server = Running::start(library.clone()).await;
    assert_eq!(names(&list(&server, "limit=1").await), ["a"]);
    library.remove("city").await.unwrap();
    // Not read before, and listed maybe.
    assert_eq!(names(&list(&server, "").await), ["a"]);
    server.stop().await;
    store.hide("scenes/a");
    let server = Running::start(library).await;
    let answer = client().get(server.url("/v1/scenes")).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::INTERNAL_SERVER_ERROR);
    server.stop().await;
}
