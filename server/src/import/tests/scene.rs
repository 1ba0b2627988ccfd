//! What stands in a file is what stands in the scene.

use glam::DVec3;
use serde_json::{Value, json};

use super::{File, QUAD, picture, quad};
use crate::import::scene::{AlphaMode, MediaType, SamplerWrap};

#[test]
fn nodes_that_share_a_mesh_become_instances_of_one() {
    let mut file = quad();
    let half_turn = [0.0, 1.0, 0.0, 0.0];
    file.json["nodes"] = json!([
        {"children": [1, 2], "translation": [10, 0, 0]},
        {"mesh": 0, "rotation": half_turn, "scale": [2, 2, 2]},
        {"mesh": 0, "matrix": [1,0,0,0, 0.5,1,0,0, 0,0,1,0, 0,3,0,1]},
    ]);
    let scene = file.scene();
    assert_eq!(scene.meshes.len(), 1);
    assert_eq!(scene.source_triangles, 2);
    let corner = DVec3::new(1.0, 1.0, 0.0);
    let placed: Vec<DVec3> = scene
        .instances
        .iter()
        .map(|it| it.world_from_object.transform_point3(corner))
        .collect();
    assert_eq!(scene.instances.len(), 2);
    assert!(
        placed[0].distance(DVec3::new(8.0, 2.0, 0.0)) < 1e-12,
        "{placed:?}"
    );
    assert!(
        placed[1].distance(DVec3::new(11.5, 4.0, 0.0)) < 1e-12,
        "{placed:?}"
    );
}

#[test]
fn gpu_instancing_places_relative_to_its_node() {
    let mut file = quad();
    let translation = file.floats(&[[0.0, 0.0, 0.0], [0.0, 5.0, 0.0]]);
    let attributes = json!({"attributes": {"TRANSLATION": translation}});
    file.json["nodes"][0]["translation"] = json!([1, 0, 0]);
    file.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": attributes});
    let places: Vec<DVec3> = file
        .scene()
        .instances
        .iter()
        .map(|it| it.world_from_object.translation)
        .collect();
    assert_eq!(places, [DVec3::X, DVec3::new(1.0, 5.0, 0.0)]);
}

#[test]
fn strips_and_fans_keep_their_winding() {
    let strip = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 2.0, 0.0],
    ];
    for (mode, positions, triangles) in [(5, &strip[..], 3), (6, &QUAD[..], 2)] {
        let mut file = File::new();
        let position = file.floats(positions);
        file.primitive(json!({"attributes": {"POSITION": position}, "mode": mode}));
        let scene = file.scene();
        let mesh = &scene.meshes[0];
        assert_eq!(mesh.triangles.len(), triangles);
        assert_eq!(scene.source_triangles, triangles as u64);
        // A flipped triangle would look down, and split its vertices.
        assert_eq!(mesh.positions.len(), positions.len());
        assert!(
            mesh.normals
                .as_ref()
                .unwrap()
                .iter()
                .all(|it| *it == [0.0, 0.0, 1.0])
        );
    }
}

#[test]
fn indices_of_one_byte_and_repeated_ones() {
    let mut file = File::new();
    let position = file.floats(&QUAD);
    let indices = file.accessor(&[0, 1, 2, 0, 2, 3, 1, 1, 2, 0], 5121, "SCALAR", 10);
    file.primitive(json!({"attributes": {"POSITION": position}, "indices": indices}));
    let scene = file.scene();
    assert_eq!(scene.meshes[0].triangles.len(), 2);
    assert_eq!(scene.source_triangles, 3);
    let warnings = scene.warnings.join("\n");
    assert!(
        warnings.contains("repeated index left out: 1 (at meshes[0].primitives[0])"),
        "{warnings}"
    );
    assert!(
        warnings.contains("last whole triangle left out: 1"),
        "{warnings}"
    );
}

#[test]
fn sparse_elements_replace_those_of_the_base() {
    let mut file = quad();
    let indices = file.view(&[1, 3]);
    let values: Vec<u8> = [[5.0f32, 0.0, 0.0], [0.0, 7.0, 0.0]]
        .iter()
        .flatten()
        .flat_map(|it| it.to_le_bytes())
        .collect();
    let values = file.view(&values);
    let sparse = json!({
        "count": 2, "indices": {"bufferView": indices, "componentType": 5121}, "values": {"bufferView": values},
    });
    file.json["accessors"][0]["sparse"] = sparse;
    let expected = [
        [0.0, 0.0, 0.0],
        [5.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 7.0, 0.0],
    ];
    assert_eq!(file.scene().meshes[0].positions, expected);
    file.json["accessors"][0]
        .as_object_mut()
        .unwrap()
        .remove("bufferView");
    let zero_based = [[0.0; 3], [5.0, 0.0, 0.0], [0.0; 3], [0.0, 7.0, 0.0]];
    let mut positions = file.scene().meshes.remove(0).positions;
    positions.dedup();
    assert!(
        positions.iter().all(|it| zero_based.contains(it)),
        "{positions:?}"
    );
    file.json["accessors"][0]["count"] = 1_000_000_000u64.into();
    assert!(file.fault().contains("a bufferView"), "{}", file.fault());
}

#[test]
fn quantized_attributes_are_read_only_under_their_extension() {
    let mut file = File::new();
    let shorts: [i16; 12] = [-32768, 0, 0, 0, 32767, 0, 0, 0, 0, 32767, 0, 0];
    let bytes: Vec<u8> = shorts.iter().flat_map(|it| it.to_le_bytes()).collect();
    let position = file.accessor(&bytes, 5122, "VEC3", 3);
    file.json["bufferViews"][0]["byteStride"] = 8.into();
    file.json["accessors"][position]["normalized"] = true.into();
    let normal = file.accessor(&[0, 0, 127, 0, 0, 0, 127, 0, 0, 0, 127, 0], 5120, "VEC3", 3);
    file.json["bufferViews"][1]["byteStride"] = 4.into();
    file.json["accessors"][normal]["normalized"] = true.into();
    let uv = file.accessor(&[0, 0, 0, 0, 255, 0, 0, 0, 0, 128, 0, 0], 5121, "VEC2", 3);
    file.json["bufferViews"][2]["byteStride"] = 4.into();
    file.primitive(
        json!({"attributes": {"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv}}),
    );
    let fault = file.fault();
    assert!(
        fault.contains(
            "attributes.POSITION (accessor 0).componentType: expected f32, found normalized i16"
        ),
        "{fault}"
    );
    file.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    let mesh = file.scene().meshes.remove(0);
    assert_eq!(
        mesh.positions,
        [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    );
    assert_eq!(mesh.normals.unwrap(), [[0.0, 0.0, 1.0]; 3]);
    assert_eq!(mesh.uvs.unwrap(), [[0.0, 0.0], [255.0, 0.0], [0.0, 128.0]]);
}

#[test]
fn primitives_share_vertices_and_drop_those_that_none_uses() {
    let mut file = File::new();
    let positions: Vec<[f32; 3]> = (0..100u8)
        .map(|at| [f32::from(at), f32::from(at % 2), 0.0])
        .collect();
    let position = file.floats(&positions);
    let normal = file.floats(&vec![[0.0, 0.0, 1.0]; 100]);
    file.json["materials"] = json!([{"name": "a"}, {"name": "b"}]);
    for (corners, material) in [([10, 11, 12], 1), ([11, 12, 13], 0), ([12, 13, 14], 1)] {
        let indices = file.indices(&corners);
        let attributes = json!({"POSITION": position, "NORMAL": normal});
        file.primitive(json!({"attributes": attributes, "indices": indices, "material": material}));
    }
    let mesh = file.scene().meshes.remove(0);
    assert_eq!(mesh.positions, &positions[10..15]);
    assert_eq!(mesh.triangles, [[0, 1, 2], [1, 2, 3], [2, 3, 4]]);
    assert_eq!(mesh.material_slots, [1, 0]);
    assert_eq!(mesh.triangle_materials, [0, 1, 0]);
}

#[test]
fn primitives_without_an_attribute_get_one_made() {
    let mut file = quad();
    let position = file.floats(&QUAD.map(|[x, y, _]| [x, 0.0, y]));
    let normal = file.floats(&[[0.0, 3.0, 0.0], [0.0; 3], [f32::NAN; 3], [0.0, 1.0, 0.0]]);
    let uv = file.floats(&[[0.5, 0.25]; 4]);
    let color = file.floats(&[[0.5, 0.0, 2.0]; 4]);
    let indices = file.indices(&[0, 2, 1, 0, 3, 2]);
    let attributes =
        json!({"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv, "COLOR_0": color});
    file.primitive(json!({"attributes": attributes, "indices": indices}));
    let scene = file.scene();
    let mesh = &scene.meshes[0];
    let (normals, uvs, colors) = (
        mesh.normals.as_ref().unwrap(),
        mesh.uvs.as_ref().unwrap(),
        mesh.colors.as_ref().unwrap(),
    );
    assert_eq!(
        [mesh.positions.len(), normals.len(), uvs.len(), colors.len()],
        [8; 4]
    );
    let expected = [
        ([0.0, 0.0, 1.0], [0.0, 0.0], [255; 4]),
        ([0.0, 1.0, 0.0], [0.5, 0.25], [128, 0, 255, 255]),
    ];
    for (at, triangle) in mesh.triangles.iter().enumerate() {
        for &vertex in triangle {
            let vertex = vertex as usize;
            assert_eq!(
                (normals[vertex], uvs[vertex], colors[vertex]),
                expected[at / 2]
            );
        }
    }
    let warnings = scene.warnings.join("\n");
    for (what, amount) in [
        ("without texture coordinates", 4),
        ("brought to unit length", 1),
        ("of no length made anew", 2),
        ("clamped to 0..1", 4),
    ] {
        let line = scene.warnings.iter().find(|it| it.contains(what));
        assert!(
            line.is_some_and(|it| it.contains(&format!(": {amount} ("))),
            "{what}: {warnings}"
        );
    }
}

#[test]
fn materials_carry_their_texture_sampler_and_transform() {
    let mut file = quad();
    let png = picture(image::ImageFormat::Png);
    let view = file.view(&png);
    file.json["images"] = json!([
        {"bufferView": view, "mimeType": "image/jpeg"}, {"bufferView": view}, {"uri": "data:,RIFF....WEBPVP8 "},
    ]);
    file.json["samplers"] = json!([{"magFilter": 9728, "wrapS": 33071, "wrapT": 33648}]);
    file.json["textures"] = json!([
        {"source": 0, "sampler": 0}, {"source": 1}, {"source": 2}, {"extensions": {"EXT_texture_webp": {"source": 2}}},
    ]);
    let quarter = std::f32::consts::FRAC_PI_2;
    let transform = json!({"offset": [0.5, 0.25], "rotation": quarter, "scale": [2, 3]});
    let textured = |texture: Value| json!({"pbrMetallicRoughness": {"baseColorTexture": texture}});
    file.json["materials"] = json!([
        textured(json!({"index": 0, "extensions": {"KHR_texture_transform": transform}})),
        textured(json!({"index": 1})), textured(json!({"index": 2})), textured(json!({"index": 3})),
        {
            "alphaMode": "MASK", "alphaCutoff": 0.75, "doubleSided": true, "emissiveFactor": [0, 0.5, 1],
            "extensions": {"KHR_materials_unlit": {}, "KHR_materials_emissive_strength": {"emissiveStrength": 4}},
            "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 2.0], "metallicFactor": 0, "roughnessFactor": 0.5},
            "normalTexture": {"index": 0},
        },
    ]);
    file.json["meshes"][0]["primitives"][0]["material"] = 4.into();
    let scene = file.scene();
    assert_eq!(scene.images.len(), 1, "one view, one image");
    let image = &scene.images[0];
    assert_eq!(
        (image.media_type, image.width, image.height),
        (MediaType::Png, 3, 2)
    );
    assert_eq!(image.bytes, png);
    let images: Vec<_> = scene
        .materials
        .iter()
        .map(|it| it.base_color_image)
        .collect();
    assert_eq!(images, [Some(0), Some(0), None, None, None]);
    let first = &scene.materials[0];
    assert_eq!(
        (first.wrap_u, first.wrap_v, first.nearest),
        (SamplerWrap::Clamp, SamplerWrap::Mirror, true)
    );
    let expected = [0.0, 3.0, 0.5, -2.0, 0.0, 0.25];
    for (found, expected) in first.uv_transform.unwrap().iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6, "{:?}", first.uv_transform);
    }
    let last = &scene.materials[4];
    assert_eq!(last.alpha_mode, AlphaMode::Mask(0.75));
    assert!(last.double_sided && last.unlit);
    assert_eq!(last.emissive_factor, [0.0, 2.0, 4.0]);
    assert_eq!(last.base_color_factor, [0.1, 0.2, 0.3, 1.0]);
    assert_eq!((last.metallic, last.roughness), (0.0, 0.5));
    let warnings = scene.warnings.join("\n");
    for part in [
        "type image/webp",
        "EXT_texture_webp",
        "normalTexture",
        "factors clamped to what they may be",
    ] {
        assert!(warnings.contains(part), "{part}: {warnings}");
    }
}

#[test]
fn the_default_material_follows_only_where_it_is_used() {
    let mut file = quad();
    file.json["materials"] = json!([{"name": "unused"}]);
    let scene = file.scene();
    assert_eq!(scene.materials.len(), 2);
    assert_eq!(scene.meshes[0].material_slots, [1]);
    file.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    assert_eq!(file.scene().materials.len(), 1);
}

#[test]
fn only_the_chosen_scene_is_read() {
    let mut file = quad();
    let mesh = file.json["meshes"][0].clone();
    file.push("meshes", mesh);
    file.json["nodes"] = json!([{"mesh": 0}, {"mesh": 1}, {"mesh": 1, "translation": [1, 0, 0]}]);
    file.json["scenes"] = json!([{"nodes": [0]}, {"name": "second", "nodes": [2, 1]}, {}]);
    file.json["scene"] = 1.into();
    let scene = file.scene();
    assert_eq!((scene.name.as_str(), scene.meshes.len()), ("second", 1));
    let places: Vec<_> = scene
        .instances
        .iter()
        .map(|it| (it.mesh, it.world_from_object.translation))
        .collect();
    assert_eq!(places, [(0, DVec3::X), (0, DVec3::ZERO)]);
    let root = file.json.as_object_mut().unwrap();
    root.remove("scene");
    assert_eq!(file.scene().instances.len(), 1);
    file.json.as_object_mut().unwrap().remove("scenes");
    assert_eq!(file.scene().instances.len(), 3);
}

/// The extension's own example: "only the lower left quadrant of the source image, rotated clockwise 90 degrees".
#[test]
fn a_texture_transform_turns_as_its_specification_shows() {
    let mut file = quad();
    let view = file.view(&picture(image::ImageFormat::Png));
    file.json["images"] = json!([{"bufferView": view}]);
    file.json["textures"] = json!([{"source": 0}]);
    let transform =
        json!({"offset": [0, 1], "rotation": std::f64::consts::FRAC_PI_2, "scale": [0.5, 0.5]});
    let texture = json!({"index": 0, "extensions": {"KHR_texture_transform": transform}});
    file.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": texture}}]);
    let [a, b, c, d, e, f] = file.scene().materials[0].uv_transform.unwrap();
    for [u, v] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]] {
        let [u, v] = [a * u + b * v + c, d * u + e * v + f];
        let inside = (-1e-6..0.5 + 1e-6).contains(&u) && (0.5 - 1e-6..1.0 + 1e-6).contains(&v);
        assert!(inside, "{u} {v}");
    }
}
