//! Materials of mesh files: seen from both sides, seen at all, and not washed out.

use lodestream_server::import::{AlphaMode, ImportedScene, Material, import};

use super::{Rig, read, warns};

/// A triangle with the statements of a material.
fn shaded(statements: &str) -> (ImportedScene, Material) {
    let rig = Rig::new();
    rig.image("there.png", 1);
    rig.write("m.mtl", format!("newmtl m\n{statements}\n"));
    let obj = "mtllib m.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n";
    let scene = import(&rig.write("a.obj", obj)).expect("is read");
    let material = scene.materials[0].clone();
    (scene, material)
}

#[test]
fn both_sides_are_drawn() {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let stl = "solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
        endloop\nendfacet\nendsolid\n";
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let scenes = [
        read("a.obj", format!("{triangle}f 1 2 3\n")),
        read("a.obj", format!("{triangle}usemtl none\nf 1 2 3\n")),
        read("a.stl", stl),
        read("a.ply", ply),
        Ok(shaded("Kd 1 0 0").0),
    ];
    for scene in scenes {
        let scene = scene.expect("is read");
        assert_eq!(scene.materials.len(), 1);
        assert!(scene.materials[0].double_sided);
    }
}

#[test]
fn opacity_is_what_d_says() {
    for (statements, opacity) in [
        ("", 1.0),
        ("d 1\nTr 1", 1.0),
        ("Tr 1\nd 1", 1.0),
        ("Tr 0\nd 0.75", 0.75),
        ("d 0.75\nTr 0", 0.75),
        ("d -halo 0.75", 0.75),
        ("Tr 0.25", 0.75),
        ("Tr 0", 1.0),
        ("d 7", 1.0),
    ] {
        let (scene, material) = shaded(statements);
        assert_eq!(
            material.base_color_factor,
            [1.0, 1.0, 1.0, opacity],
            "{statements}"
        );
        let mode = if opacity < 1.0 {
            AlphaMode::Blend
        } else {
            AlphaMode::Opaque
        };
        assert_eq!(material.alpha_mode, mode, "{statements}");
        let told = warns(&scene, &["drawn opaque: blending is not drawn yet"]);
        assert_eq!(told, opacity < 1.0, "{:?}", scene.warnings);
    }
}

#[test]
fn nothing_is_invisible_without_a_warning() {
    for statements in ["Tr 1", "Tr 1.000000\nillum 2", "Tr 7"] {
        let (scene, material) = shaded(statements);
        assert_eq!(material.alpha_mode, AlphaMode::Opaque);
        assert_eq!(material.base_color_factor[3], 1.0);
        assert!(warns(
            &scene,
            &["Tr 1 without d read as opaque", "m.mtl line 2"]
        ));
    }
    for statements in ["d 0", "d 0\nTr 1", "Tr 0.9", "d 0.3"] {
        let (scene, material) = shaded(statements);
        assert_eq!(material.alpha_mode, AlphaMode::Blend);
        let words = ["opacity below 0.5 not seen", "m.mtl line 2"];
        assert!(warns(&scene, &words), "{statements}: {:?}", scene.warnings);
    }
}

/// Factors under textures that are not drawn are left out with them, in any order.
#[test]
fn factors_go_with_their_textures() {
    for swap in [false, true] {
        let pair = |a: &str, b: &str| match swap {
            false => format!("{a}\n{b}"),
            true => format!("{b}\n{a}"),
        };
        let (scene, material) = shaded(&pair("Ke 1 1 1", "map_Ke glow.png"));
        assert_eq!(material.emissive_factor, [0.0; 3]);
        assert!(warns(
            &scene,
            &["map_Ke \"glow.png\" left out, and Ke with it"]
        ));
        let (scene, material) = shaded(&pair("Pm 1", "map_Pm metal.png"));
        assert_eq!(material.metallic, 0.0);
        assert!(warns(
            &scene,
            &["map_Pm \"metal.png\" left out, and Pm with it"]
        ));
        let (scene, material) = shaded(&pair("Pr 0", "map_Pr -s 2 2 2 rough.png"));
        assert_eq!((material.roughness, material.uv_transform), (1.0, None));
        assert!(warns(
            &scene,
            &["map_Pr \"rough.png\" left out, and Pr with it"]
        ));
        // Black under a texture, whether or not the texture can be had.
        for texture in ["there.png", "missing.png"] {
            let (scene, material) = shaded(&pair("Kd 0 0 0\nd 0.75", &format!("map_Kd {texture}")));
            assert_eq!(
                material.base_color_factor,
                [1.0, 1.0, 1.0, 0.75],
                "{texture}"
            );
            let is_there = texture == "there.png";
            assert_eq!(scene.images.len(), usize::from(is_there));
            assert_eq!(warns(&scene, &["missing.png"]), !is_there);
        }
    }
    // Alone they count.
    let (scene, material) = shaded("Ke 1 1 1\nPm 1\nPr 0.5\nKd 0 0 0");
    assert_eq!(material.emissive_factor, [1.0; 3]);
    assert_eq!((material.metallic, material.roughness), (1.0, 0.5));
    assert_eq!(material.base_color_factor, [0.0, 0.0, 0.0, 1.0]);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
}

/// A library that makes no sense costs the looks, not the geometry.
#[test]
fn statements_that_cannot_be_read_are_left_out() {
    let (scene, material) = shaded("Kd red\nKe spectral x.rfl\nd opaque\nPr\nPm nan\nNs\nTr -");
    let plain = read("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").expect("is read");
    let expected = Material {
        name: "m".to_owned(),
        ..plain.materials[0].clone()
    };
    assert_eq!(material, expected);
    assert_eq!(scene.source_triangles, 1);
    for keyword in [
        "Kd that is no",
        "Ke that is no",
        "d without",
        "Pr without",
        "Tr without",
    ] {
        assert!(warns(&scene, &[keyword]), "{keyword}: {:?}", scene.warnings);
    }
}
