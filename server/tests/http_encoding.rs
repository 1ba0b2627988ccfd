//! What is not compressed in the library is on the way, for those who take it; nobody else notices.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use bytes::Bytes;
use lodestream_server::library::Library;
use reqwest::{Client, Response, StatusCode};
use support::made;
use support::server::{Running, client, client_h2, header};

async fn get(client: &Client, url: &str, fields: &[(&str, &str)]) -> Response {
    let request = client.get(url);
    let request = fields.iter().fold(request, |request, (name, value)| {
        request.header(*name, *value)
    });
    request.send().await.unwrap()
}

const ZSTD: (&str, &str) = ("accept-encoding", "gzip, zstd");

#[tokio::test]
async fn a_scene_opens_compressed_to_the_same_bytes() {
    let library = Library::open("memory://").unwrap();
    let assets = [
        made::asset(&library, 1, 12, 40_000).await,
        made::asset(&library, 2, 3, 1000).await,
    ];
    let scene = made::scene(&library, "city", &assets).await;
    let server = Running::start(library).await;
    let url = server.url("/v1/scenes/city/open");
    for client in [client(), client_h2()] {
        let plain = get(&client, &url, &[]).await;
        assert_eq!(header(&plain, "content-encoding"), "");
        assert_eq!(header(&plain, "vary"), "accept-encoding");
        let plain = plain.bytes().await.unwrap();
        // The second time it is in memory.
        for _ in 0..2 {
            let packed = get(&client, &url, &[ZSTD]).await;
            assert_eq!(header(&packed, "content-encoding"), "zstd");
            assert_eq!(header(&packed, "vary"), "accept-encoding");
            let tag = header(&packed, "etag").to_owned();
            assert_eq!(tag, format!("W/\"{scene}\""));
            let packed = packed.bytes().await.unwrap();
            assert!(zstd::stream::decode_all(&packed[..]).unwrap() == plain);
            let held = get(&client, &url, &[ZSTD, ("if-none-match", &tag)]).await;
            assert_eq!(held.status(), StatusCode::NOT_MODIFIED);
        }
    }
    server.stop().await;
}

#[tokio::test]
async fn hierarchies_come_compressed_and_packs_and_ranges_as_they_are() {
    let library = Library::open("memory://").unwrap();
    let pack = made::asset(&library, 1, 12, 40_000).await.pack;
    let hierarchy: Bytes = b"LSH1".iter().copied().cycle().take(100_000).collect();
    let pack_hash = made::put(&library, pack.clone()).await;
    let hash = made::put(&library, hierarchy.clone()).await;
    let server = Running::start(library).await;
    let url = server.url(&format!("/v1/objects/{hash}"));
    for client in [client(), client_h2()] {
        for _ in 0..2 {
            let packed = get(&client, &url, &[ZSTD]).await;
            assert_eq!(header(&packed, "content-encoding"), "zstd");
            assert_eq!(header(&packed, "etag"), format!("W/\"{hash}\""));
            let length = header(&packed, "content-length").to_owned();
            let bytes = packed.bytes().await.unwrap();
            assert_eq!(length, bytes.len().to_string());
            assert!(bytes.len() < hierarchy.len() / 10);
            assert!(zstd::stream::decode_all(&bytes[..]).unwrap() == hierarchy);
            let head = client.head(&url).header(ZSTD.0, ZSTD.1).send().await;
            assert_eq!(header(&head.unwrap(), "content-length"), length);
        }
        for fields in [&[][..], &[("accept-encoding", "gzip, zstd;q=0")]] {
            let plain = get(&client, &url, fields).await;
            assert_eq!(header(&plain, "content-encoding"), "");
            assert_eq!(header(&plain, "vary"), "accept-encoding");
            assert!(plain.bytes().await.unwrap() == hierarchy);
        }
        let part = get(&client, &url, &[ZSTD, ("range", "bytes=1-5")]).await;
        assert_eq!(part.status(), StatusCode::PARTIAL_CONTENT);
        assert!(part.bytes().await.unwrap() == hierarchy.slice(1..6));
        let url = server.url(&format!("/v1/objects/{pack_hash}"));
        let plain = get(&client, &url, &[ZSTD]).await;
        assert_eq!(header(&plain, "content-encoding"), "");
        assert!(plain.bytes().await.unwrap() == pack);
    }
    server.stop().await;
}

#[tokio::test]
async fn long_texts_come_by_gzip() {
    let server = Running::start(Library::open("memory://").unwrap()).await;
    for client in [client(), client_h2()] {
        for (path, is_long) in [
            ("/v1/openapi.json", true),
            ("/metrics", true),
            ("/healthz", false),
        ] {
            let url = server.url(path);
            let packed = get(&client, &url, &[("accept-encoding", "gzip")]).await;
            let encoding = if is_long { "gzip" } else { "" };
            assert_eq!(header(&packed, "content-encoding"), encoding, "{path}");
            let packed = packed.bytes().await.unwrap();
            let plain = get(&client, &url, &[]).await;
            assert_eq!(header(&plain, "content-encoding"), "", "{path}");
            let plain = plain.bytes().await.unwrap();
            if is_long {
                assert_eq!(packed[..2], [0x1f, 0x8b], "{path}");
                assert!(packed.len() < plain.len() / 2, "{path}");
            }
        }
    }
    server.stop().await;
}
