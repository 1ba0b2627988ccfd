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
    let args = [
        "serve",
        "--library",
        text(library),
        "--listen",
        "127.0.0.1:0",
    ];
    let mut child = command(&args)
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
