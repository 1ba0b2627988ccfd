//! Inputs at the command line: a wrong file never replaces a scene, and other files that a model
//! names are bounded.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::path::Path;

use support::binary::{fails, json, ok, run, text};

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

fn write(folder: &Path, name: &str, bytes: &[u8]) -> String {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("writes");
    text(&path).to_owned()
}

#[test]
fn a_wrong_file_never_replaces_a_scene() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let library = text(&folder.join("library")).to_owned();
    let into = ["--library", &library, "--scene", "model"];
    let model = write(folder, "model.obj", TRIANGLE.as_bytes());
    ok(&[&["ingest", &model, "-q"], &into[..]].concat());
    let show = || ok(&["show", "model", "--library", &library]);
    let before = show();

    let mut picture = std::io::Cursor::new(vec![]);
    let pixels = image::RgbImage::new(300, 200);
    let written = pixels.write_to(&mut picture, image::ImageFormat::Png);
    written.expect("writes");
    let nan = [&[0; 80][..], &1u32.to_le_bytes(), &[0xff; 50]].concat();
    let wrong: [(&str, &[u8]); 7] = [
        ("x.stl", &picture.into_inner()),
        ("nan.stl", &nan),
        ("empty.stl", b"solid x\nendsolid x\n"),
        ("none.stl", &[0; 84]),
        ("points.obj", b"v 0 0 0\nv 1 0 0\n"),
        ("lines.obj", b"v 0 0 0\nv 1 0 0\nl 1 2\n"),
        ("empty.gltf", b"{\"asset\":{\"version\":\"2.0\"}}"),
    ];
    for (name, bytes) in wrong {
        let path = write(folder, name, bytes);
        fails(
            &[&["ingest", &path, "-q"], &into[..]].concat(),
            1,
            &[name, "expected"],
        );
        let plan = ["ingest", &path, "-q", "--plan", "--jobs", "2"];
        fails(&[&plan, &into[..]].concat(), 1, &[name]);
        assert_eq!(show(), before, "{name}");
    }
    let points = text(&folder.join("points.obj")).to_owned();
    let lines = text(&folder.join("lines.obj")).to_owned();
    let both = [&["ingest", &points, &lines, "-q"], &into[..]].concat();
    fails(&both, 1, &["points.obj and 1 more inputs", "--allow-empty"]);

    // One of several may be empty, and all of them where that is meant.
    let one = ["ingest", &points, &model, "-q"];
    ok(&[&one, &into[..]].concat());
    let empty = ["ingest", &points, "-q", "--allow-empty"];
    ok(&[&empty, &into[..]].concat());
    assert_ne!(show(), before);
    let planned = [
        "ingest",
        &points,
        "-q",
        "--allow-empty",
        "--plan",
        "--jobs",
        "1",
    ];
    let planned = [&planned, &["--library", &library, "--scene", "planned"][..]].concat();
    ok(&planned);
    ok(&[
        "ingest",
        "--finish",
        "-q",
        "--library",
        &library,
        "--scene",
        "planned",
    ]);
    ok(&["show", "planned", "--library", &library]);
}

/// An OBJ that names other files, and a glTF whose image claims more pixels than it may.
#[test]
fn ingest_bounds_what_a_model_names() {
    let folder = tempfile::tempdir().unwrap();
    let library = folder.path().join("library");
    let report = folder.path().join("report.json");
    let ingest = |input: &Path, options: &[&str]| {
        let base = [
            "ingest",
            text(input),
            "--library",
            text(&library),
            "--scene",
            "s",
        ];
        run(&[&base[..], &["--report", text(&report)], options].concat())
    };
    let warnings = || json(&report)["warnings"].to_string();
    let obj = folder.path().join("model.obj");
    std::fs::write(folder.path().join("m.mtl"), "newmtl m\nKd 1 0 0\n").unwrap();
    std::fs::write(
        &obj,
        "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n",
    )
    .unwrap();
    assert!(ingest(&obj, &[]).status.success());
    assert!(!warnings().contains("left out"), "{}", warnings());
    assert!(ingest(&obj, &["--self-contained"]).status.success());
    assert!(
        warnings().contains("libraries left out (--self-contained)"),
        "{}",
        warnings()
    );

    let gltf = folder.path().join("model.gltf");
    let document = serde_json::json!({
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3"}],
        "images": [{"uri": "data:,%89PNG%0d%0a%1a%0a%00%00%00%0dIHDR%00%00%00%09%00%00%00%09"}],
        "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    });
    std::fs::write(&gltf, document.to_string()).unwrap();
    assert!(
        ingest(&gltf, &["--max-image-pixels", "80"])
            .status
            .success()
    );
    assert!(
        warnings().contains("of 9 x 9 pixels left out, above 80 (--max"),
        "{}",
        warnings()
    );
}
