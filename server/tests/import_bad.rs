//! Broken and unusual files: each is read right or refused in one clear line, in bounded time, and nothing panics.

// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::time::{Duration, Instant};

use lodestream_server::import::import;
use serde_json::Value;

const BAD: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/models/bad");

/// Refused by the specification's letter and by expected.json, but shown by other viewers: read
/// with a warning.
const READ_SINCE: [&str; 1] = ["node_two_parents.glb"];

/// What `import` made of a file, as against `case` of expected.json; the difference where there is one.
fn judge(name: &str, case: &Value) -> Result<(), String> {
    let path = Path::new(BAD).join(name);
    let start = Instant::now();
    let outcome = std::panic::catch_unwind(|| import(&path)).map_err(|_| "panics".to_owned())?;
    if start.elapsed() > Duration::from_secs(10) {
        return Err(format!("takes {:?}", start.elapsed()));
    }
    let expect = case["expect"].as_str().unwrap();
    match outcome {
        Ok(_) if expect == "reject" => Err("is read, should be refused".to_owned()),
        Ok(scene) => match case["triangles"].as_u64() {
            Some(triangles) if triangles != scene.source_triangles => {
                let found = scene.source_triangles;
                Err(format!("has {found} triangles, should have {triangles}"))
            }
            _ => consistent(&scene),
        },
        Err(error) => {
            let text = error.to_string();
            if expect == "accept" {
                return Err(format!("is refused: {text}"));
            }
            match text.lines().count() == 1 && text.contains(name) && text.len() < 2000 {
                true => Ok(()),
                false => Err(format!("has an unclear error: {text:?}")),
            }
        }
    }
}

/// What `ImportedScene` promises about its own indices and lengths.
fn consistent(scene: &lodestream_server::import::ImportedScene) -> Result<(), String> {
    let demand = |holds: bool, what: &str| match holds {
        true => Ok(()),
        false => Err(format!("breaks a promise: {what}")),
    };
    for mesh in &scene.meshes {
        let length = mesh.positions.len();
        let normals = mesh.normals.as_ref().unwrap();
        demand(normals.len() == length, "a normal a vertex")?;
        demand(
            mesh.uvs.as_ref().is_none_or(|it| it.len() == length),
            "a uv a vertex",
        )?;
        demand(
            mesh.colors.as_ref().is_none_or(|it| it.len() == length),
            "a colour a vertex",
        )?;
        let unit = |normal: &[f32; 3]| (glam::Vec3::from(*normal).length() - 1.0).abs() < 1e-5;
        demand(normals.iter().all(unit), "normals of unit length")?;
        let mut used = vec![false; length];
        for &[a, b, c] in &mesh.triangles {
            demand(a != b && b != c && c != a, "three different corners")?;
            for corner in [a, b, c] {
                *used
                    .get_mut(corner as usize)
                    .ok_or("breaks a promise: corners in range")? = true;
            }
        }
        demand(used.iter().all(|&it| it), "every vertex in use")?;
        demand(
            mesh.triangles.len() == mesh.triangle_materials.len(),
            "a slot a triangle",
        )?;
        let slots = mesh.material_slots.len();
        let in_range = |&slot: &u16| usize::from(slot) < slots;
        demand(
            mesh.triangle_materials.iter().all(in_range),
            "slots in range",
        )?;
        let known = |&material: &u32| (material as usize) < scene.materials.len();
        demand(mesh.material_slots.iter().all(known), "materials in range")?;
    }
    for instance in &scene.instances {
        demand(
            (instance.mesh as usize) < scene.meshes.len(),
            "meshes in range",
        )?;
        demand(instance.world_from_object.is_finite(), "finite transforms")?;
    }
    Ok(())
}

#[test]
fn every_bad_file_is_read_or_refused_as_expected() {
    let Ok(expected) = std::fs::read(Path::new(BAD).join("expected.json")) else {
        println!("SKIPPED: {BAD} is absent");
        return;
    };
    let expected: Value = serde_json::from_slice(&expected).unwrap();
    let mut wrong = Vec::new();
    for (name, case) in expected.as_object().unwrap() {
        if READ_SINCE.contains(&name.as_str()) {
            let scene = import(&Path::new(BAD).join(name)).unwrap();
            assert!(!scene.warnings.is_empty(), "{name}");
            assert_eq!(scene.source_triangles, 128, "{name}");
            continue;
        }
        if let Err(what) = judge(name, case) {
            wrong.push(format!("{name} {what} ({})", case["about"]));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Refusals for a reason that the message must name.
#[test]
fn refusals_name_their_reason() {
    if !Path::new(BAD).exists() {
        println!("SKIPPED: {BAD} is absent");
        return;
    }
    for (name, reason) in [
        ("ext_required_unknown.glb", "VENDOR_sparkles"),
        ("ext_draco.glb", "KHR_draco_mesh_compression"),
        ("ext_draco.glb", "decompress the file first"),
        ("uri_http.gltf", "http:"),
        ("uri_parent_folder.gltf", "below the model's folder"),
        (
            "position_nan.glb",
            "meshes[0].primitives[0].attributes.POSITION (accessor 0)",
        ),
        ("index_out_of_range.glb", "81 at element 100"),
        ("node_cycle.glb", "cycle"),
        ("node_diamond_40.glb", "one parent"),
        ("accessor_count_overflow.glb", "1537228672809129302"),
        ("json_number_overflow.gltf", "nodes[0].translation[0]"),
    ] {
        let text = match import(&Path::new(BAD).join(name)) {
            Ok(_) => panic!("{name} is read"),
            Err(error) => error.to_string(),
        };
        assert!(text.contains(reason), "{name}: {text}");
    }
}

/// Quantised and compressed, spot.glb is the plain one to within its quantisation step.
#[test]
fn quantized_and_compressed_files_agree_with_the_plain_one() {
    if !Path::new(BAD).exists() {
        println!("SKIPPED: {BAD} is absent");
        return;
    }
    for name in [
        "ext_quantized.glb",
        "ext_meshopt.glb",
        "ext_meshopt_float.glb",
    ] {
        agrees_with_spot(&Path::new(BAD).join(name));
    }
}

fn agrees_with_spot(path: &Path) {
    let corners = |path: &Path| {
        let scene = import(path).unwrap();
        assert_eq!(scene.source_triangles, 5856);
        let world = scene.instances[0].world_from_object;
        let mesh = &scene.meshes[0];
        let uvs = mesh.uvs.as_ref().unwrap();
        let rows = scene.materials[0]
            .uv_transform
            .unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let mut corners: Vec<[f64; 5]> = Vec::new();
        for &vertex in mesh.triangles.iter().flatten() {
            let at = mesh.positions[vertex as usize].map(f64::from);
            let at = world.transform_point3(at.into());
            let [u, v] = uvs[vertex as usize].map(f64::from);
            let [a, b, c, d, e, f] = rows.map(f64::from);
            corners.push([at.x, at.y, at.z, a * u + b * v + c, d * u + e * v + f]);
        }
        corners
    };
    let plain = corners(&Path::new(BAD).join("../spot.glb"));
    let quantized = corners(path);
    // gltfpack reorders triangles, so compare sums and bounds, which an error of transform or normalisation would move.
    for lane in 0..5 {
        let mean = |it: &[[f64; 5]]| it.iter().map(|it| it[lane]).sum::<f64>() / it.len() as f64;
        let most = |it: &[[f64; 5]]| it.iter().map(|it| it[lane]).fold(f64::MIN, f64::max);
        let least = |it: &[[f64; 5]]| it.iter().map(|it| it[lane]).fold(f64::MAX, f64::min);
        assert!(
            (mean(&plain) - mean(&quantized)).abs() < 1e-3,
            "{path:?}: mean of lane {lane}"
        );
        assert!(
            (most(&plain) - most(&quantized)).abs() < 2e-3,
            "{path:?}: maximum of lane {lane}"
        );
        assert!(
            (least(&plain) - least(&quantized)).abs() < 2e-3,
            "{path:?}: minimum of lane {lane}"
        );
    }
}
