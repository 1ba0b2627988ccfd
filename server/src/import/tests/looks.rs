//! Looks: a fault in them never costs the geometry, and is named.

use serde_json::{Value, json};

use super::{File, QUAD, find, picture, quad, read_with};
use crate::import::OpenOptions;
use crate::import::scene::{AlphaMode, ImportedScene};

/// A quad with the image under a base colour of its own.
fn textured(file: File, image: Value) -> File {
    with_texture(file, image, json!({"source": 0}))
}

fn with_texture(mut file: File, image: Value, texture: Value) -> File {
    file.json["images"] = json!([image]);
    file.json["textures"] = json!([texture]);
    file.json["materials"] = json!([{"pbrMetallicRoughness": {
        "baseColorTexture": {"index": 0}, "baseColorFactor": [0.5, 0.5, 0.5, 1],
    }}]);
    file.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    file
}

/// The quad is whole, its texture is not there, and a line names `what`.
fn assert_left_out(file: &File, what: &str) {
    let scene = file.scene();
    assert_eq!(scene.meshes[0].positions, QUAD);
    assert_eq!(scene.materials[0].base_color_image, None);
    assert_eq!(scene.materials[0].base_color_factor, [0.5, 0.5, 0.5, 1.0]);
    assert!(scene.images.is_empty());
    let line = find(&scene.warnings, what);
    assert!(line.contains("left out"), "{line}");
}

#[test]
fn images_that_cannot_be_had_are_left_out_by_name() {
    for uri in [
        "nothere.png",
        "no/where.png",
        "../up.png",
        "/etc/hostname",
        "C:/a.png",
        "http://127.0.0.1:9/x.png",
        "a%2.png",
        "tex\\pat tern.png",
    ] {
        assert_left_out(
            &textured(quad(), json!({"uri": uri})),
            &Value::from(uri).to_string().replace("\\\\", "\\"),
        );
    }
    for (image, what) in [
        (
            json!({"uri": "data:image/png;base64,@", "name": "sky"}),
            "\"sky\"",
        ),
        (
            json!({"uri": "data:image/png,text", "name": "sky"}),
            "\"sky\" that is neither PNG nor JPEG",
        ),
        (json!({"bufferView": 99, "name": "sky"}), "\"sky\""),
        (json!({"name": "sky"}), "\"sky\""),
        (json!({"uri": "x.png", "bufferView": 0}), "\"x.png\""),
        (
            json!({"bufferView": 0, "name": "sky"}),
            "\"sky\" that is neither",
        ),
        (json!({"uri": 5}), "\"images[0]\""),
        (json!({}), "\"images[0]\""),
    ] {
        assert_left_out(&textured(quad(), image), what);
    }
    let mut file = quad();
    let png = picture(image::ImageFormat::Png);
    let cut = file.view(&png[..20]);
    assert_left_out(
        &textured(file, json!({"bufferView": cut, "name": "cut"})),
        "\"cut\"",
    );
}

#[test]
fn images_whose_pixels_are_broken_are_left_out_by_name() {
    let png = picture(image::ImageFormat::Png);
    let mut changed = png.clone();
    let pixels = png.windows(4).position(|it| it == b"IDAT").unwrap();
    changed[pixels + 8] ^= 0x55;
    for bytes in [&png[..png.len() - 1], &png[..pixels + 6], &changed] {
        let mut file = quad();
        let views = [file.view(bytes), file.view(&png)];
        let mut file = textured(file, json!({"bufferView": views[0], "name": "bark"}));
        assert_left_out(&file, "image \"bark\" left out");
        // Those that follow it are numbered anew.
        file.push("images", json!({"bufferView": views[1]}));
        file.push("textures", json!({"source": 1}));
        let whole = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}});
        file.push("materials", whole);
        let scene = file.scene();
        let images: Vec<_> = scene
            .materials
            .iter()
            .map(|it| it.base_color_image)
            .collect();
        assert_eq!((images, scene.images.len()), (vec![None, Some(0)], 1));
        assert_eq!(scene.images[0].bytes, png);
    }
}

#[test]
fn images_are_told_by_their_bytes() {
    for (format, said) in [
        (image::ImageFormat::Png, "image/jpeg"),
        (image::ImageFormat::Jpeg, "image/png"),
        (image::ImageFormat::Jpeg, "nonsense"),
    ] {
        let mut file = quad();
        let view = file.view(&picture(format));
        let scene = textured(file, json!({"bufferView": view, "mimeType": said})).scene();
        assert_eq!(scene.materials[0].base_color_image, Some(0), "{said}");
    }
}

#[test]
fn textures_of_other_encodings_are_left_out_by_name() {
    for name in [
        "KHR_texture_basisu",
        "EXT_texture_webp",
        "EXT_texture_avif",
        "MSFT_texture_dds",
    ] {
        let texture = json!({"extensions": {name: {"source": 0}}});
        let image = json!({"bufferView": 0, "name": "bark", "mimeType": "image/ktx2"});
        let mut file = with_texture(quad(), image, texture);
        file.json["extensionsUsed"] = json!([name]);
        file.json["extensionsRequired"] = json!([name]);
        assert_left_out(
            &file,
            &format!("image \"bark\" left out, which needs {name}"),
        );
        // An image that every reader has stands beside it.
        let view = file.view(&picture(image::ImageFormat::Png));
        file.push("images", json!({"bufferView": view}));
        file.json["textures"][0]["source"] = 1.into();
        assert_eq!(file.scene().materials[0].base_color_image, Some(0));
    }
}

#[test]
fn required_extensions_that_keep_the_shape_are_named() {
    for name in [
        "KHR_lights_punctual",
        "EXT_lights_image_based",
        "EXT_lights_ies",
        "KHR_animation_pointer",
        "KHR_xmp_json_ld",
        "KHR_materials_variants",
        "KHR_materials_clearcoat",
        "KHR_materials_subsurface",
        "ADOBE_materials_clearcoat_specular",
        "KHR_texture_procedurals",
        "MSFT_lod",
        "KHR_node_selectability",
        "KHR_interactivity",
        "KHR_audio_emitter",
        "KHR_physics_rigid_bodies",
        "EXT_mesh_features",
        "EXT_structural_metadata",
        "AGI_articulations",
        "AGI_stk_metadata",
        "MSFT_packing_occlusionRoughnessMetallic",
        "MPEG_media",
        "ASOBO_material_detail_map",
        "ASOBO_normal_map_convention",
        "ASOBO_tags",
        "GOOGLE_tilt_brush_material",
        "MOZ_lightmap",
        "EPIC_lightmap_textures",
        "GODOT_single_root",
        "OMI_collider",
        "OMI_link",
        "OMI_spawn_point",
        "MOZ_hubs_components",
        "NEEDLE_components",
        "VRM",
        "VRMC_vrm",
        "VRMC_springBone",
        "FB_ngon_encoding",
        "KHR_blend",
        "KHR_camera_physical",
        "KHR_displaymapping_pq",
        "KHR_lights",
        "EXT_textureInfo_constant_lod",
        "EXT_mesh_primitive_edge_visibility",
        "MAXAR_image_ortho",
        "MAXAR_temporal_light_traits",
    ] {
        let mut file = quad();
        file.json["extensionsRequired"] = json!([name]);
        let scene = file.scene();
        assert_eq!(scene.meshes[0].positions, QUAD, "{name}");
        find(&scene.warnings, &format!("extension {name} left out"));
    }
    for name in [
        "KHR_draco_mesh_compression",
        "VENDOR_sparkles",
        "CESIUM_RTC",
        "KHR_",
        "VENDOR_linked_meshes",
        "VENDOR_blendshapes",
        "EXT_primitive_voxels",
        "S8S_v_quantized_attributes",
        "KHR_accessor_float64",
        "KHR_gaussian_splatting",
        "EXT_mesh_primitive_restart",
    ] {
        let mut file = quad();
        file.json["extensionsRequired"] = json!([name]);
        assert!(file.fault().contains(name), "{name}");
    }
}

#[test]
fn broken_materials_are_shown_as_well_as_they_can_be() {
    let mut file = quad();
    let view = file.view(&picture(image::ImageFormat::Png));
    file.json["images"] = json!([{"bufferView": view}]);
    file.json["samplers"] = json!([{"wrapS": 5, "magFilter": 6}, {"wrapS": "repeat"}]);
    file.json["textures"] = json!([
        {"source": 0, "sampler": 0}, {"source": 0, "sampler": 1}, {"source": 0, "sampler": 9}, 5,
    ]);
    let shown =
        |index: u32| json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": index}}});
    file.json["materials"] = json!([
        shown(0), shown(1), shown(2), shown(3), shown(4),
        {"pbrMetallicRoughness": {"baseColorTexture": {}}},
        {"alphaMode": "DITHER"}, {"alphaMode": 5}, {"pbrMetallicRoughness": {"baseColorFactor": [1]}},
        {"emissiveFactor": [1e300, 0, 0]},
    ]);
    let scene = file.scene();
    let images: Vec<_> = scene
        .materials
        .iter()
        .map(|it| it.base_color_image)
        .collect();
    assert_eq!(images[..3], [Some(0); 3]);
    assert!(images[3..].iter().all(Option::is_none), "{images:?}");
    assert_eq!(scene.materials[6].alpha_mode, AlphaMode::Opaque);
    assert!(
        scene
            .materials
            .iter()
            .all(|it| it.emissive_factor[0].is_finite())
    );
    for (what, amount) in [
        ("wrapS of samplers", 1),
        ("magFilter of samplers", 1),
        ("samplers left out that are not", 2),
        ("textures left out that are not", 3),
        ("alphaMode \"DITHER\" read as OPAQUE", 1),
        ("factors clamped", 1),
    ] {
        let line = find(&scene.warnings, what);
        assert!(line.contains(&format!(": {amount} (")), "{line}");
    }
    let broken = scene
        .warnings
        .iter()
        .filter(|it| it.starts_with("materials left out"));
    assert_eq!(broken.count(), 2, "{:?}", scene.warnings);
}

/// A factor under a texture that is left out neither lights nor metals the surface.
#[test]
fn factors_under_other_textures_go_with_them() {
    let mut file = quad();
    file.json["materials"] = json!([
        {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}},
        {"pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}}},
        {"emissiveFactor": [1, 0.5, 0]},
        {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.3]}},
        {"extensions": {"KHR_materials_pbrSpecularGlossiness": {
            "specularGlossinessTexture": {"index": 0}, "diffuseFactor": [0.5, 0.5, 0.5, 1]}}},
    ]);
    let scene = file.scene();
    let materials = &scene.materials;
    assert_eq!(materials[0].emissive_factor, [0.0; 3]);
    assert_eq!((materials[1].metallic, materials[1].roughness), (0.0, 1.0));
    assert_eq!(materials[2].emissive_factor, [1.0, 0.5, 0.0]);
    assert_eq!(materials[3].alpha_mode, AlphaMode::Blend);
    assert_eq!(materials[4].base_color_factor, [0.5, 0.5, 0.5, 1.0]);
    assert_eq!((materials[4].metallic, materials[4].roughness), (0.0, 0.5));
    for what in [
        "emissiveTexture left out, with the factors that it scales: 1 (at materials[0])",
        "metallicRoughnessTexture left out",
        "specularGlossinessTexture left out",
        "KHR_materials_pbrSpecularGlossiness approximated",
        "alphaMode BLEND approximated: 1 (at materials[3])",
    ] {
        find(&scene.warnings, what);
    }
}

/// Whether loaded or streamed, the mesh is the one without the attribute.
#[test]
fn attributes_that_only_shade_are_left_out_where_they_cannot_be_read() {
    let floats = |lanes: usize| vec![0u8; 4 * 4 * lanes];
    for (name, component, kind, bytes, reason) in [
        (
            "NORMAL",
            5126,
            "VEC4",
            floats(4),
            "expected VEC3, found VEC4",
        ),
        (
            "NORMAL",
            5120,
            "VEC3",
            vec![0; 16],
            "expected f32, found i8",
        ),
        (
            "NORMAL",
            5126,
            "VEC3",
            vec![0; 40],
            "of them at byte 0, ending at 48",
        ),
        (
            "TEXCOORD_0",
            5126,
            "VEC3",
            floats(3),
            "expected VEC2, found VEC3",
        ),
        ("TEXCOORD_0", 5120, "VEC2", vec![0; 8], "found i8"),
        ("TEXCOORD_0", 5126, "VEC2", vec![0; 4], "ending at 32"),
        (
            "COLOR_0",
            5126,
            "SCALAR",
            floats(1),
            "expected VEC3 or VEC4",
        ),
        ("COLOR_0", 5125, "VEC4", floats(4), "found u32"),
        ("COLOR_0", 5127, "VEC4", floats(4), "found 5127"),
        ("COLOR_0", 5126, "VEC9", floats(4), "found VEC9"),
    ] {
        let mut file = quad();
        let broken = file.accessor(&bytes, component, kind, 4);
        for index in [broken, 99] {
            file.json["meshes"][0]["primitives"][0]["attributes"][name] = index.into();
            let reason = match index {
                99 => "found index 99",
                _ => reason,
            };
            let check = |scene: &ImportedScene| {
                let mesh = &scene.meshes[0];
                assert_eq!(mesh.positions, QUAD, "{name}");
                assert_eq!((&mesh.uvs, &mesh.colors), (&None, &None), "{name}");
                let line = find(&scene.warnings, &format!("attribute {name} left out"));
                assert!(line.contains(reason), "{line}");
                let place = format!("attributes.{name} (accessor {index})");
                assert!(line.contains(&place), "{line}");
            };
            let scene = file.scene();
            check(&scene);
            assert_eq!(scene.meshes[0].normals, Some(vec![[0.0, 0.0, 1.0]; 4]));
            let pieces = OpenOptions::with_max_mesh_bytes(0);
            let scene = read_with(&file.glb(), &pieces).unwrap();
            check(&scene);
            assert_eq!(scene.meshes[0].normals, None);
        }
    }
}

/// One primitive of a mesh has the attribute, another has it broken.
#[test]
fn primitives_agree_on_attributes_that_are_left_out() {
    let mut file = quad();
    let whole = file.floats(&[[0.25, 0.75]; 4]);
    let broken = file.floats(&[[0.0; 3]; 4]);
    let normals = file.floats(&[[0.0, 0.0, -1.0]; 4]);
    let second = json!({"attributes": {"POSITION": 0, "TEXCOORD_0": broken, "NORMAL": broken - 1}, "indices": 1});
    file.primitive(second);
    let first = &mut file.json["meshes"][0]["primitives"][0];
    first["attributes"] = json!({"POSITION": 0, "TEXCOORD_0": whole, "NORMAL": normals});
    for most in [u64::MAX, 0] {
        let options = OpenOptions::with_max_mesh_bytes(most);
        let scene = read_with(&file.glb(), &options).unwrap();
        let mesh = &scene.meshes[0];
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (8, 4));
        let uvs = [[[0.25, 0.75]; 4], [[0.0; 2]; 4]].concat();
        assert_eq!(mesh.uvs, Some(uvs));
        let made = [[[0.0, 0.0, -1.0]; 4], [[0.0, 0.0, 1.0]; 4]].concat();
        assert_eq!(mesh.normals, (most > 0).then_some(made));
    }
}
