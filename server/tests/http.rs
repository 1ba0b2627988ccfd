//! Every endpoint over real sockets, HTTP/1.1 and HTTP/2 with prior knowledge, over made libraries.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use futures_util::StreamExt;
use hyper::service::Service;
use lodestream_format::ContentHash;
use lodestream_format::library::SceneReference;
use lodestream_format::wire::{BlockKind, MEDIA_TYPE, PageStatus, PageWant, PagesPost, ScenesPage};
use lodestream_server::http::{AppState, router};
use lodestream_server::library::Library;
use reqwest::{Response, StatusCode};
use support::made::{self, Made};
use support::server::{Running, blocks, client, client_h2, raw};

const IMMUTABLE: &str = "public, max-age=31536000, immutable";

async fn library() -> (Library, Vec<Made>) {
    let library = Library::open("memory://").unwrap();
    let assets = vec![
        made::asset(&library, 1, 12, 40_000).await,
        made::asset(&library, 2, 3, 1000).await,
    ];
    made::scene(&library, "city", &assets).await;
    (library, assets)
}

fn header<'a>(response: &'a Response, name: &str) -> &'a str {
    response
        .headers()
        .get(name)
        .map_or("", |value| value.to_str().unwrap())
}

#[tokio::test]
async fn scenes_are_listed_shown_and_revalidated() {
    let (library, assets) = library().await;
    made::scene(&library, "alp", &assets[..1]).await;
    let server = Running::start(library.clone()).await;
    for client in [client(), client_h2()] {
        let list = client
            .get(server.url("/v1/scenes?limit=1"))
            .send()
            .await
            .unwrap();
        assert_eq!(header(&list, "content-type"), "application/json");
        assert_eq!(header(&list, "cache-control"), "no-cache");
        let page: ScenesPage = serde_json::from_slice(&list.bytes().await.unwrap()).unwrap();
        assert_eq!(
            (page.scenes.len(), page.scenes[0].name.as_str()),
            (1, "alp")
        );
        let next = format!("/v1/scenes?limit=1&after={}", page.next.unwrap());
        let list = client.get(server.url(&next)).send().await.unwrap();
        let page: ScenesPage = serde_json::from_slice(&list.bytes().await.unwrap()).unwrap();
        assert_eq!((page.scenes[0].name.as_str(), page.next), ("city", None));

        let show = client
            .get(server.url("/v1/scenes/city"))
            .send()
            .await
            .unwrap();
        assert_eq!(header(&show, "content-type"), "application/json");
        assert_eq!(header(&show, "cache-control"), "no-cache");
        assert_eq!(header(&show, "access-control-allow-origin"), "*");
        let tag = header(&show, "etag").to_owned();
        let reference: SceneReference =
            serde_json::from_slice(&show.bytes().await.unwrap()).unwrap();
        assert_eq!(reference, library.reference("city").await.unwrap());
        let held = client
            .get(server.url("/v1/scenes/city"))
            .header("if-none-match", &tag);
        let held = held.send().await.unwrap();
        assert_eq!(
            (held.status(), header(&held, "etag")),
            (StatusCode::NOT_MODIFIED, &tag[..])
        );
        for bad in ["limit=0", "limit=1001", "limit=x"] {
            let url = server.url(&format!("/v1/scenes?{bad}"));
            let status = client.get(url).send().await.unwrap().status();
            assert_eq!(status, StatusCode::BAD_REQUEST, "{bad}");
        }
        let none = client
            .get(server.url("/v1/scenes/none"))
            .send()
            .await
            .unwrap();
        assert_eq!(none.status(), StatusCode::NOT_FOUND);
    }
    let before = client()
        .get(server.url("/v1/scenes/city"))
        .send()
        .await
        .unwrap();
    let tag = header(&before, "etag").to_owned();
    made::scene(&library, "city", &assets[1..]).await;
    let request = client()
        .get(server.url("/v1/scenes/city"))
        .header("if-none-match", tag);
    assert_eq!(
        request.send().await.unwrap().status(),
        StatusCode::OK,
        "swapped"
    );
    server.stop().await;
}

#[tokio::test]
async fn open_gives_scene_assets_hierarchies_and_root_pages_in_one_answer() {
    let (library, assets) = library().await;
    // The same asset twice in a scene crosses once.
    let twice = [assets[0].clone(), assets[1].clone(), assets[0].clone()];
    let scene = made::scene(&library, "city", &twice).await;
    let server = Running::start(library.clone()).await;
    for client in [client(), client_h2()] {
        let open = client
            .get(server.url("/v1/scenes/city/open"))
            .send()
            .await
            .unwrap();
        assert_eq!(header(&open, "content-type"), MEDIA_TYPE);
        assert_eq!(header(&open, "etag"), format!("\"{scene}\""));
        let (blocks, ended) = blocks(&open.bytes().await.unwrap());
        assert!(ended);
        let mut expected = vec![(
            BlockKind::Scene,
            scene,
            library.object(&scene).await.unwrap(),
        )];
        for made in &assets {
            let roots = made.asset.pages[made.asset.root_page_count as usize].offset;
            let object = library.object(&made.hash).await.unwrap();
            expected.push((BlockKind::Asset, made.hash, object));
            expected.push((
                BlockKind::Hierarchy,
                made.asset.hierarchy,
                made.hierarchy.clone(),
            ));
            expected.push((
                BlockKind::RootPages,
                made.hash,
                made.pack.slice(..roots as usize),
            ));
        }
        let found: Vec<_> = blocks
            .into_iter()
            .map(|b| (b.kind, b.hash, b.payload.into()))
            .collect();
        assert!(found == expected);
        let held = client.get(server.url("/v1/scenes/city/open"));
        let held = held
            .header("if-none-match", format!("\"{scene}\""))
            .send()
            .await
            .unwrap();
        assert_eq!(held.status(), StatusCode::NOT_MODIFIED);
    }
    let none = client()
        .get(server.url("/v1/scenes/none/open"))
        .send()
        .await
        .unwrap();
    assert_eq!(none.status(), StatusCode::NOT_FOUND);
    server.stop().await;
}

#[tokio::test]
async fn objects_are_immutable_and_come_in_ranges() {
    let (library, assets) = library().await;
    let large = bytes::Bytes::from(made::noise(9, 9_000_001));
    let large_hash = made::put(&library, large.clone()).await;
    let server = Running::start(library.clone()).await;
    for client in [client(), client_h2()] {
        for (hash, bytes) in [
            (assets[0].asset.pack, &assets[0].pack),
            (large_hash, &large),
        ] {
            let url = server.url(&format!("/v1/objects/{hash}"));
            let whole = client.get(&url).send().await.unwrap();
            assert_eq!(whole.status(), StatusCode::OK);
            assert_eq!(header(&whole, "cache-control"), IMMUTABLE);
            assert_eq!(header(&whole, "etag"), format!("\"{hash}\""));
            assert_eq!(whole.content_length(), Some(bytes.len() as u64));
            assert!(whole.bytes().await.unwrap() == bytes);
            let head = client.head(&url).send().await.unwrap();
            assert_eq!(header(&head, "content-length"), bytes.len().to_string());
            let part = client
                .get(&url)
                .header("range", "bytes=100-1099")
                .send()
                .await
                .unwrap();
            assert_eq!(part.status(), StatusCode::PARTIAL_CONTENT);
            let range = format!("bytes 100-1099/{}", bytes.len());
            assert_eq!(header(&part, "content-range"), range);
            assert!(part.bytes().await.unwrap() == bytes.slice(100..1100));
            let past = format!("bytes={}-", bytes.len());
            let past = client.get(&url).header("range", past).send().await.unwrap();
            assert_eq!(past.status(), StatusCode::RANGE_NOT_SATISFIABLE);
            let many = client
                .get(&url)
                .header("range", "bytes=0-1,4-5")
                .send()
                .await
                .unwrap();
            assert_eq!(
                (many.status(), many.content_length()),
                (StatusCode::OK, Some(bytes.len() as u64))
            );
            let held = client
                .get(&url)
                .header("if-none-match", format!("\"{hash}\""));
            assert_eq!(
                held.send().await.unwrap().status(),
                StatusCode::NOT_MODIFIED
            );
        }
    }
    let unknown = ContentHash::of(b"unknown");
    let none = client()
        .get(server.url(&format!("/v1/objects/{unknown}")))
        .send()
        .await
        .unwrap();
    assert_eq!(none.status(), StatusCode::NOT_FOUND);
    assert_ne!(
        header(&none, "cache-control"),
        IMMUTABLE,
        "a 404 is not kept"
    );
    server.stop().await;
}

#[tokio::test]
async fn page_ranges_are_the_bytes_of_the_pack() {
    let (library, assets) = library().await;
    let server = Running::start(library).await;
    let made = &assets[0];
    for client in [client(), client_h2()] {
        for (first, last) in [(0u32, 0u32), (3, 7), (0, 11), (11, 11)] {
            let url = server.url(&format!("/v1/assets/{}/pages/{first}-{last}", made.hash));
            let pages = client.get(&url).send().await.unwrap();
            assert_eq!(
                pages.status(),
                StatusCode::OK,
                "200: caches do not keep 206"
            );
            assert_eq!(header(&pages, "cache-control"), IMMUTABLE);
            let tag = header(&pages, "etag").to_owned();
            let expected: Vec<u8> = (first..=last)
                .flat_map(|page| made.frame(page).to_vec())
                .collect();
            assert_eq!(pages.content_length(), Some(expected.len() as u64));
            assert!(pages.bytes().await.unwrap() == expected);
            let held = client
                .get(&url)
                .header("if-none-match", tag)
                .send()
                .await
                .unwrap();
            assert_eq!(held.status(), StatusCode::NOT_MODIFIED);
        }
        for (range, status) in [
            ("0-12", 404),
            ("12-12", 404),
            ("3-2", 400),
            ("a-b", 400),
            ("00-1", 400),
            ("1", 400),
            ("0-4294967296", 400),
        ] {
            let url = server.url(&format!("/v1/assets/{}/pages/{range}", made.hash));
            assert_eq!(
                client.get(url).send().await.unwrap().status(),
                status,
                "{range}"
            );
        }
        let unknown = ContentHash::of(b"unknown");
        let url = server.url(&format!("/v1/assets/{unknown}/pages/0-0"));
        assert_eq!(client.get(url).send().await.unwrap().status(), 404);
        // A pack is no asset.
        let url = server.url(&format!("/v1/assets/{}/pages/0-0", made.asset.pack));
        assert_eq!(client.get(url).send().await.unwrap().status(), 500);
    }
    server.stop().await;
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

#[tokio::test]
async fn no_path_leaves_the_library() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("secret"), "TOP-SECRET").unwrap();
    let inside = folder.path().join("library");
    let library = Library::open_or_create(inside.to_str().unwrap()).unwrap();
    let made = made::asset(&library, 4, 3, 1000).await;
    made::scene(&library, "city", std::slice::from_ref(&made)).await;
    std::fs::write(inside.join("scenes").join(".hidden"), "TOP-SECRET").unwrap();
    std::fs::write(inside.join("plain"), "TOP-SECRET").unwrap();
    let server = Running::start(library).await;
    let upper = made.hash.to_string().to_uppercase();
    let long = format!("{}{}", made.hash, "00");
    let slashes = lodestream_format::library::object_path(&made.hash).replace('/', "%2f");
    for path in [
        "/v1/scenes/..%2f..%2fsecret",
        "/v1/scenes/..%2fplain",
        "/v1/scenes/..%2Fplain/open",
        "/v1/scenes/%2e%2e%2f%2e%2e%2fsecret",
        "/v1/scenes/../../secret",
        "/v1/scenes/..",
        "/v1/scenes/.",
        "/v1/scenes/.hidden",
        "/v1/scenes/%2ehidden",
        "/v1/scenes/..%5c..%5csecret",
        "/v1/scenes/%2fetc%2fpasswd",
        "/v1/scenes//etc/passwd",
        "/v1/scenes/city%00",
        "/v1/scenes/%ff%fe",
        "/v1/scenes/city%2f..%2fcity",
        "/v1/objects/..%2f..%2fsecret",
        "/v1/objects/..%2fplain",
        &format!("/v1/objects/{upper}"),
        &format!("/v1/objects/{long}"),
        &format!("/v1/objects/{slashes}"),
        &format!("/v1/objects/{}%00", made.hash),
        &format!("/v1/objects/{}/", made.hash),
        "/v1/assets/..%2f..%2fsecret/pages/0-0",
        &format!("/v1/assets/{}/pages/..%2f0-0", made.hash),
        &format!("/v1/assets/{}/pages/0-0%2f..", made.hash),
        "/../../secret",
        "/..%2f..%2fsecret",
        "/secret",
        "/",
        "//",
    ] {
        let (status, answer) = raw(server.address, &format!("GET {path} HTTP/1.1")).await;
        assert!((400..405).contains(&status), "{path}: {status}");
        assert!(!answer.contains("TOP-SECRET"), "{path}");
    }
    let (status, _) = raw(server.address, "GET /v1/scenes/city HTTP/1.1").await;
    assert_eq!(status, 200, "the server still answers");
    server.stop().await;
}

#[tokio::test]
async fn health_metrics_and_content_types() {
    let (library, _) = library().await;
    let server = Running::start(library).await;
    let client = client();
    for (path, status, kind) in [
        ("/healthz", 200, "text/plain; charset=utf-8"),
        ("/readyz", 200, "text/plain; charset=utf-8"),
        ("/v1/scenes", 200, "application/json"),
        ("/v1/scenes/city", 200, "application/json"),
        ("/v1/scenes/none", 404, "text/plain; charset=utf-8"),
        ("/v1/scenes/none/open", 404, "text/plain; charset=utf-8"),
        ("/v1/objects/xyz", 400, "text/plain; charset=utf-8"),
        ("/v1/pages", 405, "text/plain; charset=utf-8"),
        ("/nothing", 404, "text/plain; charset=utf-8"),
        ("/metrics", 200, "text/plain; version=0.0.4; charset=utf-8"),
    ] {
        let answer = client.get(server.url(path)).send().await.unwrap();
        assert_eq!(answer.status(), status, "{path}");
        assert_eq!(header(&answer, "content-type"), kind, "{path}");
        assert_eq!(
            header(&answer, "access-control-allow-origin"),
            "*",
            "{path}"
        );
    }
    let options = client.request(reqwest::Method::OPTIONS, server.url("/v1/pages"));
    let options = options.send().await.unwrap();
    assert_eq!(options.status(), 204);
    assert!(header(&options, "access-control-allow-methods").contains("POST"));
    let metrics = client
        .get(server.url("/metrics"))
        .send()
        .await
        .unwrap()
        .text()
        .await
        .unwrap();
    for line in [
        r#"lodestream_requests_total{route="/healthz",status="200"} 1"#,
        r#"lodestream_requests_total{route="/v1/scenes/{scene}",status="404"} 1"#,
        r#"lodestream_requests_total{route="none",status="404"} 1"#,
        r#"lodestream_request_seconds_count{route="/v1/scenes"} 1"#,
        r#"lodestream_request_seconds_bucket{route="/v1/scenes",le="+Inf"} 1"#,
        r#"lodestream_response_bytes_total{route="/healthz"} 3"#,
        "lodestream_requests_in_flight 1",
    ] {
        assert!(
            metrics.lines().any(|found| found == line),
            "{line}\n{metrics}"
        );
    }
    server.stop().await;
}

#[tokio::test]
async fn readiness_follows_the_store_and_the_shutdown() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("library");
    let library = Library::open_or_create(path.to_str().unwrap()).unwrap();
    let state = AppState::new(library, 1 << 20);
    // Without a socket.
    let service = hyper_util::service::TowerToHyperService::new(router(state.clone()));
    let ready = || async {
        let request = hyper::Request::get("/readyz")
            .body(axum::body::Body::empty())
            .unwrap();
        service.call(request).await.unwrap().status().as_u16()
    };
    assert_eq!(ready().await, 200);
    std::fs::remove_dir(&path).unwrap();
    assert_eq!(ready().await, 503);
    std::fs::create_dir(&path).unwrap();
    assert_eq!(ready().await, 200);
    state.drain();
    assert_eq!(ready().await, 503);
}
