//! The built binary: what scripts rely on. Exit codes, one line of error, reports.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use lodestream_format::library::object_path;
use lodestream_server::library::Library;
use serde_json::Value;
use std::path::Path;
use support::binary::{copy_of_library, fails, ingested, json, ok, run, stderr, text};
use support::gltf::{self, INSTANCES, SPHERE_TRIANGLES, TORUS_TRIANGLES};
use support::{made, runtime};

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
    let there = text(&ingested().0.path().join("library")).to_owned();
    let there = there.as_str();
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
            &["ingest", model, "--library", "gs://b/p", "--scene", "x"],
            &["gs://b/p", "s3://bucket/prefix"],
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
                there,
                "--out",
                "x.glb",
                "--source",
            ],
            &["scene x"],
        ),
        (
            &[
                "serve",
                "--library",
                there,
                "--listen",
                "127.0.0.1:notaport",
            ],
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
