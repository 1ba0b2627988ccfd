//! End to end, against the real server in this process: record, policies, load.
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use lodestream_client::path::CameraPath;
use lodestream_client::stream::{Source, Transport};
use lodestream_client::trace::Trace;
use lodestream_loadtests::load::{self, LoadOptions, LoadReport};
use lodestream_loadtests::policies::{LinkSpeed, Order, PolicyName, StudyOptions, study};
use lodestream_loadtests::record::{TraceFormat, record, write};
use lodestream_loadtests::samples::rock;
use lodestream_server::http::serve::Server;
use lodestream_server::http::{AppState, DEFAULT_CACHE_BYTES};
use lodestream_server::ingest::{IngestOptions, ingest};
use lodestream_server::library::Library;
use serde_json::Value;
use tokio::runtime::Runtime;

const SCENE: &str = "rock";
const PATH: &str = r#"{"fps": 10, "frames": 40, "size": [640, 360], "keys": [
    {"frame": 0, "eye": [0, 4, 400], "target": [0, 0, 0]},
    {"frame": 15, "eye": [0, 2, 14], "target": [0, 0, 0]},
    {"frame": 25, "eye": [14, 2, 2], "target": [0, 0, 0]},
    {"frame": 39, "eye": [-14, 3, -3], "target": [0, 0, 0]}]}"#;

struct Served {
    folder: tempfile::TempDir,
    runtime: Runtime,
    url: String,
}

impl Served {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let glb = folder.path().join("rock.glb");
        rock(120_000, 3).write(&glb).unwrap();
        std::fs::write(folder.path().join("path.json"), PATH).unwrap();
        let runtime = Runtime::new().unwrap();
        let library =
            Library::open_or_create(folder.path().join("library").to_str().unwrap()).unwrap();
        let options = IngestOptions {
            inputs: vec![glb],
            scene: SCENE.into(),
            ..IngestOptions::default()
        };
        ingest(runtime.handle(), &library, &options).unwrap();
        let server = runtime.block_on(Server::bind("127.0.0.1:0")).unwrap();
        let url = format!("http://{}", server.address());
        runtime.spawn(server.run(
            AppState::new(library, DEFAULT_CACHE_BYTES),
            std::future::pending(),
        ));
        Self {
            folder,
            runtime,
            url,
        }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn recorded(&self, location: &str) -> Trace {
        let open = async { Source::connect(location)?.open(SCENE).await };
        let opened = self.runtime.block_on(open).unwrap();
        record(
            SCENE,
            &opened,
            &CameraPath::parse(PATH, "path").unwrap(),
            1.0,
        )
        .unwrap()
    }

    fn load(&self, change: impl FnOnce(&mut LoadOptions)) -> LoadReport {
        let mut options = LoadOptions {
            url: self.url.clone(),
            scene: Some(SCENE.into()),
            viewers: 8,
            seconds: 2.0,
            rate: 10.0,
            link: None,
            transport: Transport::Get,
            pool_bytes: 64 << 20,
            pixel_error_px: 1.0,
            seed: 1,
        };
        change(&mut options);
        self.runtime.block_on(load::run(options)).unwrap()
    }
}

fn bytes(trace: &Trace) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(trace, TraceFormat::Lodestream, &mut bytes).unwrap();
    bytes
}

fn command(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lodestream-loadtests"))
        .args(arguments)
        .output()
        .unwrap()
}

fn succeeded(arguments: &[&str]) {
    let output = command(arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {errors}");
}

fn json(file: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap()
}

fn has_keys(value: &Value, keys: &[&str]) {
    for key in keys {
        assert!(value.get(key).is_some(), "{key} is missing in {value}");
    }
}

#[test]
fn a_trace_is_the_same_bytes_twice_and_policies_the_same_figures() {
    let served = Served::new();
    let over_http = served.recorded(&served.url);
    let from_folder = served.recorded(served.file("library").to_str().unwrap());
    assert_eq!(bytes(&over_http), bytes(&from_folder));
    assert!(
        over_http
            .frames
            .iter()
            .all(|frame| !frame.requests.is_empty())
    );
    let wanted = |frame: usize| over_http.frames[frame].requests.len();
    assert!(
        wanted(15) > wanted(0),
        "coming near must want more: {} and {}",
        wanted(0),
        wanted(15)
    );

    let options = StudyOptions {
        policies: PolicyName::ALL.to_vec(),
        pools_bytes: vec![1 << 20, 2 << 20],
        viewers: 2,
        pixel_error_px: 1.0,
        link: LinkSpeed {
            bandwidth_mbps: 50.0,
            latency_ms: 40.0,
        },
        order: Order::Total,
    };
    let read_back = Trace::read(bytes(&over_http).as_slice()).unwrap();
    let figures = study(&over_http, &options).unwrap();
    assert_eq!(figures, study(&read_back, &options).unwrap());
    assert_eq!(figures.runs.len(), 12);
    assert!(
        figures
            .runs
            .iter()
            .all(|run| run.requests > 0 && run.faults > 0 && run.bytes_fetched > 0)
    );
}

#[test]
fn viewers_load_a_server_without_an_error() {
    let served = Served::new();
    for transport in [Transport::Get, Transport::Post] {
        let report = served.load(|options| (options.transport, options.seconds) = (transport, 4.0));
        assert_eq!(
            (report.errors, report.damaged),
            (0, 0),
            "{:?}",
            report.first_error
        );
        // Each viewer opens the scene and fetches at least one range.
        assert!(
            report.requests >= 16 && report.pages > 0 && report.bytes > 0,
            "{report:?}"
        );
        let latency = report.latency_ms.unwrap();
        assert!(0.0 < latency.p50 && latency.p50 <= latency.p99 && latency.p99 <= latency.max);
        assert!(
            report.settled_viewers > 0 && report.settled_secs.is_some(),
            "{report:?}"
        );
        assert!(report.updates_planned > 8);
        let server = report.server.unwrap();
        assert!(
            server.requests >= 16 && server.failures == 0 && server.bytes >= report.bytes,
            "{server:?}"
        );
        assert!(server.pages_sent >= report.pages);
    }
}

#[test]
fn a_link_holds_viewers_up() {
    let served = Served::new();
    let link = LinkSpeed {
        bandwidth_mbps: 20.0,
        latency_ms: 100.0,
    };
    let held_up = served.load(|options| (options.viewers, options.link) = (2, Some(link)));
    assert_eq!(held_up.errors, 0, "{:?}", held_up.first_error);
    // A round trip of the page range takes the link's latency at the least.
    assert!(held_up.latency_ms.unwrap().p50 >= 100.0 && held_up.open_secs.unwrap().p50 >= 0.1);
    assert!(
        held_up.bytes_per_second <= 2.0 * 20e6 / 8.0 * 1.1,
        "{held_up:?}"
    );
}

#[test]
fn pages_that_are_damaged_in_the_library_are_errors_and_never_taken() {
    let served = Served::new();
    // The largest object is the pack; its last page is of the finest level, so the scene still opens.
    let mut largest = (0, PathBuf::new());
    for entry in walk(&served.file("library").join("objects")) {
        let bytes = entry.metadata().unwrap().len();
        largest = largest.max((bytes, entry));
    }
    let mut pack = std::fs::read(&largest.1).unwrap();
    let last = pack.len() - 1;
    pack[last] ^= 1;
    std::fs::write(&largest.1, pack).unwrap();
    let report = served.load(|options| {
        options.viewers = 2;
        // So fine that both viewers want it.
        options.pixel_error_px = 0.1;
    });
    // The server does not send them.
    assert!(report.errors > 0 && report.damaged == 0, "{report:?}");
    let first_error = report.first_error.unwrap();
    assert!(first_error.contains("found 500"), "{first_error}");
    assert_eq!(report.settled_viewers, 0);
}

fn walk(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| {
            if path.is_dir() {
                walk(&path)
            } else {
                vec![path]
            }
        })
        .collect()
}

#[test]
fn commands_write_what_the_contract_says() {
    let served = Served::new();
    let file = |name: &str| served.file(name).to_str().unwrap().to_owned();
    let (path, trace, report) = (file("path.json"), file("rock.trace"), file("report.json"));
    let recording = [
        "record",
        &served.url,
        "--scene",
        SCENE,
        "--path",
        &path,
        "--trace",
        &trace,
        "--quiet",
    ];
    succeeded(&recording);
    assert_eq!(
        std::fs::read(&trace).unwrap(),
        bytes(&served.recorded(&served.url))
    );

    let html = file("policies.html");
    succeeded(&[
        "policies", "--trace", &trace, "--pool", "1,2", "--report", &report, "--html", &html,
    ]);
    let from_trace = json(Path::new(&report));
    assert_eq!(from_trace["runs"].as_array().unwrap().len(), 12);
    let keys = "policy pool_bytes requests faults fault_rate bytes_fetched evictions error_seconds time_to_detail_secs";
    has_keys(&from_trace["runs"][0], &keys.split(' ').collect::<Vec<_>>());
    has_keys(
        &from_trace["runs"][0]["time_to_detail_secs"],
        &["p50", "p95"],
    );
    assert!(
        std::fs::read_to_string(&html)
            .unwrap()
            .contains("clairvoyant")
    );
    succeeded(&[
        "policies",
        &served.url,
        "--scene",
        SCENE,
        "--path",
        &path,
        "--pool",
        "1,2",
        "--report",
        &report,
    ]);
    assert_eq!(json(Path::new(&report)), from_trace);

    for (format, bytes_a_record) in [("oracle-general", 24), ("csv", 1)] {
        let other = file(format);
        succeeded(&[
            "record",
            &served.url,
            "--scene",
            SCENE,
            "--path",
            &path,
            "--trace",
            &other,
            "--format",
            format,
        ]);
        assert_eq!(std::fs::metadata(&other).unwrap().len() % bytes_a_record, 0);
    }

    succeeded(&[
        "load",
        &served.url,
        "--viewers",
        "3",
        "--seconds",
        "3",
        "--report",
        &report,
    ]);
    let loaded = json(Path::new(&report));
    let keys = "viewers requests errors bytes requests_per_second bytes_per_second latency_ms settled_secs server";
    has_keys(&loaded, &keys.split(' ').collect::<Vec<_>>());
    has_keys(&loaded["latency_ms"], &["p50", "p90", "p99", "p999", "max"]);
    has_keys(&loaded["settled_secs"], &["p50", "p95"]);
    assert_eq!(
        (loaded["viewers"].as_u64(), loaded["errors"].as_u64()),
        (Some(3), Some(0))
    );
}

#[test]
fn failures_are_one_line_and_exit_codes_tell_them_apart() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(file("bad.trace"), "{}\n").unwrap();
    let trace = file("bad.trace");
    for (arguments, code, says) in [
        (
            vec!["policies", "--trace", "missing.trace", "--pool", "8"],
            1,
            "missing.trace",
        ),
        (
            vec!["policies", "--trace", trace.as_str(), "--pool", "8"],
            1,
            "line 1",
        ),
        (
            vec![
                "load",
                "http://127.0.0.1:9",
                "--viewers",
                "1",
                "--seconds",
                "1",
            ],
            1,
            "http://127.0.0.1:9",
        ),
        (
            vec!["load", "nowhere", "--viewers", "1", "--seconds", "1"],
            1,
            "nowhere",
        ),
        (vec!["compare", "a.png", "b.png"], 1, "a.png"),
        (
            vec![
                "sample",
                "rock",
                "--out",
                "no/such/folder/x.glb",
                "--triangles",
                "48",
            ],
            1,
            "no/such/folder",
        ),
        (vec!["policies", "--pool", "8"], 2, "Usage"),
        (vec!["load"], 2, "Usage"),
    ] {
        let output = command(&arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {errors}");
        assert!(errors.contains(says), "{arguments:?}: {errors}");
        assert!(
            code == 2 || errors.trim_end().lines().count() == 1,
            "{arguments:?}: {errors}"
        );
    }
    let glb = file("rock.glb");
    succeeded(&["sample", "rock", "--out", &glb, "--triangles", "300"]);
    assert!(std::fs::read(&glb).unwrap().starts_with(b"glTF"));
    assert_eq!(command(&["--help"]).status.code(), Some(0));
}
