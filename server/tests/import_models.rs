//! Real models: what is imported agrees with what their manifest says.

// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use glam::DVec3;
use lodestream_server::import::{ImportedScene, import};
use serde_json::Value;

const MODELS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/models");

#[test]
fn every_model_agrees_with_the_manifest() {
    let Ok(manifest) = std::fs::read(Path::new(MODELS).join("manifest.json")) else {
        println!("SKIPPED: {MODELS} is absent");
        return;
    };
    let manifest: Value = serde_json::from_slice(&manifest).unwrap();
    for (name, model) in manifest.as_object().unwrap() {
        let scene = import(&Path::new(MODELS).join(name)).unwrap();
        check(name, model, &scene);
    }
}

fn check(name: &str, model: &Value, scene: &ImportedScene) {
    let number = |key: &str| model[key].as_u64().unwrap();
    assert_eq!(scene.source_triangles, number("triangles"), "{name}");
    assert_eq!(scene.meshes.len() as u64, number("meshes"), "{name}");
    assert_eq!(scene.instances.len() as u64, number("instances"), "{name}");
    assert_eq!(scene.materials.len() as u64, number("materials"), "{name}");
    assert!(scene.images.len() as u64 <= number("images"), "{name}");

    let attributes = model["attributes"].as_array().unwrap();
    let has = |attribute: &str| attributes.iter().any(|it| it == attribute);
    let any_uvs = scene.meshes.iter().any(|it| it.uvs.is_some());
    let any_colors = scene.meshes.iter().any(|it| it.colors.is_some());
    assert_eq!(any_uvs, has("TEXCOORD_0"), "{name}");
    assert_eq!(any_colors, has("COLOR_0"), "{name}");
    assert!(scene.meshes.iter().all(|it| it.normals.is_some()), "{name}");

    let repeated = scene.source_triangles
        - scene
            .meshes
            .iter()
            .map(|it| it.triangles.len() as u64)
            .sum::<u64>();
    let noted = scene
        .warnings
        .iter()
        .any(|it| it.starts_with("triangles with a repeated index"));
    assert_eq!(repeated > 0, noted, "{name}: {:?}", scene.warnings);

    // The manifest's box is over the vertices as stored, before any node.
    let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for position in scene.meshes.iter().flat_map(|it| &it.positions) {
        let position = DVec3::from(position.map(f64::from));
        (least, most) = (least.min(position), most.max(position));
    }
    for (key, found) in [("bbox_min", least), ("bbox_max", most)] {
        for (axis, expected) in model[key].as_array().unwrap().iter().enumerate() {
            let expected = expected.as_f64().unwrap();
            let tolerance = 1e-5 * expected.abs().max(1e-3);
            assert!(
                (found[axis] - expected).abs() <= tolerance,
                "{name} {key}: {found}, {expected}"
            );
        }
    }
}

#[test]
fn a_vertex_array_shared_by_48_primitives_is_not_copied() {
    let path = Path::new(MODELS).join("pathological.glb");
    if !path.exists() {
        println!("SKIPPED: {MODELS} is absent");
        return;
    }
    let scene = import(&path).unwrap();
    let find = |part: &str| {
        scene
            .meshes
            .iter()
            .find(|it| it.name.contains(part))
            .unwrap()
    };
    let shared = find("48_primitives");
    assert!(
        shared.positions.len() < shared.triangles.len(),
        "{}",
        shared.positions.len()
    );
    assert!(find("5000_unreferenced").positions.len() < 5000);
}
