//! Models that are put to the built program become scenes: tokens, limits, progress, faults.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Stdio};

use futures_util::StreamExt;
use reqwest::{Response, StatusCode};
use serde_json::Value;
use support::binary::{command, ok};
use support::server::{client, client_h2, header};

const TOKEN: &str = "a-token-of-this-test";

struct Serving {
    child: Child,
    url: String,
    folder: tempfile::TempDir,
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Serving {
    fn start(arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        std::fs::write(path("tokens"), format!("# ours\n{TOKEN}\n")).unwrap();
        std::fs::create_dir(path("scratch")).unwrap();
        // A library that is there: serving makes none.
        std::fs::write(path("base.obj"), sheet(4)).unwrap();
        let library = path("library");
        ok(&[
            "ingest",
            &path("base.obj"),
            "--library",
            &library,
            "--scene",
            "base",
            "-q",
        ]);
        let mut child = command(&["serve", "--library", &library, "--listen", "127.0.0.1:0"])
            .args(["--upload-tokens", &path("tokens")])
            .args(["--upload-scratch", &path("scratch")])
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.as_mut().unwrap())
            .read_line(&mut line)
            .unwrap();
        let url = line
            .trim()
            .strip_prefix("listening on ")
            .unwrap()
            .to_owned();
        Self { child, url, folder }
    }

    async fn put(
        &self,
        path: &str,
        token: Option<&str>,
        body: impl Into<reqwest::Body>,
    ) -> Response {
        let mut request = client().put(format!("{}{path}", self.url)).body(body);
        if let Some(token) = token {
            request = request.bearer_auth(token);
        }
        request.send().await.unwrap()
    }

    /// What lies where models are on their way.
    fn scratch(&self) -> Vec<PathBuf> {
        let files = std::fs::read_dir(self.folder.path().join("scratch")).unwrap();
        files.map(|file| file.unwrap().path()).collect()
    }
}

/// A waved sheet of `2 n n` triangles as .obj.
fn sheet(n: u32) -> String {
    let mut text = String::new();
    for at in 0..(n + 1) * (n + 1) {
        let (x, z) = (at % (n + 1), at / (n + 1));
        text += &format!(
            "v {x} {} {z}\n",
            (0.3 * f64::from(x)).sin() * (0.2 * f64::from(z)).cos()
        );
    }
    for at in (1..=(n + 1) * n).filter(|at| at % (n + 1) != 0) {
        text += &format!(
            "f {at} {} {}\nf {} {} {}\n",
            at + n + 1,
            at + 1,
            at + 1,
            at + n + 1,
            at + n + 2
        );
    }
    text
}

/// Events of an answer, by name.
fn events(text: &str) -> Vec<(String, Value)> {
    let event = |block: &str| {
        let (name, data) = block.split_once('\n')?;
        let name = name.strip_prefix("event: ")?.to_owned();
        Some((
            name,
            serde_json::from_str(data.strip_prefix("data: ")?).ok()?,
        ))
    };
    text.split("\n\n").filter_map(event).collect()
}

#[tokio::test]
async fn a_model_becomes_a_scene_and_says_how_far_it_is() {
    let server = Serving::start(&[]);
    for (client, scene) in [(client(), "first"), (client_h2(), "second")] {
        let url = format!("{}/v1/scenes/{scene}?kind=obj", server.url);
        let put = client.put(url).bearer_auth(TOKEN).body(sheet(100));
        let answer = put.send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::OK);
        assert_eq!(header(&answer, "content-type"), "text/event-stream");
        let events = events(&answer.text().await.unwrap());
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
    assert!(server.scratch().is_empty(), "{:?}", server.scratch());
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
    assert!(server.scratch().is_empty(), "{:?}", server.scratch());
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
