//! `POST /v1/pages`: order, statuses, superseding, broken connections, damaged packs.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use futures_util::StreamExt;
use lodestream_format::ContentHash;
use lodestream_format::wire::{BlockKind, MEDIA_TYPE, PageStatus, PageWant, PagesPost};
use lodestream_server::library::Library;
use reqwest::{Response, StatusCode};
use support::made::{self, Made};
use support::server::{Running, blocks, client, client_h2, header};

/// An asset of twelve pages and one of three.
async fn library() -> (Library, Vec<Made>) {
    let library = Library::open("memory://").unwrap();
    let assets = vec![
        made::asset(&library, 1, 12, 40_000).await,
        made::asset(&library, 2, 3, 1000).await,
    ];
    (library, assets)
}

fn want(made: &Made, first: u32, last: u32, priority: f32) -> PageWant {
    PageWant {
        asset: made.hash,
        first,
        last,
        priority,
    }
}

async fn post(client: &reqwest::Client, server: &Running, post: &PagesPost) -> Response {
    let body = serde_json::to_vec(post).unwrap();
    let request = client.post(server.url("/v1/pages")).body(body);
    request.send().await.unwrap()
}

#[tokio::test]
async fn posted_pages_stream_back_most_urgent_first_each_with_its_status() {
    let (library, assets) = library().await;
    let server = Running::start(library).await;
    let unknown = ContentHash::of(b"unknown");
    let mut wants = vec![
        want(&assets[0], 4, 6, 2.0),
        want(&assets[1], 0, 3, 8.0),
        want(&assets[0], 6, 8, 5.0),
        want(&assets[0], 0, 0, 3.0),
    ];
    wants.push(PageWant {
        asset: unknown,
        first: 1,
        last: 2,
        priority: 6.0,
    });
    for (index, client) in [client(), client_h2()].into_iter().enumerate() {
        let body = PagesPost {
            viewer: index as u64,
            sequence: 1,
            wants: wants.clone(),
        };
        let answer = post(&client, &server, &body).await;
        assert_eq!(answer.status(), StatusCode::OK);
        assert_eq!(header(&answer, "content-type"), MEDIA_TYPE);
        let (blocks, ended) = blocks(&answer.bytes().await.unwrap());
        assert!(ended);
        let order: Vec<_> = blocks.iter().map(|b| (b.hash, b.page, b.status)).collect();
        use PageStatus::{NotFound, Ok};
        let (a, b) = (assets[0].hash, assets[1].hash);
        let expected = [
            (b, 0, Ok),
            (b, 1, Ok),
            (b, 2, Ok),
            (b, 3, NotFound),
            (unknown, 1, NotFound),
            (unknown, 2, NotFound),
            (a, 6, Ok),
            (a, 7, Ok),
            (a, 8, Ok),
            (a, 0, Ok),
            (a, 4, Ok),
            (a, 5, Ok),
        ];
        assert_eq!(order, expected);
        for block in &blocks {
            assert_eq!(block.kind, BlockKind::Page);
            let made = assets.iter().find(|made| made.hash == block.hash);
            let frame = made
                .filter(|_| block.status == Ok)
                .map_or(&[][..], |made| made.frame(block.page));
            assert!(block.payload == frame, "page {}", block.page);
        }
    }
    server.stop().await;
}

#[tokio::test]
async fn wrong_posts_are_refused() {
    let (library, assets) = library().await;
    let server = Running::start(library).await;
    let client = client();
    let url = server.url("/v1/pages");
    let asset = assets[0].hash;
    let want = |range: &str| {
        format!(r#"{{"viewer":1,"sequence":1,"wants":[{{"asset":"{asset}",{range}}}]}}"#)
    };
    for (body, status) in [
        ("".to_owned(), 400),
        ("{}".to_owned(), 400),
        (want(r#""first":2,"last":1,"priority":1"#), 400),
        (want(r#""first":0,"last":0,"priority":1e39"#), 400),
        (want(r#""first":0,"last":-1,"priority":1"#), 400),
        (want(r#""first":0,"last":65536,"priority":1"#), 413),
        (want(r#""first":0,"last":4294967295,"priority":1"#), 413),
        (" ".repeat(17 << 20), 413),
        (
            want(r#""first":0,"last":0,"priority":1"#).replace(&asset.to_string(), "../x"),
            400,
        ),
    ] {
        let begin = body.chars().take(90).collect::<String>();
        let answer = client.post(&url).body(body).send().await.unwrap();
        assert_eq!(answer.status(), status, "{begin}");
        assert_eq!(header(&answer, "content-type"), "text/plain; charset=utf-8");
    }
    assert_eq!(client.get(&url).send().await.unwrap().status(), 405);
    server.stop().await;
}

/// 40 MB, far more than the sockets between hold.
async fn big() -> (Library, Made) {
    let library = Library::open("memory://").unwrap();
    let made = made::asset(&library, 5, 1000, 40_000).await;
    (library, made)
}

#[tokio::test]
async fn a_later_post_ends_what_the_earlier_has_not_sent() {
    let (library, made) = big().await;
    let server = Running::start(library).await;
    let all = |viewer, sequence| PagesPost {
        viewer,
        sequence,
        wants: vec![want(&made, 0, 999, 1.0)],
    };
    let none = |viewer, sequence| PagesPost {
        wants: vec![],
        ..all(viewer, sequence)
    };
    for (viewer, client) in [(1, client()), (2, client_h2())] {
        let first = post(&client, &server, &all(viewer, 5)).await;
        // Other viewers and older posts change nothing; the newer one ends it.
        let older = post(&client, &server, &all(viewer, 4)).await;
        assert_eq!(blocks(&older.bytes().await.unwrap()), (vec![], true));
        post(&client, &server, &none(viewer + 10, 9)).await;
        let newer = post(&client, &server, &none(viewer, 6)).await;
        assert_eq!(blocks(&newer.bytes().await.unwrap()), (vec![], true));
        let (got, ended) = blocks(&first.bytes().await.unwrap());
        assert!(ended, "ended by its end block, not cut");
        assert!(got.len() < 900, "{} of 1000 pages came", got.len());
        for (page, block) in got.iter().enumerate() {
            assert!(block.page == page as u32 && block.payload == made.frame(block.page));
        }
    }
    let whole = post(&client(), &server, &all(3, 1)).await;
    let (got, ended) = blocks(&whole.bytes().await.unwrap());
    assert!(ended && got.len() == 1000, "nobody superseded it");
    server.stop().await;
}

#[tokio::test]
async fn a_broken_connection_ends_the_work() {
    let (library, made) = big().await;
    let server = Running::start(library).await;
    let (client, h2) = (client(), client_h2());
    for (viewer, client) in [(1, &client), (2, &h2)] {
        let wants = vec![want(&made, 0, 999, 1.0)];
        let post = PagesPost {
            viewer,
            sequence: 1,
            wants,
        };
        let answer = self::post(client, &server, &post).await;
        let mut body = answer.bytes_stream();
        body.next().await.unwrap().unwrap();
        drop(body);
    }
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(10);
    loop {
        let metrics = client.get(server.url("/metrics")).send().await.unwrap();
        let text = metrics.text().await.unwrap();
        // This request for the metrics itself is in flight.
        if text.contains("\nlodestream_requests_in_flight 1\n") {
            let sent = value(&text, "lodestream_pages_sent_total");
            assert!(sent < 1900.0, "{sent} pages were read for nobody");
            break;
        }
        assert!(std::time::Instant::now() < deadline, "{text}");
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    }
    server.stop().await;
}

fn value(metrics: &str, name: &str) -> f64 {
    let line = metrics.lines().find_map(|line| line.strip_prefix(name));
    line.and_then(|value| value.trim().parse().ok())
        .unwrap_or_else(|| panic!("no {name} in {metrics}"))
}

#[tokio::test]
async fn a_pack_that_ends_early_fails_its_last_pages_only() {
    let folder = tempfile::tempdir().unwrap();
    let library = Library::open(folder.path().to_str().unwrap()).unwrap();
    let made = made::asset(&library, 4, 10, 1000).await;
    made::scene(&library, "city", std::slice::from_ref(&made)).await;
    let path = folder
        .path()
        .join(lodestream_format::library::object_path(&made.asset.pack));
    let keep = made.asset.pages[6].offset as usize + 10;
    std::fs::write(&path, &made.pack[..keep]).unwrap();
    let server = Running::start(library).await;
    let client = client();
    let wants = vec![want(&made, 0, 9, 1.0)];
    let answer = post(
        &client,
        &server,
        &PagesPost {
            viewer: 1,
            sequence: 1,
            wants,
        },
    )
    .await;
    let (blocks, ended) = blocks(&answer.bytes().await.unwrap());
    assert!(ended && blocks.len() == 10);
    for block in blocks {
        let (status, frame) = match block.page {
            0..6 => (PageStatus::Ok, made.frame(block.page)),
            _ => (PageStatus::Failed, &[][..]),
        };
        assert!(
            block.status == status && block.payload == frame,
            "page {}",
            block.page
        );
    }
    let url = |range| server.url(&format!("/v1/assets/{}/pages/{range}", made.hash));
    assert_eq!(client.get(url("0-5")).send().await.unwrap().status(), 200);
    let cut = client.get(url("0-9")).send().await.unwrap();
    assert_eq!(cut.status(), StatusCode::INTERNAL_SERVER_ERROR);
    let text = cut.text().await.unwrap();
    assert!(
        !text.contains(folder.path().to_str().unwrap()),
        "no folders of the server: {text}"
    );
    let object = server.url(&format!("/v1/objects/{}", made.asset.pack));
    assert_eq!(client.get(object).send().await.unwrap().status(), 500);
    server.stop().await;
}
