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

/// World boxes by a reader in Python, in f64: joints, weights and the transforms of nodes,
/// as the files write them.
const SKINNED: [(&str, [f64; 3], [f64; 3]); 14] = [
    (
        "RiggedSimple/RiggedSimple.glb",
        [-1.000000, -4.575077, -1.000000],
        [1.000000, 4.575077, 1.000000],
    ),
    (
        "CesiumMan/CesiumMan.glb",
        [-0.131000, 0.000000, -0.569137],
        [0.180954, 1.506550, 0.569137],
    ),
    (
        "asset-generator/Animation_Skin/Animation_Skin_00.gltf",
        [-0.250000, -0.200000, -0.100000],
        [0.250000, 0.173205, 0.000000],
    ),
    (
        "asset-generator/Animation_Skin/Animation_Skin_01.gltf",
        [-0.250000, -0.200000, -0.100000],
        [0.250000, 0.173205, 0.000000],
    ),
    (
        "asset-generator/Animation_Skin/Animation_Skin_02.gltf",
        [-0.250000, -0.200000, -0.100000],
        [0.250000, 0.173205, 0.000000],
    ),
    (
        "asset-generator/Animation_Skin/Animation_Skin_03.gltf",
        [-0.250000, -0.400000, -0.100000],
        [0.250000, 0.173205, 0.000000],
    ),
    (
        "asset-generator/Animation_Skin/Animation_Skin_04.gltf",
        [-0.250000, -0.200000, -0.100000],
        [0.250000, 0.173205, 0.198205],
    ),
    (
        "asset-generator/Animation_Skin/Animation_Skin_05.gltf",
        [-0.250000, -0.200000, -0.100000],
        [0.850000, 0.173205, 0.000000],
    ),
    (
        "asset-generator/Animation_Skin/Animation_Skin_06.gltf",
        [-0.250000, -0.200000, -0.100000],
        [0.250000, 0.173205, 0.000000],
    ),
    (
        "asset-generator/Animation_Skin/Animation_Skin_07.gltf",
        [-0.480000, -0.300000, -0.480000],
        [0.480000, 0.300000, 0.480000],
    ),
    (
        "asset-generator/Animation_Skin/Animation_Skin_08.gltf",
        [-0.250000, -0.400000, -0.203134],
        [0.250000, 0.358105, 0.000000],
    ),
    (
        "asset-generator/Animation_Skin/Animation_Skin_09.gltf",
        [-0.250000, -0.500000, 0.000000],
        [0.250000, 0.500000, 0.200000],
    ),
    (
        "asset-generator/Animation_Skin/Animation_Skin_10.gltf",
        [-0.375000, -0.250000, -0.189705],
        [0.375000, 0.457988, 0.000000],
    ),
    (
        "asset-generator/Animation_Skin/Animation_Skin_11.gltf",
        [-0.250000, -0.200000, -0.100000],
        [0.850000, 0.173205, 0.000000],
    ),
];

#[test]
fn skinned_models_stand_where_their_joints_take_them() {
    let folder = Path::new(MODELS).join("khronos");
    if !folder.exists() {
        println!("SKIPPED: {} is absent", folder.display());
        return;
    }
    for (name, least, most) in SKINNED {
        let scene = import(&folder.join(name)).unwrap();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for instance in &scene.instances {
            for position in &scene.meshes[instance.mesh as usize].positions {
                let position = DVec3::from(position.map(f64::from));
                let world = instance.world_from_object.transform_point3(position);
                (low, high) = (low.min(world), high.max(world));
            }
        }
        let size = (DVec3::from(most) - DVec3::from(least)).max_element();
        let off = (low - DVec3::from(least))
            .abs()
            .max((high - DVec3::from(most)).abs());
        assert!(
            off.max_element() < 2e-6 * size.max(1.0),
            "{name}: {low} {high}"
        );
    }
}
