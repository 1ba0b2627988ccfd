//! `serve` of the built binary: readiness on standard output, signals, connections in flight.
// A failed expectation is the test's failure.
#![cfg(unix)]
#![allow(clippy::unwrap_used)]

mod support;

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use lodestream_server::library::Library;
use support::binary::{command, text};
use support::{made, runtime, server};

/// The binary, serving.
struct Serving {
    child: std::process::Child,
    url: String,
}

fn serve(library: &Path) -> Serving {
    serve_with(
        &["--library", text(library), "--listen", "127.0.0.1:0"],
        &[],
    )
}

fn serve_with(args: &[&str], variables: &[(&str, &str)]) -> Serving {
    let mut child = command(&["serve"])
        .args(args)
        .envs(variables.iter().copied())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.as_mut().unwrap())
        .read_line(&mut line)
        .unwrap();
    let url = line
        .trim()
        .strip_prefix("listening on ")
        .unwrap_or_else(|| panic!("{line:?}"));
    Serving {
        url: url.to_owned(),
        child,
    }
}

/// A library without scenes.
fn empty_library(folder: &Path) {
    let library = Library::open(text(folder)).unwrap();
    runtime().block_on(library.make()).unwrap();
}

impl Serving {
    fn signal(&self, signal: &str) {
        let kill = Command::new("kill")
            .args([signal, &self.child.id().to_string()])
            .status();
        assert!(kill.unwrap().success());
    }

    /// Waits for the end; gives the exit code and what it said on standard error.
    fn end(mut self, within: Duration) -> (Option<i32>, String) {
        let deadline = Instant::now() + within;
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                let mut text = String::new();
                self.child
                    .stderr
                    .take()
                    .unwrap()
                    .read_to_string(&mut text)
                    .unwrap();
                return (status.code(), text);
            }
            if Instant::now() > deadline {
                self.child.kill().unwrap();
                panic!("still running after {within:?}");
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

#[test]
fn serve_ends_cleanly_on_sigterm_and_finishes_what_is_in_flight() {
    let folder = tempfile::tempdir().unwrap();
    let made = runtime().block_on(async {
        let library = Library::open(text(folder.path())).unwrap();
        made::asset(&library, 6, 700, 40_000).await
    });
    let serving = serve(folder.path());
    runtime().block_on(async {
        let client = server::client();
        let ready = client.get(format!("{}/readyz", serving.url)).send().await.unwrap();
        assert_eq!(ready.status(), 200);
        let body = format!(
            r#"{{"viewer":1,"sequence":1,"wants":[{{"asset":"{}","first":0,"last":699,"priority":1}}]}}"#,
            made.hash
        );
        let answer = client.post(format!("{}/v1/pages", serving.url)).body(body).send().await.unwrap();
        serving.signal("-TERM");
        tokio::time::sleep(Duration::from_millis(300)).await;
        let fresh = server::client().get(format!("{}/healthz", serving.url)).send().await;
        assert!(fresh.is_err(), "no new connections");
        let (blocks, ended) = server::blocks(&answer.bytes().await.unwrap());
        assert!(ended && blocks.len() == 700, "{} of 700 pages", blocks.len());
    });
    let (code, text) = serving.end(Duration::from_secs(8));
    assert_eq!((code, text.as_str()), (Some(0), ""));
}

#[test]
fn serve_gives_up_on_a_stuck_connection_after_a_while_and_takes_sigint() {
    let folder = tempfile::tempdir().unwrap();
    empty_library(folder.path());
    let serving = serve(folder.path());
    serving.signal("-INT");
    assert_eq!(serving.end(Duration::from_secs(5)).0, Some(0));

    let serving = serve(folder.path());
    let address = serving.url.strip_prefix("http://").unwrap();
    // Says half a request and then nothing.
    let mut stuck = std::net::TcpStream::connect(address).unwrap();
    std::io::Write::write_all(&mut stuck, b"GET /healthz HTTP/1.1\r\nHos").unwrap();
    std::thread::sleep(Duration::from_millis(200));
    serving.signal("-TERM");
    assert_eq!(serving.end(Duration::from_secs(15)).0, Some(0));
}

/// The file names a library that is not there, and the environment one that is; the port is the command line's.
#[test]
fn options_come_from_a_file_then_the_environment_then_the_command_line() {
    let folder = tempfile::tempdir().unwrap();
    empty_library(folder.path());
    let config = folder.path().join("serve.toml");
    std::fs::write(
        &config,
        "library = \"/nowhere\"\nlisten = \"not an address\"\ncache_bytes = \"64MiB\"\nthreads = 1\nlog-json = true\n",
    )
    .unwrap();
    let serving = serve_with(
        &["--config", text(&config), "--listen", "127.0.0.1:0"],
        &[
            ("LODESTREAM_LIBRARY", text(folder.path())),
            ("LODESTREAM_ACCESS_LOG", "true"),
        ],
    );
    runtime().block_on(async {
        let client = server::client();
        let get = |path: &str| client.get(format!("{}{path}", serving.url));
        let named = get("/v1/scenes").header("x-request-id", "trace-7").send();
        assert_eq!(named.await.unwrap().headers()["x-request-id"], "trace-7");
        let wrong = get("/v1/scenes/none")
            .header("x-request-id", "two words")
            .send();
        let wrong = wrong.await.unwrap();
        assert_eq!(wrong.status(), 404);
        let id = wrong.headers()["x-request-id"].to_str().unwrap().to_owned();
        assert!(id != "two words" && id.len() > 8, "{id}");
        let none = get("/healthz").send().await.unwrap();
        assert!(!none.headers().contains_key("x-request-id"));
        assert_eq!(none.text().await.unwrap(), "ok\n");
    });
    serving.signal("-TERM");
    let (code, text) = serving.end(Duration::from_secs(5));
    assert_eq!(code, Some(0));
    let lines: Vec<serde_json::Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let seen: Vec<_> = lines
        .iter()
        .map(|line| {
            (
                line["path"].as_str().unwrap(),
                line["status"].as_u64().unwrap(),
            )
        })
        .collect();
    assert_eq!(
        seen,
        [
            ("/v1/scenes", 200),
            ("/v1/scenes/none", 404),
            ("/healthz", 200)
        ]
    );
    assert_eq!(
        (lines[0]["id"].as_str(), lines[0]["client"].as_str()),
        (Some("trace-7"), Some("127.0.0.1"))
    );
    assert_eq!(lines[2]["bytes"], 3);
}

#[test]
fn a_file_that_says_something_else_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("serve.toml");
    for (lines, expected) in [
        ("listen = ", "expected TOML"),
        ("speed = 3", "expected options of serve, found speed"),
        (
            "config = \"other\"",
            "expected options of serve, found config",
        ),
        ("listen = [1]", "listen: array"),
        ("threads = \"many\"", "many"),
    ] {
        std::fs::write(&config, lines).unwrap();
        let done = command(&["serve", "--library", "x", "--config", text(&config)])
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(2), "{lines}: {said}");
        assert!(
            said.contains(expected) && said.lines().count() == 1,
            "{said}"
        );
    }
}

/// Without uploads a missing library is an error.
#[test]
fn a_server_that_takes_uploads_makes_its_library() {
    let folder = tempfile::tempdir().unwrap();
    let (library, tokens) = (folder.path().join("new"), folder.path().join("tokens"));
    std::fs::write(&tokens, "an-uploader-of-this-test\n").unwrap();
    let args = ["--library", text(&library), "--listen", "127.0.0.1:0"];
    let refused = command(&["serve"]).args(args).output().unwrap();
    assert_eq!(refused.status.code(), Some(1));
    assert!(!library.exists());
    let uploads = ["--upload-tokens", text(&tokens), "--private"];
    let serving = serve_with(&[&args[..], &uploads].concat(), &[]);
    let mode = library.metadata().unwrap().permissions();
    assert_eq!(
        std::os::unix::fs::PermissionsExt::mode(&mode) & 0o777,
        0o700
    );
    serving.signal("-TERM");
    assert_eq!(serving.end(Duration::from_secs(5)).0, Some(0));
    // Now it is one.
    let serving = serve(&library);
    serving.signal("-TERM");
    assert_eq!(serving.end(Duration::from_secs(5)).0, Some(0));
}

/// Who has the token sees, opens and reads the scene; who has none does not learn that it is there.
#[test]
fn scenes_with_tokens_are_read_with_them_alone() {
    let folder = tempfile::tempdir().unwrap();
    let library = folder.path().join("library");
    let tokens = folder.path().join("tokens");
    std::fs::write(&tokens, "reader-of-the-city secret-*\n").unwrap();
    runtime().block_on(async {
        let library = Library::open_or_create(text(&library)).unwrap();
        let asset = made::asset(&library, 1, 3, 100).await;
        for name in ["open", "secret-a", "secret-b", "zoo"] {
            made::scene(&library, name, std::slice::from_ref(&asset)).await;
        }
    });
    let args = [
        "--library",
        text(&library),
        "--listen",
        "127.0.0.1:0",
        "--read-tokens",
        text(&tokens),
    ];
    let serving = serve_with(&args, &[]);
    runtime().block_on(async {
        let client = server::client();
        let get = |path: &str, token: Option<&str>| {
            let request = client.get(format!("{}{path}", serving.url));
            match token {
                Some(token) => request.bearer_auth(token),
                None => request,
            }
        };
        for (token, status, seen) in [
            (None, 401, &["open", "zoo"][..]),
            (Some("another-one"), 401, &["open", "zoo"]),
            (
                Some("reader-of-the-city"),
                200,
                &["open", "secret-a", "secret-b", "zoo"],
            ),
        ] {
            for path in ["/v1/scenes/secret-a", "/v1/scenes/secret-a/open"] {
                assert_eq!(
                    get(path, token).send().await.unwrap().status(),
                    status,
                    "{path} {token:?}"
                );
            }
            let none = if status == 200 { 404 } else { 401 };
            assert_eq!(
                get("/v1/scenes/secret-none", token)
                    .send()
                    .await
                    .unwrap()
                    .status(),
                none
            );
            assert_eq!(
                get("/v1/scenes/open/open", token)
                    .send()
                    .await
                    .unwrap()
                    .status(),
                200
            );
            let mut names = vec![];
            let mut after = String::new();
            loop {
                let page = get(&format!("/v1/scenes?limit=1{after}"), token)
                    .send()
                    .await
                    .unwrap();
                let page: serde_json::Value =
                    serde_json::from_str(&page.text().await.unwrap()).unwrap();
                for scene in page["scenes"].as_array().unwrap() {
                    names.push(scene["name"].as_str().unwrap().to_owned());
                }
                match page["next"].as_str() {
                    Some(next) => after = format!("&after={next}"),
                    None => break,
                }
            }
            assert_eq!(names, seen);
        }
    });
    serving.signal("-TERM");
    assert_eq!(serving.end(Duration::from_secs(5)).0, Some(0));
}
