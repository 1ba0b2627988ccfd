//! Every endpoint over real sockets, HTTP/1.1 and HTTP/2 with prior knowledge, over made libraries.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use hyper::service::Service;
use lodestream_format::ContentHash;
use lodestream_format::library::SceneReference;
use lodestream_format::wire::{BlockKind, MEDIA_TYPE, ScenesPage};
use lodestream_server::http::{AppState, router};
use lodestream_server::library::Library;
use reqwest::StatusCode;
use support::made::{self, Made};
use support::server::{Running, blocks, client, client_h2, header, raw};

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

/// The clock stands still but where it is told, so that a look lasts as long as it should.
#[tokio::test(start_paused = true)]
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
    let next_look = || tokio::time::advance(std::time::Duration::from_millis(1001));
    std::fs::remove_dir(&path).unwrap();
    // However many ask, it is looked once a second.
    assert_eq!(ready().await, 200);
    next_look().await;
    assert_eq!(ready().await, 503);
    std::fs::create_dir(&path).unwrap();
    assert_eq!(ready().await, 503);
    next_look().await;
    assert_eq!(ready().await, 200);
    state.drain();
    assert_eq!(ready().await, 503);
}
