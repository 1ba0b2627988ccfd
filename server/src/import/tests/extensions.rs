//! Extensions: read, or left out by name.

use serde_json::{Value, json};

use super::{File, QUAD, find, picture, quad};

/// A quad with two sets of texture coordinates and a material that uses `texture`.
fn with_two_uv_sets(texture: Value) -> File {
    let mut file = quad();
    let uvs = [
        file.floats(&[[0.25, 0.25]; 4]),
        file.floats(&[[0.75, 0.75]; 4]),
    ];
    let attributes = &mut file.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["TEXCOORD_0"] = uvs[0].into();
    attributes["TEXCOORD_1"] = uvs[1].into();
    let view = file.view(&picture(image::ImageFormat::Png));
    file.json["images"] = json!([{"bufferView": view}]);
    file.json["textures"] = json!([{"source": 0}]);
    file.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": texture}}]);
    file.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    file
}

#[test]
fn the_texture_chooses_among_the_texture_coordinates() {
    let transform = |set: u32| json!({"KHR_texture_transform": {"texCoord": set}});
    for (texture, uv) in [
        (json!({"index": 0}), 0.25),
        (json!({"index": 0, "texCoord": 1}), 0.75),
        (json!({"index": 0, "extensions": transform(1)}), 0.75),
        (
            json!({"index": 0, "texCoord": 1, "extensions": transform(0)}),
            0.25,
        ),
    ] {
        let scene = with_two_uv_sets(texture.clone()).scene();
        assert_eq!(scene.materials[0].base_color_image, Some(0), "{texture}");
        assert_eq!(scene.meshes[0].uvs, Some(vec![[uv, uv]; 4]), "{texture}");
        let other = if uv == 0.25 {
            "TEXCOORD_1"
        } else {
            "TEXCOORD_0"
        };
        find(&scene.warnings, &format!("attributes {other} left out"));
    }
    let missing = with_two_uv_sets(json!({"index": 0, "texCoord": 2})).scene();
    assert_eq!(missing.meshes[0].uvs, None);
    find(&missing.warnings, "textured primitives without TEXCOORD_2");
}

/// One vertex array, two materials that look at different sets.
#[test]
fn primitives_may_choose_different_texture_coordinates() {
    let mut file = with_two_uv_sets(json!({"index": 0}));
    let second = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}});
    file.push("materials", second);
    let mut primitive = file.json["meshes"][0]["primitives"][0].clone();
    primitive["material"] = 1.into();
    file.primitive(primitive);
    let mesh = file.scene().meshes.remove(0);
    let uvs = mesh.uvs.unwrap();
    for (triangle, slot) in mesh.triangles.iter().zip(&mesh.triangle_materials) {
        let expected = [[0.25; 2], [0.75; 2]][usize::from(*slot)];
        assert!(triangle.iter().all(|&it| uvs[it as usize] == expected));
    }
}

#[test]
fn extensions_of_looks_are_left_out_by_name_even_where_required() {
    const LOOKS: [&str; 10] = [
        "anisotropy",
        "clearcoat",
        "dispersion",
        "ior",
        "iridescence",
        "sheen",
        "specular",
        "transmission",
        "variants",
        "volume",
    ];
    let mut file = quad();
    let names = LOOKS.map(|name| format!("KHR_materials_{name}"));
    file.json["extensionsUsed"] = json!(names);
    file.json["extensionsRequired"] = json!(names);
    let extensions = names.iter().filter(|it| !it.ends_with("variants"));
    let extensions: serde_json::Map<String, Value> =
        extensions.map(|name| (name.clone(), json!({}))).collect();
    file.json["materials"] = json!([{"extensions": extensions}]);
    file.json["extensions"] = json!({"KHR_materials_variants": {"variants": [{"name": "red"}]}});
    let mapping = json!({"mappings": [{"material": 0, "variants": [0]}]});
    file.json["meshes"][0]["primitives"][0]["extensions"] =
        json!({"KHR_materials_variants": mapping});
    let warnings = file.scene().warnings;
    for name in names {
        let line = find(&warnings, &name);
        assert!(line.contains("left out"), "{line}");
        assert_eq!(warnings.iter().filter(|it| it.contains(&name)).count(), 1);
    }
}

#[test]
fn specular_glossiness_becomes_metallic_roughness() {
    let convert = |model: Value| {
        let mut file = quad();
        let extensions = json!({"KHR_materials_pbrSpecularGlossiness": model});
        file.json["extensionsRequired"] = json!(["KHR_materials_pbrSpecularGlossiness"]);
        file.json["materials"] = json!([{
            "extensions": extensions, "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 1, 1]},
        }]);
        let view = file.view(&picture(image::ImageFormat::Png));
        file.json["images"] = json!([{"bufferView": view}]);
        file.json["textures"] = json!([{"source": 0}]);
        file.scene().materials.remove(0)
    };
    // No metal: the diffuse colour stays, but for what the surface mirrors.
    let plastic = convert(json!({
        "diffuseFactor": [0.5, 0.25, 0.1, 0.5], "specularFactor": [0.04, 0.04, 0.04], "glossinessFactor": 0.75,
    }));
    assert_eq!(plastic.metallic, 0.0);
    assert_eq!(plastic.roughness, 0.25);
    for (found, expected) in plastic.base_color_factor.iter().zip([0.5, 0.25, 0.1, 0.5]) {
        assert!((found - expected).abs() < 1e-5, "{plastic:?}");
    }
    // Gold: no diffuse colour, all of it mirrored.
    let gold =
        convert(json!({"diffuseFactor": [0, 0, 0, 1], "specularFactor": [1.0, 0.766, 0.336]}));
    assert!(gold.metallic > 0.99, "{gold:?}");
    for (found, expected) in gold.base_color_factor.iter().zip([1.0, 0.766, 0.336, 1.0]) {
        assert!((found - expected).abs() < 0.02, "{gold:?}");
    }
    // A diffuse texture is multiplied by what the specular factor leaves of the light.
    for (model, image, base, metallic) in [
        (json!({"specularFactor": [0, 0, 0]}), Some(0), 1.0, 0.0),
        (
            json!({"specularFactor": [0.4, 0.4, 0.4]}),
            Some(0),
            1.0,
            0.375,
        ),
        (
            json!({"diffuseFactor": [0.2, 0.2, 0.2, 1], "specularFactor": [0, 0, 0]}),
            Some(0),
            0.2,
            0.0,
        ),
        // Nothing: a mirror, which is the default.
        (json!({"specularFactor": [1, 1, 1]}), None, 1.0, 1.0),
        (json!({}), None, 1.0, 1.0),
        // Each texel says how much.
        (
            json!({"specularGlossinessTexture": {"index": 0}}),
            Some(0),
            1.0,
            0.0,
        ),
    ] {
        let mut textured = model.clone();
        textured["diffuseTexture"] = json!({"index": 0});
        let found = convert(textured);
        assert_eq!(found.base_color_image, image, "{model}");
        assert!(
            (found.metallic - metallic).abs() < 1e-3,
            "{model}: {found:?}"
        );
        let darkest = if base == 0.2 { 0.2 / 0.96 } else { base };
        assert!(
            (found.base_color_factor[0] - darkest).abs() < 1e-3,
            "{model}: {found:?}"
        );
    }
}

#[test]
fn draco_is_refused_by_name_unless_plain_data_stands_beside() {
    let mut file = quad();
    let draco =
        json!({"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}});
    file.json["meshes"][0]["primitives"][0]["extensions"] = draco;
    file.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    find(
        &file.scene().warnings,
        "KHR_draco_mesh_compression left out, the plain data",
    );
    file.json["accessors"][0]
        .as_object_mut()
        .unwrap()
        .remove("bufferView");
    let fault = file.fault();
    assert!(
        fault.contains("meshes[0].primitives[0]: KHR_draco_mesh_compression is not supported; decompress the file first"),
        "{fault}"
    );
    file.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    assert!(
        file.fault().contains("decompress the file first"),
        "{}",
        file.fault()
    );
}

/// Compresses the views of a quad with normals and colours.
fn compressed(name: &str, mode: &str) -> File {
    let mut file = File::new();
    file.json["buffers"] =
        json!([{}, {"byteLength": 4096, "extensions": {name: {"fallback": true}}}]);
    file.json["extensionsUsed"] = json!([name, "KHR_mesh_quantization"]);
    file.json["extensionsRequired"] = json!([name]);
    let view =
        |file: &mut File, bytes: &[u8], stride: usize, count: usize, mode: &str, filter: &str| {
            let view = file.view(bytes);
            let here = &mut file.json["bufferViews"][view];
            let mut extension = here.clone();
            extension["byteStride"] = stride.into();
            extension["count"] = count.into();
            extension["mode"] = mode.into();
            if filter != "NONE" {
                extension["filter"] = filter.into();
            }
            let mut fallback = json!({
                "buffer": 1, "byteLength": stride * count, "extensions": {name: extension},
            });
            if mode == "ATTRIBUTES" {
                fallback["byteStride"] = stride.into();
            }
            *here = fallback;
            view
        };
    // Exponential: each float is a mantissa of 24 bits and an exponent.
    let exponents = meshopt::encode_filter_exp(&QUAD, 24, meshopt::EncodeExpMode::Separate);
    let positions = meshopt::encode_vertex_buffer(&exponents).unwrap();
    let positions = view(&mut file, &positions, 12, 4, "ATTRIBUTES", "EXPONENTIAL");
    let normals: Vec<[i8; 4]> = meshopt::encode_filter_oct(&[[0.0, 0.6, 0.8, 0.0]; 4], 8);
    let normals = meshopt::encode_vertex_buffer(&normals).unwrap();
    let normals = view(&mut file, &normals, 4, 4, "ATTRIBUTES", "OCTAHEDRAL");
    let colors = [[255u8, 0, 128, 64]; 4];
    let colors = meshopt::encode_vertex_buffer(&colors).unwrap();
    let colors = view(&mut file, &colors, 4, 4, "ATTRIBUTES", "NONE");
    let order = [0, 1, 2, 0, 2, 3];
    let indices = match mode {
        "TRIANGLES" => meshopt::encode_index_buffer(&order, 4).unwrap(),
        _ => meshopt::encode_index_sequence(&order, 4).unwrap(),
    };
    let indices = view(&mut file, &indices, 2, 6, mode, "NONE");
    let mut accessor = |view: usize, component: u32, kind: &str, count: usize, normalized: bool| {
        let accessor = json!({
            "bufferView": view, "componentType": component, "type": kind, "count": count, "normalized": normalized,
        });
        file.push("accessors", accessor)
    };
    let attributes = json!({
        "POSITION": accessor(positions, 5126, "VEC3", 4, false),
        "NORMAL": accessor(normals, 5120, "VEC3", 4, true),
        "COLOR_0": accessor(colors, 5121, "VEC4", 4, true),
    });
    let indices = accessor(indices, 5123, "SCALAR", 6, false);
    file.primitive(json!({"attributes": attributes, "indices": indices}));
    file
}

#[test]
fn meshopt_views_are_decompressed_under_both_names() {
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        for mode in ["TRIANGLES", "INDICES"] {
            let mesh = compressed(name, mode).scene().meshes.remove(0);
            // The triangle codec may turn a triangle, so compare what is drawn.
            let mut corners: Vec<[f32; 3]> = mesh
                .triangles
                .iter()
                .flatten()
                .map(|&it| mesh.positions[it as usize])
                .collect();
            let mut expected: Vec<[f32; 3]> = [0, 1, 2, 0, 2, 3].map(|it| QUAD[it]).to_vec();
            corners.sort_by(|a, b| a.partial_cmp(b).unwrap());
            expected.sort_by(|a, b| a.partial_cmp(b).unwrap());
            assert_eq!(corners, expected);
            for normal in mesh.normals.unwrap() {
                let normal = glam::Vec3::from(normal);
                assert!(
                    normal.distance(glam::Vec3::new(0.0, 0.6, 0.8)) < 0.02,
                    "{normal}"
                );
            }
            assert_eq!(mesh.colors.unwrap(), [[255, 0, 128, 64]; 4]);
        }
    }
}

#[test]
fn meshopt_views_that_lie_are_refused_by_name() {
    const NAME: &str = "EXT_meshopt_compression";
    let edit = |view: usize, key: &str, value: Value| {
        let mut file = compressed(NAME, "TRIANGLES");
        file.json["bufferViews"][view]["extensions"][NAME][key] = value;
        match file.read() {
            // Normals only shade.
            Ok(scene) if view == 1 => scene.warnings.concat(),
            read => read.unwrap_err().to_string(),
        }
    };
    let huge = 1u64 << 40;
    for (view, key, value, expected) in [
        (
            0,
            "count",
            json!(5),
            "bufferViews[0].byteLength: expected 5 elements of 12 bytes",
        ),
        (
            0,
            "count",
            json!(huge),
            "EXT_meshopt_compression.byteLength: expected",
        ),
        (
            0,
            "byteStride",
            json!(0),
            "byteStride: expected a multiple of 4 in 4..=256, found 0",
        ),
        (
            0,
            "byteStride",
            json!(300),
            "byteStride: expected a multiple of 4 in 4..=256, found 300",
        ),
        (
            1,
            "byteStride",
            json!(16),
            "attribute NORMAL left out (expected one of [4, 8], found 16)",
        ),
        (
            0,
            "byteStride",
            json!("x"),
            "byteStride): expected a whole number, found invalid type: string \"x\"",
        ),
        (
            0,
            "buffer",
            json!(1),
            "buffers[1]: expected a buffer with bytes, found a fallback without",
        ),
        (
            0,
            "buffer",
            json!(9),
            "expected one of 2 buffers, found index 9",
        ),
        (0, "byteOffset", json!(huge), "expected a range within"),
        (
            0,
            "byteLength",
            json!(20),
            "expected 4 elements of compressed data, found corrupt bytes",
        ),
        (0, "mode", json!("POINTS"), "mode: expected ATTRIBUTES"),
        (
            0,
            "filter",
            json!("FOURIER"),
            "filter: expected NONE, OCTAHEDRAL",
        ),
        (
            3,
            "mode",
            json!("ATTRIBUTES"),
            "byteStride: expected a multiple of 4",
        ),
        (
            3,
            "filter",
            json!("EXPONENTIAL"),
            "mode: expected ATTRIBUTES, or without a filter",
        ),
        (3, "mode", json!("INDICES"), "found corrupt bytes"),
    ] {
        let fault = edit(view, key, value.clone());
        assert!(fault.contains(expected), "{key} {value}: {fault}");
    }
    let mut file = compressed(NAME, "TRIANGLES");
    file.json["bufferViews"][0]["byteLength"] = huge.into();
    assert!(
        file.fault()
            .contains("compressed views of 16777216 bytes at most"),
        "{}",
        file.fault()
    );
}

#[test]
fn no_flipped_byte_of_a_compressed_file_panics() {
    let whole = compressed("EXT_meshopt_compression", "TRIANGLES").glb();
    assert!(super::read(&whole).is_ok());
    for at in 0..whole.len() {
        for flip in [0x01, 0x10, 0x80, 0xff] {
            let mut bytes = whole.clone();
            bytes[at] ^= flip;
            let _ = super::read(&bytes);
        }
    }
}
