//! Tokens of readers and uploaders, and the answers about protected scenes.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::path::{Path, PathBuf};

use lodestream_server::http::StateOptions;
use lodestream_server::http::tokens::Tokens;
use lodestream_server::http::uploads::{UploadOptions, UploadsFolder};
use lodestream_server::library::Library;
use reqwest::{Method, Response, StatusCode};
use support::made;
use support::server::{Running, client, header};

const READER: &str = "reader-of-the-secret";
const WRITER: &str = "writer-of-the-secret";
const BOTH: &str = "reader-and-writer-of-it";
const ANYWHERE: &str = "writer-without-scenes";

struct Served {
    server: Running,
    /// Of the scene that is protected.
    hash: String,
    _folder: tempfile::TempDir,
}

fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let file = folder.join(name);
    std::fs::write(&file, text).unwrap();
    file
}

/// The scenes `open` and `secret-a`; uploads that no program builds.
async fn served() -> Served {
    let library = Library::open("memory://").unwrap();
    let asset = made::asset(&library, 1, 3, 1000).await;
    made::scene(&library, "open", std::slice::from_ref(&asset)).await;
    let hash = made::scene(&library, "secret-a", &[asset.clone(), asset]).await;
    let folder = tempfile::tempdir().unwrap();
    let readers = format!("{READER} secret-*\n{BOTH} secret-*\n");
    let readers = write(folder.path(), "readers", &readers);
    let uploaders = format!("{WRITER} secret-*\n{BOTH} secret-*\n{ANYWHERE}\n");
    let uploaders = write(folder.path(), "uploaders", &uploaders);
    let uploads = UploadOptions {
        tokens: Tokens::from_upload_file(&uploaders).unwrap(),
        program: PathBuf::from("/nowhere/lodestream-server"),
        library: "memory://".to_owned(),
        folder: UploadsFolder::new(folder.path()).unwrap(),
        confined: false,
        max_bytes: 64,
        max_triangles: 1,
        max_secs: 1,
        memory_bytes: 1 << 20,
    };
    let options = StateOptions {
        uploads: Some(uploads),
        readers: Some(Tokens::from_read_file(&readers).unwrap()),
        ..StateOptions::default()
    };
    Served {
        server: Running::start_with(library, options).await,
        hash: hash.to_string(),
        _folder: folder,
    }
}

impl Served {
    async fn ask(
        &self,
        method: Method,
        path: &str,
        token: Option<&str>,
        field: Option<(&str, &str)>,
    ) -> Response {
        let mut request = client().request(method, self.server.url(path));
        if let Some(token) = token {
            request = request.bearer_auth(token);
        }
        if let Some((name, value)) = field {
            request = request.header(name, value);
        }
        request.send().await.unwrap()
    }
}

fn varies(answer: &Response) -> bool {
    let fields = answer.headers().get_all("vary").iter();
    let mut fields = fields.flat_map(|field| field.to_str().unwrap().split(','));
    fields.any(|field| field.trim().eq_ignore_ascii_case("authorization"))
}

#[tokio::test]
async fn protected_answers_are_kept_by_no_shared_cache() {
    let served = served().await;
    for method in [Method::GET, Method::HEAD] {
        for path in [
            "/v1/scenes/secret-a",
            "/v1/scenes/secret-a/open",
            "/v1/scenes",
        ] {
            let answer = served.ask(method.clone(), path, Some(READER), None).await;
            assert_eq!(answer.status(), StatusCode::OK, "{path}");
            assert_eq!(
                header(&answer, "cache-control"),
                "private, no-cache",
                "{path}"
            );
            assert!(varies(&answer), "{path}: {:?}", answer.headers());
            let tag = header(&answer, "etag").to_owned();
            if tag.is_empty() {
                continue;
            }
            let field = Some(("if-none-match", &*tag));
            let held = served.ask(method.clone(), path, Some(READER), field).await;
            assert_eq!(held.status(), StatusCode::NOT_MODIFIED, "{path}");
            assert_eq!(
                header(&held, "cache-control"),
                "private, no-cache",
                "{path}"
            );
            assert!(varies(&held), "{path}");
            // The tag without the token tells nothing.
            for tag in [&*tag, "*"] {
                let field = Some(("if-none-match", tag));
                let refused = served.ask(method.clone(), path, None, field).await;
                assert_eq!(refused.status(), StatusCode::UNAUTHORIZED, "{path}");
                assert_eq!(header(&refused, "etag"), "", "{path}");
            }
        }
        for path in ["/v1/scenes/open", "/v1/scenes/open/open"] {
            let answer = served.ask(method.clone(), path, None, None).await;
            assert_eq!(header(&answer, "cache-control"), "no-cache", "{path}");
            assert!(!varies(&answer), "{path}");
        }
    }
    served.server.stop().await;
}

#[tokio::test]
async fn without_the_token_neither_name_nor_hash_is_told() {
    let served = served().await;
    let mut texts = vec![];
    for path in [
        "/v1/scenes/secret-a",
        "/v1/scenes/secret-none",
        "/v1/scenes/SECRET-a/open",
    ] {
        for token in [None, Some(WRITER), Some(ANYWHERE)] {
            let answer = served.ask(Method::GET, path, token, None).await;
            assert_eq!(answer.status(), StatusCode::UNAUTHORIZED, "{path}");
            assert_eq!(header(&answer, "cache-control"), "no-store", "{path}");
            texts.push(answer.text().await.unwrap());
        }
    }
    texts.dedup();
    assert_eq!(texts.len(), 1, "{texts:?}");
    for (token, sees) in [(None, false), (Some(WRITER), false), (Some(READER), true)] {
        let list = served.ask(Method::GET, "/v1/scenes", token, None).await;
        let list = list.text().await.unwrap();
        assert_eq!(list.contains("secret-a"), sees, "{list}");
        assert_eq!(list.contains(&served.hash), sees, "{list}");
    }
    let opened = served.ask(Method::GET, "/v1/scenes/secret-a/open", Some(READER), None);
    opened.await.bytes().await.unwrap();
    let opened = served.ask(Method::GET, "/v1/scenes/open/open", None, None);
    opened.await.bytes().await.unwrap();
    let metrics = served.ask(Method::GET, "/metrics", None, None).await;
    let metrics = metrics.text().await.unwrap();
    assert!(
        metrics.contains(r#"scene_opens_total{scene=""} 1"#),
        "{metrics}"
    );
    assert!(
        metrics.contains(r#"scene_opens_total{scene="open"} 1"#),
        "{metrics}"
    );
    assert!(!metrics.contains("secret"), "{metrics}");
    served.server.stop().await;
}

#[tokio::test]
async fn an_upload_token_is_for_its_scenes_whether_they_are_there_or_not() {
    let served = served().await;
    // A body without a byte is refused behind the token.
    let taken = StatusCode::BAD_REQUEST;
    let (other, unknown) = (StatusCode::FORBIDDEN, StatusCode::UNAUTHORIZED);
    let mut texts = vec![];
    for (token, open, secret) in [
        (None, unknown, unknown),
        (Some("nobody-knows-this-one"), unknown, unknown),
        (Some(READER), unknown, unknown),
        (Some(WRITER), other, taken),
        (Some(BOTH), other, taken),
        (Some(ANYWHERE), taken, other),
    ] {
        for (scene, status) in [
            ("open", open),
            ("none", open),
            ("secret-a", secret),
            ("secret-none", secret),
        ] {
            let path = format!("/v1/scenes/{scene}?kind=obj");
            let answer = served.ask(Method::PUT, &path, token, None).await;
            assert_eq!(answer.status(), status, "{scene} {token:?}");
            if status == other {
                texts.push(answer.text().await.unwrap());
            }
        }
    }
    texts.dedup();
    assert_eq!(texts.len(), 1, "{texts:?}");
    served.server.stop().await;
}

#[tokio::test]
async fn the_hash_of_a_scene_is_told_to_its_readers() {
    let served = served().await;
    let path = "/v1/scenes/secret-a?kind=obj";
    let wrong = format!("\"{}\"", "0".repeat(64));
    for field in [("if-none-match", "*"), ("if-match", &*wrong)] {
        for (token, is_told) in [(WRITER, false), (BOTH, true)] {
            let answer = served
                .ask(Method::PUT, path, Some(token), Some(field))
                .await;
            assert_eq!(answer.status(), StatusCode::PRECONDITION_FAILED);
            let said = format!("{:?}", answer.headers()) + &answer.text().await.unwrap();
            assert!(
                said.contains("scene secret-a: expected to replace"),
                "{said}"
            );
            assert_eq!(said.contains(&served.hash), is_told, "{token}: {said}");
        }
    }
    served.server.stop().await;
}
