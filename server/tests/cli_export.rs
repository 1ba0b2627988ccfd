//! `export` of the built binary: counts, areas, orientation, and the way back through import.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::path::Path;

use support::binary::{fails, ingested, json, ok, text};
use support::gltf::{self, DRAWN_TRIANGLES, SPHERE_TRIANGLES, TORUS_TRIANGLES};

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

/// Flat beside rough, over many pages: a rough part is refined whose page also holds flat groups, and what those inherit from lies in
/// pages that hold nothing refined.
#[test]
fn a_cut_of_flat_and_rough_ground_is_exported() {
    const SIDE: u32 = 360;
    let folder = tempfile::tempdir().unwrap();
    let [model, library, out] =
        ["ground.obj", "library", "cut.ply"].map(|it| folder.path().join(it));
    let mut obj = String::new();
    let places = (0..=SIDE).flat_map(|y| (0..=SIDE).map(move |x| (x, y)));
    for (x, y) in places {
        let noise = (x * 7_919 + y * 104_729).wrapping_mul(2_654_435_761) >> 16;
        let z = match x > SIDE / 2 {
            true => f64::from(noise) / 65_536.0,
            false => 0.0,
        };
        obj += &format!("v {x} {y} {z}\n");
    }
    for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
        let a = y * (SIDE + 1) + x + 1;
        let [b, c, d] = [a + 1, a + SIDE + 2, a + SIDE + 1];
        obj += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
    }
    std::fs::write(&model, obj).unwrap();
    let place = ["--library", text(&library), "--scene", "ground", "-q"];
    ok(&[&["ingest", text(&model)][..], &place].concat());
    let mut last = usize::MAX;
    for error in ["0.01", "0.1", "0.25", "0.4", "0.7", "1"] {
        ok(&[
            "export",
            "ground",
            "--library",
            text(&library),
            "--out",
            text(&out),
            "--error",
            error,
            "-q",
        ]);
        let (faces, area) = ply(&out);
        assert!(faces <= last, "{error}: {faces} of {last}");
        assert!(area > f64::from(SIDE * SIDE) * 0.9, "{error}: {area}");
        last = faces;
    }
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

#[test]
fn a_real_model_goes_in_and_out_whole() {
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/models/spot.glb");
    if !Path::new(model).exists() {
        println!("SKIPPED: no ../shared/models/spot.glb");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (library, file) = (
        folder.path().join("library"),
        folder.path().join("spot.ply"),
    );
    ok(&[
        "ingest",
        model,
        "--library",
        text(&library),
        "--scene",
        "spot",
        "-q",
    ]);
    ok(&["verify", "--library", text(&library), "-q"]);
    ok(&[
        "export",
        "spot",
        "--library",
        text(&library),
        "--source",
        "--out",
        text(&file),
        "-q",
    ]);
    assert_eq!(ply(&file).0, 5856, "the triangles of the file");
}
