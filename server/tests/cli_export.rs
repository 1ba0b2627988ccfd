//! `export` of the built binary: counts, areas, orientation, and the way back through import.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::path::Path;

use glam::{DAffine3, DQuat, DVec3};
use lodestream_server::import::{ImportedScene, import};
use serde_json::json;
use support::binary::{fails, ingested, json, ok, text};
use support::gltf::{self, DRAWN_TRIANGLES, SPHERE_TRIANGLES, TORUS_TRIANGLES};

/// A `.ply` of [`lodestream_server::export`].
struct Ply {
    is_double: bool,
    /// Corners in the world.
    triangles: Vec<[DVec3; 3]>,
}

fn read_ply(path: &Path) -> Ply {
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
    let is_double = text.contains("property double x");
    let point_bytes = if is_double { 24 } else { 12 };
    let (points, triangles) = bytes[header..].split_at(point_bytes * vertices);
    assert_eq!(triangles.len(), 13 * faces);
    let point = |index: u32| {
        let bytes = &points[point_bytes * index as usize..][..point_bytes];
        match is_double {
            true => DVec3::from(bytemuck::pod_read_unaligned::<[f64; 3]>(bytes)),
            false => glam::Vec3::from(bytemuck::pod_read_unaligned::<[f32; 3]>(bytes)).as_dvec3(),
        }
    };
    let corners = triangles.chunks_exact(13).map(|triangle| {
        assert_eq!(triangle[0], 3);
        bytemuck::pod_read_unaligned::<[u32; 3]>(&triangle[1..]).map(point)
    });
    Ply {
        is_double,
        triangles: corners.collect(),
    }
}

/// Triangles of a `.ply`, and their area in the world.
fn ply(path: &Path) -> (usize, f64) {
    let triangles = read_ply(path).triangles;
    let area = triangles
        .iter()
        .map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0);
    (triangles.len(), area.sum())
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
    // An independent reader takes it too, with all its checks.
    let judged = ::gltf::Gltf::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    assert!(judged.blob.is_some());
    let scene = lodestream_server::import::import(&file).unwrap();
    assert_eq!(judged.meshes().len(), scene.meshes.len());
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

/// Corners of all triangles in the world, sorted.
fn corners(scene: &ImportedScene) -> Vec<[f64; 3]> {
    let mut corners = Vec::new();
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh as usize];
        for &vertex in mesh.triangles.iter().flatten() {
            let position = mesh.positions[vertex as usize].map(f64::from);
            let world = instance.world_from_object.transform_point3(position.into());
            corners.push(world.to_array());
        }
    }
    corners.sort_by(|a, b| a.partial_cmp(b).unwrap());
    corners
}

/// UTM and ECEF, plain and turned: what is exported stands where the source does.
#[test]
fn placements_far_from_the_origin_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let [model, library, glb, ply] =
        ["far.gltf", "library", "far.glb", "far.ply"].map(|it| folder.path().join(it));
    // A tile of 0.75 m, whose corners lie on any grid that is finer.
    let tile: [f32; 12] = [
        0.0, 0.0, 0.0, 0.75, 0.0, 0.0, 0.75, 0.5, 0.0, 0.0, 0.5, 0.25,
    ];
    let order: [u16; 6] = [0, 1, 2, 0, 2, 3];
    let numbers = tile.iter().flat_map(|it| it.to_le_bytes());
    let bytes = numbers.chain(order.iter().flat_map(|it| it.to_le_bytes()));
    let uri: String = bytes.map(|byte| format!("%{byte:02x}")).collect();
    let turn = DQuat::from_rotation_y(0.3).to_array();
    let mut nodes = vec![];
    for [x, y, z] in [
        [456_789.123, 120.5, -5_428_123.456],
        [4_194_500.123, 4_780_123.5, -171_234.25],
    ] {
        for at in 0..5 {
            nodes.push(json!({"mesh": 0, "translation": [x + 0.3 * f64::from(at), y, z]}));
        }
        let scale = [2.0, 0.1, 1.0];
        nodes.push(
            json!({"mesh": 0, "translation": [x, y, z + 9.0], "rotation": turn, "scale": scale}),
        );
    }
    let document = json!({
        "asset": {"version": "2.0"}, "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4},
            {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 6},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12},
        ],
        "buffers": [{"byteLength": 60, "uri": format!("data:,{uri}")}],
    });
    std::fs::write(&model, document.to_string()).unwrap();
    let place = ["--library", text(&library), "--scene", "far", "-q"];
    ok(&[&["ingest", text(&model)][..], &place].concat());
    for out in [&glb, &ply] {
        ok(&[
            "export",
            "far",
            "--library",
            text(&library),
            "--source",
            "--out",
            text(out),
            "-q",
        ]);
    }
    let (source, again) = (import(&model).unwrap(), import(&glb).unwrap());
    let placements = |scene: &ImportedScene| -> Vec<DAffine3> {
        let instances = scene.instances.iter();
        instances.map(|it| it.world_from_object).collect()
    };
    assert_eq!(placements(&source), placements(&again));
    let expected = corners(&source);
    assert_eq!(expected.len(), 12 * 6);
    assert_eq!(corners(&again), expected);

    let written = read_ply(&ply);
    assert!(written.is_double);
    let mut found: Vec<[f64; 3]> = written
        .triangles
        .iter()
        .flatten()
        .map(DVec3::to_array)
        .collect();
    found.sort_by(|a, b| a.partial_cmp(b).unwrap());
    for (found, expected) in found.iter().zip(&expected) {
        // Roundings of f64 at 5,428,123.
        let distance = DVec3::from(*found).distance(DVec3::from(*expected));
        assert!(distance < 1e-8, "{found:?} {expected:?}");
    }
    assert_eq!(found.len(), expected.len());
}
