//! Models that are put to the built program become scenes: tokens, limits, progress, faults.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use futures_util::StreamExt;
use reqwest::StatusCode;
use serde_json::Value;
use support::server::{client, client_h2, header};
use support::uploads::{Serving, TOKEN, events, sheet};

#[tokio::test]
async fn a_model_becomes_a_scene_and_says_how_far_it_is() {
    let server = Serving::start(&[]);
    for (client, scene) in [(client(), "first"), (client_h2(), "second")] {
        let url = format!("{}/v1/scenes/{scene}?kind=obj", server.url);
        let shown = || {
            client
                .get(format!("{}/v1/scenes/{scene}", server.url))
                .send()
        };
        assert_eq!(shown().await.unwrap().status(), StatusCode::NOT_FOUND);
        assert!(!scenes(&server).await.to_string().contains(scene));
        let put = client.put(url).bearer_auth(TOKEN).body(sheet(100));
        let answer = put.send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::OK);
        assert_eq!(header(&answer, "content-type"), "text/event-stream");
        let events = events(&answer.text().await.unwrap());
        let list = scenes(&server).await.to_string();
        assert!(list.contains(scene), "at once, whatever was listed before");
        let names: Vec<&str> = events.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(
            (names[0], names[names.len() - 1]),
            ("queued", "done"),
            "{names:?}"
        );
        assert!(
            names[1..names.len() - 1]
                .iter()
                .all(|name| *name == "progress")
        );
        assert_eq!(events[events.len() - 1].1["input_triangles"], 20_000);
        assert_eq!(shown().await.unwrap().status(), StatusCode::OK, "at once");
        if scene == "first" {
            // The second finds what the first built.
            let (_, last) = &events[events.len() - 2];
            assert_eq!(
                (&last["triangles"], &last["of"]),
                (&20_000.into(), &20_000.into())
            );
        }
        let shown = client.get(format!("{}/v1/scenes/{scene}/open", server.url));
        assert_eq!(shown.send().await.unwrap().status(), StatusCode::OK);
    }
    assert_eq!(server.on_their_way(), Vec::<std::path::PathBuf>::new());
}

#[tokio::test]
async fn who_has_no_token_or_sends_what_is_no_model_changes_nothing() {
    let server = Serving::start(&["--upload-bytes", "1MiB", "--upload-triangles", "100"]);
    let before = scenes(&server).await;
    for token in [None, Some("another-token-entirely"), Some("")] {
        let answer = server.put("/v1/scenes/new?kind=obj", token, sheet(4)).await;
        assert_eq!(answer.status(), StatusCode::UNAUTHORIZED, "{token:?}");
        assert_eq!(header(&answer, "www-authenticate"), "Bearer");
    }
    let large = vec![b'v'; 2 << 20];
    let pieces = futures_util::stream::iter(
        large
            .clone()
            .chunks(1000)
            .map(<[u8]>::to_vec)
            .collect::<Vec<_>>(),
    )
    .map(Ok::<_, std::convert::Infallible>);
    for (path, body, status) in [
        (
            "/v1/scenes/new?kind=obj",
            "".into(),
            StatusCode::BAD_REQUEST,
        ),
        (
            "/v1/scenes/..%2fnew",
            sheet(4).into(),
            StatusCode::BAD_REQUEST,
        ),
        (
            "/v1/scenes/new?kind=gltf",
            sheet(4).into(),
            StatusCode::UNSUPPORTED_MEDIA_TYPE,
        ),
        (
            "/v1/scenes/new?kind=obj",
            large.into(),
            StatusCode::PAYLOAD_TOO_LARGE,
        ),
        // Without a length beforehand.
        (
            "/v1/scenes/new?kind=obj",
            reqwest::Body::wrap_stream(pieces),
            StatusCode::PAYLOAD_TOO_LARGE,
        ),
    ] {
        let answer = server.put(path, Some(TOKEN), body).await;
        assert_eq!(answer.status(), status, "{path}");
    }
    for (kind, body, words) in [
        ("glb", "no model".to_owned(), "glTF"),
        ("obj", sheet(8), "at most 100 triangles"),
        ("stl", "solid\n".to_owned(), "model"),
    ] {
        let path = format!("/v1/scenes/new?kind={kind}");
        let answer = server.put(&path, Some(TOKEN), body).await;
        let events = events(&answer.text().await.unwrap());
        let (folder, all) = (
            server.folder.path().to_str().unwrap(),
            format!("{events:?}"),
        );
        assert!(!all.contains(folder), "where things lie stays here: {all}");
        let (name, data) = &events[events.len() - 1];
        assert_eq!(name, "error", "{kind}: {events:?}");
        let said = data["error"].as_str().unwrap();
        assert!(said.contains(words), "{kind}: {said}");
    }
    assert_eq!(scenes(&server).await, before);
    assert_eq!(server.on_their_way(), Vec::<std::path::PathBuf>::new());
}

async fn scenes(server: &Serving) -> Value {
    let list = client().get(format!("{}/v1/scenes", server.url)).send();
    serde_json::from_slice(&list.await.unwrap().bytes().await.unwrap()).unwrap()
}

#[tokio::test]
async fn a_build_that_takes_too_long_is_stopped() {
    let server = Serving::start(&["--upload-secs", "1"]);
    let answer = server
        .put("/v1/scenes/slow?kind=obj", Some(TOKEN), sheet(1500))
        .await;
    let events = events(&answer.text().await.unwrap());
    let (name, data) = &events[events.len() - 1];
    assert_eq!(
        (name.as_str(), &data["error"]),
        ("error", &"not built within 1 s".into())
    );
    let list = scenes(&server).await;
    assert_eq!(list["scenes"].as_array().unwrap().len(), 1);
}

#[tokio::test]
async fn a_server_without_tokens_takes_nothing() {
    let library = lodestream_server::library::Library::open("memory://").unwrap();
    let server = support::server::Running::start(library).await;
    let put = client()
        .put(server.url("/v1/scenes/new"))
        .bearer_auth(TOKEN)
        .body("x");
    assert_eq!(put.send().await.unwrap().status(), StatusCode::FORBIDDEN);
    server.stop().await;
}

#[tokio::test]
async fn a_conditional_upload_replaces_what_it_names_or_nothing() {
    let server = Serving::start(&[]);
    let tag = client()
        .get(format!("{}/v1/scenes/base", server.url))
        .send()
        .await
        .unwrap();
    let tag = header(&tag, "etag").to_owned();
    let put = |scene: &'static str, field: &'static str, value: String, body: Vec<u8>| {
        let request = client().put(format!("{}/v1/scenes/{scene}?kind=obj", server.url));
        request
            .bearer_auth(TOKEN)
            .header(field, value)
            .body(body)
            .send()
    };
    let sheets = |size| sheet(size).into_bytes();
    let taken = put("base", "if-none-match", "*".to_owned(), sheets(5))
        .await
        .unwrap();
    assert_eq!(taken.status(), StatusCode::PRECONDITION_FAILED);
    assert!(
        taken
            .text()
            .await
            .unwrap()
            .contains("scene base: expected to replace none, found")
    );
    let wrong = put("base", "if-match", "\"x\"".to_owned(), sheets(5))
        .await
        .unwrap();
    assert_eq!(wrong.status(), StatusCode::PRECONDITION_FAILED);
    let first = put("base", "if-match", tag.clone(), sheets(6))
        .await
        .unwrap();
    assert_eq!(first.status(), StatusCode::OK);
    assert!(first.text().await.unwrap().contains("event: done"));
    // The tag is that of the scene before.
    let late = put("base", "if-match", tag, sheets(7)).await.unwrap();
    assert_eq!(late.status(), StatusCode::PRECONDITION_FAILED);
    let new = put("new", "if-none-match", "*".to_owned(), sheets(5))
        .await
        .unwrap();
    assert!(new.text().await.unwrap().contains("event: done"));
}
