//! The built binary: what scripts rely on. Exit codes, one line of error, reports, signals.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use lodestream_format::library::object_path;
use lodestream_server::library::Library;
use serde_json::Value;
use support::gltf::{self, DRAWN_TRIANGLES, INSTANCES, SPHERE_TRIANGLES, TORUS_TRIANGLES};
use support::{made, runtime, server};

fn command(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-server"));
    command.args(args).env_remove("RUST_LOG");
    command
}

fn run(args: &[&str]) -> Output {
    command(args).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// Runs what must succeed; gives its standard output.
fn ok(args: &[&str]) -> String {
    let output = run(args);
    assert_eq!(
        output.status.code(),
        Some(0),
        "{args:?}: {}",
        stderr(&output)
    );
    String::from_utf8(output.stdout).unwrap()
}

/// Runs what must fail with `code` and one line that has all of `words`.
fn fails(args: &[&str], code: i32, words: &[&str]) {
    let output = run(args);
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {text}");
    assert_eq!(text.lines().count(), 1, "{args:?}: {text}");
    assert!(text.starts_with("error: "), "{args:?}: {text}");
    for word in words {
        assert!(text.contains(word), "{args:?}: {word:?} in {text}");
    }
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// An ingested library, built once for all tests of a process, copied by those that damage it.
fn ingested() -> &'static (tempfile::TempDir, Value) {
    static LIBRARY: OnceLock<(tempfile::TempDir, Value)> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let model = gltf::write(folder.path());
        let (library, report) = (
            folder.path().join("library"),
            folder.path().join("report.json"),
        );
        ok(&[
            "ingest",
            text(&model),
            "--library",
            text(&library),
            "--scene",
            "pair",
            "--report",
            text(&report),
        ]);
        let report = json(&report);
        (folder, report)
    })
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn copy_of_library() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("library");
    copy(&ingested().0.path().join("library"), &to);
    (folder, to)
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        match entry.file_type().unwrap().is_dir() {
            true => copy(&entry.path(), &target),
            false => drop(std::fs::copy(entry.path(), target).unwrap()),
        }
    }
}

#[test]
fn ingest_reports_every_key_of_the_contract() {
    let (folder, report) = ingested();
    let number = |key: &str| {
        report
            .pointer(key)
            .and_then(Value::as_f64)
            .unwrap_or_else(|| panic!("{key}"))
    };
    assert_eq!(
        number("/input_triangles") as u64,
        SPHERE_TRIANGLES + TORUS_TRIANGLES
    );
    assert_eq!(
        (number("/instances") as u64, number("/assets") as u64),
        (INSTANCES, 2)
    );
    for key in [
        "/dag_triangles",
        "/clusters",
        "/groups",
        "/levels",
        "/pages",
        "/bytes/memory_form",
        "/bytes/disk_form",
        "/bytes/stored",
        "/bytes/hierarchy",
        "/bytes/root_pages",
        "/bytes/textures",
        "/bytes_per_input_triangle",
        "/bytes_per_dag_triangle",
        "/seconds/total",
        "/seconds/import",
        "/seconds/build",
        "/seconds/encode",
        "/seconds/store",
        "/cluster_fill",
    ] {
        assert!(number(key) > 0.0, "{key}");
    }
    let seconds = &report["seconds"];
    let parts: f64 = ["import", "build", "encode", "store"]
        .iter()
        .map(|key| seconds[key].as_f64().unwrap())
        .sum();
    assert!(parts <= number("/seconds/total") * 1.001, "{seconds}");
    if cfg!(target_os = "linux") {
        assert!(number("/peak_rss_bytes") > 1e6);
    }
    let levels = report["levels_table"].as_array().unwrap();
    assert_eq!(levels.len(), number("/levels") as usize);
    for (index, row) in levels.iter().enumerate() {
        assert_eq!(row["level"], index);
        assert!(row["triangles"].as_u64() > Some(0) && row["clusters"].as_u64() > Some(0));
        assert!(row["groups"].is_u64() && row["error_max"].is_number());
    }
    let sum: u64 = levels
        .iter()
        .map(|row| row["triangles"].as_u64().unwrap())
        .sum();
    assert_eq!(sum, number("/dag_triangles") as u64);
    assert!(report["warnings"].is_array());

    let library = folder.path().join("library");
    let list = ok(&["list", "--library", text(&library)]);
    assert_eq!(list.lines().count(), 1);
    assert!(list.starts_with("pair\t"));
    let figures = folder.path().join("show.json");
    let show = ok(&[
        "show",
        "pair",
        "--library",
        text(&library),
        "--report",
        text(&figures),
    ]);
    assert!(show.contains("instances\t5"));
    let figures = json(&figures);
    assert_eq!(figures["pages"], report["pages"]);
    assert_eq!(figures["pack_bytes"], report["bytes"]["stored"]);
    assert_eq!(
        (&figures["materials"], &figures["textures"]),
        (&3.into(), &1.into())
    );
}

#[test]
fn the_thread_count_does_not_change_the_scene() {
    let (folder, _) = ingested();
    let model = folder.path().join("model.glb");
    let other = tempfile::tempdir().unwrap();
    let quiet = ok(&[
        "ingest",
        text(&model),
        "--library",
        text(other.path()),
        "--scene",
        "pair",
        "--threads",
        "1",
        "--quiet",
    ]);
    assert_eq!(quiet, "");
    let list = |library: &Path| ok(&["list", "--library", text(library)]);
    assert_eq!(list(other.path()), list(&folder.path().join("library")));
}

#[test]
fn several_inputs_make_one_scene_and_equal_meshes_are_stored_once() {
    let (folder, single) = ingested();
    let model = folder.path().join("model.glb");
    let again = folder.path().join("again.glb");
    std::fs::copy(&model, &again).unwrap();
    let other = tempfile::tempdir().unwrap();
    let report = other.path().join("report.json");
    let library = other.path().join("library");
    ok(&[
        "ingest",
        text(&model),
        text(&again),
        "--library",
        text(&library),
        "--scene",
        "twice",
        "--report",
        text(&report),
        "-q",
    ]);
    let report = json(&report);
    assert_eq!(report["assets"], 2);
    assert_eq!(report["instances"], 2 * INSTANCES);
    assert_eq!(
        report["input_triangles"],
        2 * (SPHERE_TRIANGLES + TORUS_TRIANGLES)
    );
    assert_eq!(report["bytes"]["stored"], single["bytes"]["stored"]);
    assert_eq!(report["bytes"]["textures"], single["bytes"]["textures"]);
    ok(&["verify", "--library", text(&library), "-q"]);
}

#[test]
fn verify_passes_and_names_every_damaged_object() {
    let (_folder, library) = copy_of_library();
    let counts = ok(&["verify", "--library", text(&library)]);
    assert!(
        counts.contains("1 scenes") && counts.contains(" 0 faults"),
        "{counts}"
    );
    ok(&["verify", "pair", "--library", text(&library)]);

    let store = Library::open(text(&library)).unwrap();
    let (scene, asset) = runtime().block_on(async {
        let reference = store.reference("pair").await.unwrap();
        let scene = store.scene(&reference.scene).await.unwrap();
        let asset = store.asset(&scene.assets[0].asset).await.unwrap();
        (reference.scene, asset)
    });
    let orphan = runtime().block_on(made::put(&store, bytes::Bytes::from_static(b"nobody's")));
    let texture = runtime().block_on(store.scene(&scene)).unwrap().textures[0].object;
    for (what, hash) in [
        ("scene", scene),
        ("pack", asset.pack),
        ("hierarchy", asset.hierarchy),
        ("texture", texture),
        ("orphan", orphan),
    ] {
        let path = library.join(object_path(&hash));
        let whole = std::fs::read(&path).unwrap();
        let middle = whole.len() / 2;
        let mut flipped = whole.clone();
        flipped[middle] ^= 0x10;
        for (how, damage) in [("flipped", &flipped[..]), ("truncated", &whole[..middle])] {
            std::fs::write(&path, damage).unwrap();
            let output = run(&["verify", "--library", text(&library)]);
            let text = stderr(&output);
            assert_eq!(output.status.code(), Some(1), "{what} {how}: {text}");
            let named = text.lines().any(|line| line.contains(&hash.to_string()));
            assert!(named, "{what} {how}: {text}");
        }
        std::fs::remove_file(&path).unwrap();
        let output = run(&["verify", "--library", text(&library)]);
        let gone = stderr(&output);
        // An orphan that is gone is no fault.
        let code = if what == "orphan" { 0 } else { 1 };
        assert_eq!(output.status.code(), Some(code), "{what} gone: {gone}");
        assert!(
            code == 0 || gone.contains(&hash.to_string()),
            "{what} gone: {gone}"
        );
        std::fs::write(&path, whole).unwrap();
    }
    std::fs::write(library.join("scenes").join("broken"), b"{}").unwrap();
    fails_lines(&["verify", "--library", text(&library)], "scenes/broken");
    ok(&["verify", "pair", "--library", text(&library)]);
    fails(
        &["verify", "none", "--library", text(&library)],
        1,
        &["none"],
    );
}

fn fails_lines(args: &[&str], word: &str) {
    let output = run(args);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains(word), "{}", stderr(&output));
}

#[test]
fn remove_and_gc_leave_what_other_scenes_need() {
    let (folder, library) = copy_of_library();
    let model = ingested().0.path().join("model.glb");
    let library = text(&library);
    // Other bytes, the same texture.
    ok(&[
        "ingest",
        text(&model),
        "--library",
        library,
        "--scene",
        "raw",
        "--codec",
        "none",
        "-q",
    ]);
    let report = folder.path().join("gc.json");
    let gc = |grace: &str| {
        ok(&[
            "gc",
            "--library",
            library,
            "--grace-secs",
            grace,
            "--report",
            text(&report),
            "-q",
        ]);
        json(&report)
    };
    assert_eq!(gc("0")["removed"], 0);
    ok(&["remove", "raw", "--library", library]);
    let young = gc("86400");
    assert_eq!(young["removed"], 0);
    assert!(young["young"].as_u64() > Some(0), "{young}");
    let swept = gc("0");
    assert_eq!(swept["removed"], young["young"]);
    ok(&["verify", "--library", library]);
    fails(
        &["show", "raw", "--library", library],
        1,
        &["raw", "published scene"],
    );
    fails(&["remove", "raw", "--library", library], 1, &["raw"]);
}

#[test]
fn wrong_usage_is_2_and_failures_are_1_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let model = gltf::write(folder.path());
    let (model, here) = (text(&model), text(folder.path()));
    for (args, words) in [
        (&[][..], &["subcommand"][..]),
        (&["paint"], &["paint"]),
        (&["ingest"], &["INPUT", "--library", "--scene"]),
        (
            &["ingest", model, "--library", here, "--scene", "../x"],
            &["--scene", "../x"],
        ),
        (
            &[
                "ingest",
                model,
                "--library",
                here,
                "--scene",
                "x",
                "--codec",
                "zip",
            ],
            &["--codec", "zip"],
        ),
        (
            &[
                "ingest",
                model,
                "--library",
                here,
                "--scene",
                "x",
                "--position-step",
                "-1",
            ],
            &["--position-step"],
        ),
        (
            &[
                "ingest",
                model,
                "--library",
                here,
                "--scene",
                "x",
                "--memory-limit",
                "lots",
            ],
            &["4GiB"],
        ),
        (
            &[
                "ingest",
                model,
                "--library",
                here,
                "--scene",
                "x",
                "--threads",
                "0",
            ],
            &["--threads"],
        ),
        (
            &["export", "x", "--library", here, "--out", "x.glb"],
            &["--error", "--triangles", "--source"],
        ),
        (
            &[
                "export",
                "x",
                "--library",
                here,
                "--out",
                "x.obj",
                "--source",
            ],
            &[".glb", ".ply"],
        ),
        (
            &[
                "export",
                "x",
                "--library",
                here,
                "--out",
                "x.ply",
                "--source",
                "--error",
                "1",
            ],
            &["--error"],
        ),
        (&["serve"], &["--library"]),
        (
            &["gc", "--library", here, "--grace-secs", "-5"],
            &["--grace-secs"],
        ),
    ] {
        fails(args, 2, words);
    }
    let none = folder.path().join("none.glb");
    let bad = folder.path().join("bad.glb");
    std::fs::write(&bad, b"glTF but no more").unwrap();
    let library = folder.path().join("library");
    for (args, words) in [
        (
            &[
                "ingest",
                text(&none),
                "--library",
                text(&library),
                "--scene",
                "x",
            ][..],
            &["none.glb"][..],
        ),
        (
            &[
                "ingest",
                text(&bad),
                "--library",
                text(&library),
                "--scene",
                "x",
            ],
            &["bad.glb", "expected"],
        ),
        (
            &["ingest", model, "--library", "s3://b/p", "--scene", "x"],
            &["s3://b/p", "no S3"],
        ),
        (
            &[
                "ingest",
                model,
                "--library",
                text(&library),
                "--scene",
                "x",
                "--memory-limit",
                "1MiB",
            ],
            &["--memory-limit", "1048576", "model.glb"],
        ),
        (&["list", "--library", text(&none)], &["none.glb", "folder"]),
        (&["list", "--library", model], &["a folder, found a file"]),
        (
            &[
                "export",
                "x",
                "--library",
                here,
                "--out",
                "x.glb",
                "--source",
            ],
            &["scene x"],
        ),
        (
            &["serve", "--library", here, "--listen", "127.0.0.1:notaport"],
            &["notaport"],
        ),
        (&["serve", "--library", text(&none)], &["none.glb"]),
    ] {
        fails(args, 1, words);
    }
    assert_eq!(
        ok(&["list", "--library", text(&library)]),
        "",
        "nothing was published"
    );
    for help in [
        &["--help"][..],
        &["ingest", "--help"],
        &["serve", "--help"],
        &["export", "--help"],
        &["--version"],
    ] {
        assert!(ok(help).contains("lodestream-server"), "{help:?}");
    }
}

/// Triangles of a `.ply` of [`lodestream_server::export`]: corners and area in the world.
fn ply(path: &Path) -> (usize, f64) {
    let bytes = std::fs::read(path).unwrap();
    let end = b"end_header\n";
    let header = bytes
        .windows(end.len())
        .position(|window| window == end)
        .unwrap()
        + end.len();
    let text = std::str::from_utf8(&bytes[..header]).unwrap();
    let count = |name: &str| -> usize {
        let line = text
            .lines()
            .find_map(|line| line.strip_prefix(name))
            .unwrap();
        line.trim().parse().unwrap()
    };
    let (vertices, faces) = (count("element vertex"), count("element face"));
    let (points, triangles) = bytes[header..].split_at(12 * vertices);
    assert_eq!(triangles.len(), 13 * faces);
    let point = |index: u32| {
        let bytes = &points[12 * index as usize..][..12];
        glam::Vec3::from(bytemuck::pod_read_unaligned::<[f32; 3]>(bytes)).as_dvec3()
    };
    let area = triangles.chunks_exact(13).map(|triangle| {
        assert_eq!(triangle[0], 3);
        let [a, b, c] = bytemuck::pod_read_unaligned::<[u32; 3]>(&triangle[1..]).map(point);
        (b - a).cross(c - a).length() / 2.0
    });
    (faces, area.sum())
}

#[test]
fn exports_count_area_and_outside_come_right() {
    let (folder, _) = ingested();
    let library = folder.path().join("library");
    let out = tempfile::tempdir().unwrap();
    let export = |name: &str, detail: &[&str]| {
        let (file, report) = (out.path().join(name), out.path().join("report.json"));
        let fixed = [
            "export",
            "pair",
            "--library",
            text(&library),
            "--out",
            text(&file),
            "--report",
            text(&report),
            "-q",
        ];
        ok(&[&fixed[..], detail].concat());
        (file, json(&report))
    };
    let (source, report) = export("source.ply", &["--source"]);
    let (faces, source_area) = ply(&source);
    assert_eq!(
        faces as u64, DRAWN_TRIANGLES,
        "as many triangles as the source"
    );
    assert_eq!(report["triangles"], SPHERE_TRIANGLES + TORUS_TRIANGLES);
    assert_eq!(report["drawn_triangles"], DRAWN_TRIANGLES);
    // Torus: 4 pi^2 R r. The spheres have radius 1 and 2.
    let torus = 4.0 * std::f64::consts::PI.powi(2) * 0.3;
    let expected = gltf::SPHERE_AREA * 5.0 + 3.0 * torus;
    assert!(
        (source_area / expected - 1.0).abs() < 0.01,
        "{source_area} {expected}"
    );

    let mut last = faces;
    for error in ["0.02", "0.1", "0.4"] {
        let (file, report) = export("cut.ply", &["--error", error]);
        let (faces, area) = ply(&file);
        assert!(faces < last, "{error}: {faces} of {last}");
        assert!(
            (area / source_area - 1.0).abs() < 0.15,
            "{error}: {area} {source_area}"
        );
        assert_eq!(report["drawn_triangles"], faces);
        last = faces;
    }
    for limit in [20_000u64, 5_000] {
        let (file, report) = export("limit.ply", &["--triangles", &limit.to_string()]);
        let (faces, _) = ply(&file);
        assert!(
            faces as u64 <= limit && faces as u64 > limit / 3,
            "{faces} of {limit}"
        );
        // The error that it names gives the same cut.
        let error = report["error_metres"].to_string();
        let (same, _) = export("same.ply", &["--error", &error]);
        assert_eq!(ply(&same).0, faces);
    }
    let few = out.path().join("few.ply");
    fails(
        &[
            "export",
            "pair",
            "--library",
            text(&library),
            "--out",
            text(&few),
            "--triangles",
            "3",
        ],
        1,
        &["pair", "at most 3", "coarsest"],
    );
    assert!(!few.exists());
}

#[test]
fn an_exported_glb_ingests_to_the_same_scene() {
    let (folder, first) = ingested();
    let library = folder.path().join("library");
    let out = tempfile::tempdir().unwrap();
    let file = out.path().join("source.glb");
    ok(&[
        "export",
        "pair",
        "--library",
        text(&library),
        "--out",
        text(&file),
        "--source",
        "-q",
    ]);
    let scene = lodestream_server::import::import(&file).unwrap();
    let original = lodestream_server::import::import(&folder.path().join("model.glb")).unwrap();
    assert_eq!(scene.warnings, Vec::<String>::new());
    assert_eq!(
        scene.source_triangles,
        first["input_triangles"].as_u64().unwrap()
    );
    assert_eq!(scene.materials, original.materials);
    assert_eq!(scene.images, original.images);
    assert_eq!(scene.instances, original.instances);
    for (mesh, original) in scene.meshes.iter().zip(&original.meshes) {
        assert_eq!(mesh.name, original.name);
        assert_eq!(mesh.material_slots, original.material_slots);
        assert_eq!(mesh.triangles.len(), original.triangles.len());
        assert_eq!(mesh.uvs.is_some(), original.uvs.is_some());
        // Outside stays outside: the signed volume.
        let volume = |mesh: &lodestream_server::import::Mesh| -> f64 {
            let point = |index: u32| glam::Vec3::from(mesh.positions[index as usize]).as_dvec3();
            let six = mesh.triangles.iter().map(|t| {
                let [a, b, c] = t.map(point);
                a.dot(b.cross(c))
            });
            six.sum::<f64>() / 6.0
        };
        let (found, expected) = (volume(mesh), volume(original));
        assert!(
            expected > 1.0 && (found / expected - 1.0).abs() < 1e-3,
            "{found} {expected}"
        );
    }
}

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

#[cfg(unix)]
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

#[cfg(unix)]
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
