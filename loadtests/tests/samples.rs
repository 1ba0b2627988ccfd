//! The sample scenes as a user gets them: pinned bytes, and files that the server imports without a warning.
#![allow(clippy::unwrap_used)] // A test that cannot read its own file should stop there.

use std::path::{Path, PathBuf};

use lodestream_format::ContentHash;
use lodestream_loadtests::samples::{Glb, city, crowd, rock};
use lodestream_server::import::{ImportedScene, import};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples")
}

fn imported(glb: &Glb) -> ImportedScene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sample.glb");
    glb.write(&path).unwrap();
    import(&path).unwrap()
}

fn instanced_triangles(scene: &ImportedScene) -> u64 {
    let triangles = |mesh: u32| scene.meshes[mesh as usize].triangles.len() as u64;
    scene.instances.iter().map(|i| triangles(i.mesh)).sum()
}

/// Changing a scene on purpose means changing its hash here, and its rows in `samples/README.md`.
#[test]
fn bytes_are_pinned() {
    let hash = |glb: Glb| ContentHash::of(&glb.to_bytes().unwrap()).to_string();
    assert_eq!(
        hash(city(4000, 24, 1)),
        "a6fa7ce1b0627cab0fdef91f6c9cf9c9204488bf1ee79db098a98c70e77b9ed6"
    );
    assert_eq!(
        hash(rock(300_000, 1)),
        "8c7ed43f47866d7b0cb0ed5d83db12f5bb7540e951cbd4dbb04f1441f606b48b"
    );
    assert_ne!(hash(rock(12_000, 1)), hash(rock(12_000, 2)));
    assert_ne!(hash(city(200, 8, 1)), hash(city(200, 8, 2)));
}

#[test]
fn the_server_imports_the_city_whole() {
    let glb = city(4000, 24, 1);
    let scene = imported(&glb);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert_eq!(scene.instances.len() as u64, glb.instances);
    assert_eq!(instanced_triangles(&scene), glb.instanced_triangles);
    assert_eq!(scene.meshes.len(), 24);
    assert_eq!(scene.images.len(), 5);
    let tree = scene
        .meshes
        .iter()
        .find(|m| m.name.starts_with("tree"))
        .unwrap();
    assert!(tree.uvs.is_none() && tree.colors.is_some());
}

#[test]
fn the_server_imports_the_crowd_whole() {
    let glb = crowd(90, 500, 1);
    let scene = imported(&glb);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert_eq!((scene.instances.len(), scene.meshes.len()), (95, 6));
    assert_eq!(instanced_triangles(&scene), glb.instanced_triangles);
    let of_first = scene.instances.iter().filter(|it| it.mesh == 0);
    assert_eq!(of_first.count(), 90);
}

#[test]
fn the_server_imports_the_rock_whole() {
    let glb = rock(12_000, 1);
    let scene = imported(&glb);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert_eq!(instanced_triangles(&scene), glb.unique_triangles);
    assert!(scene.meshes[0].uvs.is_none() && scene.meshes[0].colors.is_some());
}

#[test]
fn the_server_imports_the_scan_whole() {
    let scene = import(&folder().join("belweder.glb")).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert_eq!(instanced_triangles(&scene), 169_470);
    assert_eq!(scene.images.len(), 1);
}

/// Every path has rising key frames within its length, unit-free sizes, and never looks from where it looks to.
#[test]
fn camera_paths_are_well_formed() {
    for name in ["city", "rock", "belweder"] {
        let text = std::fs::read_to_string(folder().join(format!("{name}.path.json"))).unwrap();
        let path: serde_json::Value = serde_json::from_str(&text).unwrap();
        let frames = path["frames"].as_u64().unwrap();
        let keys = path["keys"].as_array().unwrap();
        let at: Vec<u64> = keys
            .iter()
            .map(|key| key["frame"].as_u64().unwrap())
            .collect();
        assert!(at.is_sorted_by(|a, b| a < b), "{name}: {at:?}");
        assert_eq!(
            (at.first(), at.last()),
            (Some(&0), Some(&(frames - 1))),
            "{name}"
        );
        for key in keys {
            assert_ne!(key["eye"], key["target"], "{name}");
            assert!(
                (1.0..170.0).contains(&key["fov_degrees"].as_f64().unwrap()),
                "{name}"
            );
        }
    }
}
