//! What stands in a file is what stands in the scene.

use lodestream_server::import::{AlphaMode, SamplerWrap, import};

use super::{FORMATS, MTL, OBJ, binary_stl, corners, ply, read, square_corners, text_stl};

#[test]
fn obj_with_its_materials() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.obj");
    std::fs::write(&path, OBJ).unwrap();
    std::fs::write(folder.path().join("square.mtl"), MTL).unwrap();
    std::fs::create_dir(folder.path().join("textures")).unwrap();
    image::RgbImage::new(3, 2)
        .save(folder.path().join("textures/wall 1.png"))
        .unwrap();
    let scene = import(&path).unwrap();

    assert_eq!(scene.name, "model");
    assert_eq!(scene.source_triangles, 4);
    assert_eq!(&corners(&scene)[..2], square_corners());
    let mesh = &scene.meshes[0];
    assert_eq!(mesh.triangle_materials, [0, 0, 1]);
    let at = |corner: usize| mesh.triangles[0][corner] as usize;
    // The third corner has (1, 0.75) from the bottom.
    assert_eq!(mesh.uvs.as_ref().unwrap()[at(2)], [1.0, 0.25]);
    assert_eq!(mesh.normals.as_ref().unwrap()[at(0)], [0.0, 0.0, 1.0]);
    // sRGB 0.5 is linear 0.214.
    assert_eq!(mesh.colors.as_ref().unwrap()[at(2)], [55, 55, 55, 255]);
    assert_eq!(mesh.colors.as_ref().unwrap()[at(0)], [255, 0, 0, 255]);
    // The triangle without normals has made ones: across its own plane.
    let [a, b, c] = corners(&scene)[2].map(glam::Vec3::from);
    let made = mesh.normals.as_ref().unwrap()[mesh.triangles[2][0] as usize];
    let face = (b - a).cross(c - a).normalize();
    assert!(face.distance(made.into()) < 1e-6, "{made:?}");

    let [painted, glass] = &scene.materials[..] else {
        panic!("{:?}", scene.materials);
    };
    assert_eq!(painted.name, "painted wall");
    assert_eq!(painted.base_color_image, Some(0));
    assert!((painted.base_color_factor[0] - 0.214).abs() < 1e-3);
    assert_eq!(painted.emissive_factor, [1.0, 0.0, 0.0]);
    assert_eq!(painted.wrap_u, SamplerWrap::Clamp);
    assert_eq!(painted.uv_transform, Some([2.0, 0.0, 0.0, 0.0, 2.0, -1.0]));
    assert_eq!(painted.metallic, 0.0);
    assert_eq!(glass.alpha_mode, AlphaMode::Blend);
    assert_eq!(glass.base_color_factor, [0.0, 0.0, 0.0, 0.25]);
    assert_eq!((scene.images[0].width, scene.images[0].height), (3, 2));
    for left_out in [
        "lines",
        "triangles with a repeated index",
        "map_bump",
        "(0, 0)",
    ] {
        assert!(
            scene.warnings.iter().any(|it| it.contains(left_out)),
            "{:?}",
            scene.warnings
        );
    }
}

#[test]
fn obj_without_its_library_says_so() {
    let scene = read("alone.obj", OBJ.as_bytes()).unwrap();
    assert_eq!(scene.materials.len(), 2);
    for left_out in ["material libraries left out", "no library defines"] {
        assert!(
            scene.warnings.iter().any(|it| it.contains(left_out)),
            "{:?}",
            scene.warnings
        );
    }
}

#[test]
fn obj_polygons_become_fans_whatever_their_size() {
    let mut text = String::new();
    for at in 0..1000 {
        let angle = at as f64 / 1000.0 * std::f64::consts::TAU;
        text += &format!("v {} {} 0\n", angle.cos(), angle.sin());
    }
    text += "f";
    (1..=1000).for_each(|at| text += &format!(" {at}"));
    let scene = read("disc.obj", text.as_bytes()).unwrap();
    assert_eq!(scene.source_triangles, 998);
    assert_eq!(scene.meshes[0].positions.len(), 1000);
}

#[test]
fn ply_says_the_same_in_every_encoding() {
    for (format, faces_first) in FORMATS.into_iter().flat_map(|it| [(it, false), (it, true)]) {
        let scene = read("square.ply", &ply(format, faces_first)).unwrap();
        assert_eq!(corners(&scene), square_corners(), "{format}");
        let mesh = &scene.meshes[0];
        assert_eq!(mesh.normals.as_ref().unwrap(), &[[0.0, 0.0, 1.0]; 4]);
        assert_eq!(mesh.uvs.as_ref().unwrap()[2], [1.0, 0.0]);
        // sRGB 188 is linear 0.503, alpha stays.
        assert_eq!(mesh.colors.as_ref().unwrap()[2], [128, 0, 255, 120]);
        assert_eq!(scene.source_triangles, 2);
        for left_out in ["quality", "flags", "edge", "none.png", "unit length"] {
            assert!(
                scene.warnings.iter().any(|it| it.contains(left_out)),
                "{:?}",
                scene.warnings
            );
        }
    }
}

#[test]
fn ply_of_points_is_an_empty_scene() {
    let text = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
                property float z\nend_header\n0 0 0\n1 1 1\n";
    let scene = read("points.ply", text.as_bytes()).unwrap();
    assert!(scene.meshes.is_empty() && scene.instances.is_empty());
    assert!(scene.warnings[0].starts_with("points without triangles left out: 2"));
}

#[test]
fn stl_is_told_apart_by_its_length_and_welded() {
    let binary = binary_stl("a part", &square_corners());
    let solid = binary_stl("solid ascii? no", &square_corners());
    let text = text_stl().into_bytes();
    let upper = text_stl().to_ascii_uppercase().into_bytes();
    for bytes in [&binary, &solid, &text, &upper] {
        // The extension is not needed either.
        for name in ["part.stl", "part"] {
            let scene = read(name, bytes).unwrap();
            assert_eq!(corners(&scene), square_corners());
            assert_eq!(scene.meshes[0].positions.len(), 4);
            assert_eq!(
                scene.meshes[0].normals.as_ref().unwrap(),
                &[[0.0, 0.0, 1.0]; 4]
            );
        }
    }
    let mut longer = binary.clone();
    longer.extend(b"??");
    let scene = read("part.stl", &longer).unwrap();
    assert!(scene.warnings[0].starts_with("bytes after the last facet left out: 2"));
}
