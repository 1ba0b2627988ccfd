//! Models from strangers: other files of the server, memory beyond the bound, killed servers, and
//! uploads that take the places of others.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::io::Write;
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

use reqwest::StatusCode;
use serde_json::{Value, json};
use support::binary::{json as read_json, ok, run, stderr, text};
use support::server::client;
use support::uploads::{Serving, TOKEN, events, sheet};

/// Longest wait for a process or a file; only a broken server takes so long.
const LONG: Duration = Duration::from_secs(120);

async fn until(holds: impl Fn() -> bool) -> bool {
    let deadline = Instant::now() + LONG;
    while !holds() {
        if Instant::now() > deadline {
            return false;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    true
}

/// The last event of an upload: its name, and its data.
async fn last(server: &Serving, scene: &str, kind: &str, body: Vec<u8>) -> (String, Value) {
    let path = format!("/v1/scenes/{scene}?kind={kind}");
    let answer = server.put(&path, Some(TOKEN), body).await;
    assert_eq!(answer.status(), StatusCode::OK, "{scene}");
    let events = events(&answer.text().await.unwrap());
    events.last().unwrap().clone()
}

/// A triangle as .glb whose buffer lies at `uri`.
fn glb(uri: &str) -> Vec<u8> {
    let document = json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 36, "uri": uri}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
            "min": [0, 0, 0], "max": [1, 1, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0,
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = |bytes: usize| u32::try_from(bytes).unwrap().to_le_bytes();
    [
        &b"glTF"[..],
        &2u32.to_le_bytes(),
        &length(20 + text.len()),
        &length(text.len()),
        b"JSON",
        &text,
    ]
    .concat()
}

#[tokio::test]
async fn an_uploaded_model_reads_no_other_file() {
    let server = Serving::start(&[]);
    const SECRET: &str = "v 7.125 7.25 7.5 SECRET";
    let scratch = server.folder.path().join("scratch");
    let secret = scratch.join("secret.bin");
    std::fs::write(&secret, SECRET.repeat(10)).unwrap();
    let uploads = std::fs::read_dir(&scratch).unwrap();
    let uploads = uploads.map(|entry| entry.unwrap().path());
    let own = uploads.filter(|path| path.is_dir()).collect::<Vec<_>>();
    std::fs::write(own[0].join("secret.bin"), SECRET.repeat(10)).unwrap();
    let absolute = text(&secret).to_owned();
    for uri in [
        "secret.bin",
        "../secret.bin",
        "../../secret.bin",
        "..%2Fsecret.bin",
        "..\\secret.bin",
        "report.json",
        "model.glb",
        "/etc/passwd",
        "file:///etc/passwd",
        "/proc/self/environ",
        &absolute,
    ] {
        let (name, data) = last(&server, "taken", "glb", glb(uri)).await;
        assert_eq!(name, "error", "{uri}: {data}");
        let said = data.to_string();
        assert!(
            !said.contains("SECRET") && !said.contains("root:"),
            "{said}"
        );
        // The answer is the same whether the file is there or not.
        // Both names come out alike; a temporary folder may have either letter in its name.
        let alike = |text: &str| text.replace('s', "z");
        let (_, other) = last(&server, "taken", "glb", glb(&alike(uri))).await;
        assert_eq!(alike(&said), alike(&other.to_string()), "{uri}");
    }
    let mut obj = String::from("mtllib secret.bin\nmtllib ../secret.bin\nmtllib /etc/passwd\n");
    obj += &sheet(3);
    let (name, data) = last(&server, "plain", "obj", obj.into_bytes()).await;
    let said = data.to_string();
    assert_eq!(name, "done", "{said}");
    assert!(
        !said.contains("SECRET") && !said.contains("root:"),
        "{said}"
    );
    assert!(server.on_their_way().is_empty());
}

#[cfg(target_os = "linux")]
#[test]
fn a_confined_ingest_keeps_to_its_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("model.obj"), sheet(700)).unwrap();
    std::fs::create_dir(path("scratch")).unwrap();
    let ingest = |bytes: &str, library: &str| {
        run(&[
            "ingest",
            text(&path("model.obj")),
            "--library",
            text(&path(library)),
            "--scene",
            "model",
            "--scratch",
            text(&path("scratch")),
            "--report",
            text(&path("report.json")),
            "--threads",
            "1",
            "--confine",
            bytes,
            "-q",
        ])
    };
    let fits = ingest("4GiB", "library");
    assert!(fits.status.success(), "{}", stderr(&fits));
    assert_eq!(read_json(&path("report.json"))["input_triangles"], 980_000);
    let bounded = ingest("48MiB", "other");
    use std::os::unix::process::ExitStatusExt;
    assert_eq!(bounded.status.signal(), Some(libc::SIGABRT));
    assert!(
        stderr(&bounded).contains("memory allocation of"),
        "{}",
        stderr(&bounded)
    );
}

#[cfg(target_os = "linux")]
#[tokio::test]
async fn a_build_beyond_its_memory_is_an_error_of_the_model() {
    let server = Serving::start(&["--upload-memory", "100MiB"]);
    let (name, data) = last(&server, "large", "obj", sheet(600).into_bytes()).await;
    assert_eq!(name, "error", "{data}");
    let said = data["error"].as_str().unwrap();
    assert!(said.contains("memory"), "{said}");
    assert!(!said.contains("stack backtrace"), "{said}");
    let (name, data) = last(&server, "small", "obj", sheet(10).into_bytes()).await;
    assert_eq!(name, "done", "{data}");
}

/// Command lines of processes that name `folder`.
#[cfg(target_os = "linux")]
fn processes_in(folder: &Path) -> Vec<String> {
    let name = text(folder);
    let entries = std::fs::read_dir("/proc").unwrap().flatten();
    let lines = entries.filter_map(|entry| std::fs::read(entry.path().join("cmdline")).ok());
    let lines = lines.map(|line| String::from_utf8_lossy(&line).replace('\0', " "));
    lines.filter(|line| line.contains(name)).collect()
}

#[cfg(target_os = "linux")]
#[tokio::test]
async fn a_killed_server_leaves_no_build_and_the_next_one_no_folder() {
    let server = Serving::start(&[]);
    let path = "/v1/scenes/late?kind=obj";
    let mut answer = server.put(path, Some(TOKEN), sheet(1200)).await;
    let mut said = String::new();
    while !said.contains("building") {
        let chunk = answer
            .chunk()
            .await
            .unwrap()
            .expect("an upload that goes on");
        said += &String::from_utf8_lossy(&chunk);
    }
    let folder = server.kill();
    assert!(until(|| processes_in(folder.path()).is_empty()).await);
    let scratch = folder.path().join("scratch");
    assert_eq!(std::fs::read_dir(&scratch).unwrap().count(), 1);
    let next = Serving::over(folder, &[]);
    assert_eq!(std::fs::read_dir(&scratch).unwrap().count(), 1);
    assert!(next.on_their_way().is_empty());
    let list = client().get(format!("{}/v1/scenes", next.url)).send().await;
    let list = list.unwrap().text().await.unwrap();
    assert!(list.contains("base") && !list.contains("late"), "{list}");
}

#[tokio::test]
async fn uploads_that_trickle_are_given_up_and_leave_room() {
    let server = Serving::start(&[]);
    let address = server.url.strip_prefix("http://").unwrap().to_owned();
    // As many as one client may have at once.
    let trickles: Vec<TcpStream> = (0..32)
        .map(|_| {
            let mut stream = TcpStream::connect(&address).unwrap();
            let head = format!(
                "PUT /v1/scenes/drip?kind=obj HTTP/1.1\r\nHost: here\r\nAuthorization: Bearer {TOKEN}\r\n\
                 Content-Length: 1000000\r\n\r\nv"
            );
            stream.write_all(head.as_bytes()).unwrap();
            stream
        })
        .collect();
    assert!(until(|| server.on_their_way().len() == trickles.len()).await);
    let (name, data) = last(&server, "whole", "obj", sheet(4).into_bytes()).await;
    assert_eq!(name, "done", "{data}");
    assert!(until(|| server.on_their_way().is_empty()).await);
}

#[tokio::test]
async fn meshes_of_a_library_with_protected_scenes_are_built_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("hidden.obj"), sheet(5)).unwrap();
    let hidden = path("hidden.obj");
    let library = path("library");
    ok(&[
        "ingest",
        text(&hidden),
        "--library",
        text(&library),
        "--scene",
        "hidden",
        "-q",
    ]);
    std::fs::create_dir(path("scratch")).unwrap();
    std::fs::write(path("tokens"), format!("{TOKEN} mine-*\n")).unwrap();
    let readers = path("readers");
    const READER: &str = "a-reader-of-this-test";
    std::fs::write(&readers, format!("{READER} hidden\n")).unwrap();
    let readers = text(&readers).to_owned();
    let server = Serving::over(folder, &["--read-tokens", &readers]);
    let (name, data) = last(&server, "mine-1", "obj", sheet(5).into_bytes()).await;
    assert_eq!(
        (name.as_str(), &data["reused"]),
        ("done", &json!(0)),
        "{data}"
    );
    let refused = server
        .put("/v1/scenes/hidden?kind=obj", Some(TOKEN), sheet(2))
        .await;
    assert_eq!(refused.status(), StatusCode::FORBIDDEN);
    // The same token reads everything now.
    std::fs::write(&readers, format!("{TOKEN} *\n")).unwrap();
    let server = Serving::over(server.kill(), &["--read-tokens", &readers]);
    let (name, data) = last(&server, "mine-2", "obj", sheet(5).into_bytes()).await;
    assert_eq!(
        (name.as_str(), &data["reused"]),
        ("done", &json!(1)),
        "{data}"
    );
}
