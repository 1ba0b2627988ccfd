//! Connections of a process that may open few files: those that nobody uses make room, and files
//! have a share of their own.
// A failed expectation is the test's failure.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used)]

mod support;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use lodestream_server::library::Library;
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use support::binary::text;
use support::{made, runtime, server};

/// The soft limit that a server starts with, and the hard one.
const LIMITS: [u64; 2] = [48, 256];
/// Longest wait for what should come at once.
const LONG: Duration = Duration::from_secs(30);

struct Serving {
    child: Child,
    address: String,
    _folder: tempfile::TempDir,
    object: String,
}

impl Drop for Serving {
    fn drop(&mut self) {
        // It may be gone already; then there is nothing to end.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn serve() -> Serving {
    let folder = tempfile::tempdir().unwrap();
    let asset = runtime().block_on(async {
        let library = Library::open_or_create(text(folder.path())).unwrap();
        made::asset(&library, 6, 70, 40_000).await
    });
    let [soft, hard] = LIMITS;
    let script = format!("ulimit -Sn {soft} && ulimit -Hn {hard} && exec \"$0\" \"$@\"");
    let mut child = Command::new("sh")
        .args([
            "-c",
            &script,
            env!("CARGO_BIN_EXE_lodestream-server"),
            "serve",
        ])
        .args(["--library", text(folder.path()), "--threads", "2"])
        .args(["--listen", "127.0.0.1:0"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    let mut said = BufReader::new(child.stdout.as_mut().unwrap());
    said.read_line(&mut line).unwrap();
    let address = line.trim().strip_prefix("listening on http://").unwrap();
    Serving {
        address: address.to_owned(),
        child,
        _folder: folder,
        object: format!("/v1/objects/{}", asset.hash),
    }
}

impl Serving {
    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(LONG)).unwrap();
        stream
    }

    /// The status of an answer on a connection of its own.
    fn status(&self, path: &str) -> u16 {
        runtime().block_on(async {
            let url = format!("http://{}{path}", self.address);
            let answer = server::client().get(url).timeout(LONG).send().await;
            answer.unwrap().status().as_u16()
        })
    }

    fn limit_files(&self, most: u64) {
        let id = Pid::from_raw(self.child.id() as i32);
        let limits = Rlimit {
            current: Some(most),
            maximum: Some(LIMITS[1]),
        };
        prlimit(id, Resource::Nofile, limits).unwrap();
    }
}

/// Asks on a connection that is there already.
fn ask(stream: &mut TcpStream, path: &str) -> u16 {
    let request = format!("GET {path} HTTP/1.1\r\nHost: x\r\n\r\n");
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = [0; 4096];
    let read = stream.read(&mut answer).unwrap();
    let answer = String::from_utf8_lossy(&answer[..read]).into_owned();
    answer.split(' ').nth(1).unwrap().parse().unwrap()
}

/// Twice as many connections as there are descriptors, of which no one is used: over HTTP/2, over
/// HTTP/1.1, silent, and in a head.
#[test]
fn idle_connections_make_room_and_leave_files_to_be_opened() {
    let settings = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0";
    let whole = b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n";
    for said in [&settings[..], whole, b"", b"GET /v1/assets/"] {
        let serving = serve();
        let crowd: Vec<_> = (0..2 * LIMITS[1])
            .map(|_| {
                let mut stream = serving.connect();
                // The server may have ended it already to make room.
                let _ = stream.write_all(said);
                stream
            })
            .collect();
        for path in ["/readyz", &serving.object, "/v1/scenes", "/healthz"] {
            assert_eq!(serving.status(path), 200, "{path} beside {said:?}");
        }
        let open = |stream: &&TcpStream| {
            stream.set_nonblocking(true).unwrap();
            let read = stream.peek(&mut [0; 1]);
            read.is_err_and(|error| error.kind() == std::io::ErrorKind::WouldBlock)
        };
        if said.is_empty() {
            // Raised from the soft limit, and fewer than the hard one.
            let open = crowd.iter().filter(open).count() as u64;
            assert!(open > LIMITS[0] && open < LIMITS[1], "{open} connections");
        }
    }
}

#[test]
fn a_server_without_descriptors_is_not_ready_and_comes_back() {
    let serving = serve();
    let mut kept = serving.connect();
    assert_eq!(ask(&mut kept, "/readyz"), 200);
    serving.limit_files(3);
    let becomes = |kept: &mut TcpStream, status: u16| {
        let began = Instant::now();
        while ask(kept, "/readyz") != status {
            assert!(began.elapsed() < LONG, "expected {status} of /readyz");
            std::thread::sleep(Duration::from_millis(50));
        }
    };
    becomes(&mut kept, 503);
    assert_eq!(ask(&mut kept, "/healthz"), 200);
    // Waits in the listener's queue, and is accepted when there are descriptors again.
    let mut waits = serving.connect();
    waits
        .write_all(b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")
        .unwrap();
    std::thread::sleep(Duration::from_millis(500));
    serving.limit_files(LIMITS[1]);
    let mut answer = [0; 12];
    waits.read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"HTTP/1.1 200");
    becomes(&mut serving.connect(), 200);
}

#[test]
fn too_few_descriptors_are_told_at_the_start() {
    let script = "ulimit -n 20 && exec \"$0\" \"$@\"";
    let folder = tempfile::tempdir().unwrap();
    let library = Library::open(text(folder.path())).unwrap();
    support::runtime().block_on(library.make()).unwrap();
    let output = Command::new("sh")
        .args([
            "-c",
            script,
            env!("CARGO_BIN_EXE_lodestream-server"),
            "serve",
        ])
        .args(["--library", text(folder.path()), "--threads", "1"])
        .args(["--listen", "127.0.0.1:0"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains("open files") && said.contains("found 20"),
        "{said}"
    );
}
