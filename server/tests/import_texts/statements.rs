//! Statements of OBJ and MTL as programs write them: attributes that cannot be read, comments,
//! the case of keywords, and textures that cannot be decoded.

use lodestream_server::import::{ImportedScene, OpenOptions, import, open};

use super::{Rig, area, read, warns};

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

fn normals(scene: &ImportedScene) -> &[[f32; 3]] {
    scene.meshes[0].normals.as_deref().expect("normals")
}

/// The face keeps its shape, and the lines after a wrong one keep their numbers.
#[test]
fn wrong_attributes_cost_no_face() {
    for wrong in ["", "0", "0 1", "0 0 1 0", "x y z", "0 0 1,0"] {
        let text = format!("{SQUARE}vn {wrong}\nvn 1 0 0\nf 1//1 2//1 3//1\nf 1//2 3//2 4//2\n");
        let scene = read("a.obj", text).expect(wrong);
        assert_eq!(area(&scene), 1.0, "{wrong}");
        let mesh = &scene.meshes[0];
        let of = |at: usize| mesh.triangles[at].map(|it| normals(&scene)[it as usize]);
        assert_eq!(of(0), [[0.0, 0.0, 1.0]; 3], "{wrong}");
        assert_eq!(of(1), [[1.0, 0.0, 0.0]; 3], "{wrong}");
        let words = ["normals that are not three numbers left out: 1 (at line 5)"];
        assert!(warns(&scene, &words), "{:?}", scene.warnings);
        assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    }
    for wrong in ["", "0 0 0 0", "a b", "0,5 0,5"] {
        let text = format!("{SQUARE}vt {wrong}\nvt 0.25 0.75\nf 1/1 2/2 3/2\nf 1/2 3/2 4/2\n");
        let scene = read("a.obj", text).expect(wrong);
        assert_eq!(area(&scene), 1.0, "{wrong}");
        let mesh = &scene.meshes[0];
        let uvs = mesh.uvs.as_deref().expect("coordinates");
        let of = |at: usize| mesh.triangles[at].map(|it| uvs[it as usize]);
        assert_eq!(of(0), [[0.0, 0.0], [0.25, 0.25], [0.25, 0.25]], "{wrong}");
        assert_eq!(of(1), [[0.25; 2]; 3], "{wrong}");
        let words = ["are not one to three numbers left out: 1 (at line 5)"];
        assert!(warns(&scene, &words), "{:?}", scene.warnings);
    }
    // All of them wrong: as a file without.
    let scene = read("a.obj", format!("{SQUARE}vt u v\nf 1/1 2/1 3/1 4/1\n")).expect("is read");
    assert!(scene.meshes[0].uvs.is_none());
}

#[test]
fn corners_may_end_by_slashes() {
    for corner in ["1/1/1/", "1/1/", "1//", "1/1//"] {
        let text = format!("{SQUARE}vt 0 0\nvn 0 0 1\nf {corner} 2/1/1 3/1/1 4/1/1\n");
        let scene = read("a.obj", text).expect(corner);
        assert_eq!(area(&scene), 1.0, "{corner}");
    }
    let error = read("a.obj", format!("{SQUARE}f 1/1/1/1 2 3\n")).expect_err("is refused");
    assert!(error.contains("line 5: expected v, v/vt"), "{error}");
}

#[test]
fn comments_end_statements_and_lines() {
    let text = "v 0 0 0# one\nv 1 0 0 # 2\nv 1 1 0#\nv 0 1 0 #4\nvt 0 0#\nvn 0 0 1#x\n\
        # folder C:\\\nf 1/1/1 2/1/1 3/1/1 \\\n 4/1/1#x\n";
    let scene = read("a.obj", text).expect("is read");
    assert_eq!(area(&scene), 1.0);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    // A comment is a line, whatever it ends by.
    for comment in ["# \\", "# C:\\  ", "vp 0 # \\", "#\\"] {
        let scene = read("a.obj", format!("{comment}\n{SQUARE}f 1 2 3 4\n")).expect(comment);
        assert_eq!(area(&scene), 1.0, "{comment}");
    }
    let rig = Rig::new();
    rig.write("m.mtl", "newmtl a#1\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n");
    for (name, color) in [("a#1", [1.0, 0.0, 0.0]), ("b # green", [0.0, 1.0, 0.0])] {
        let text = format!("mtllib m.mtl # colours\nusemtl {name}\n{SQUARE}f 1 2 3 4\n");
        let scene = import(&rig.write("a.obj", text)).expect("is read");
        assert_eq!(scene.materials[0].base_color_factor[..3], color, "{name}");
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    }
}

/// `x y z r g b`, with an alpha behind, and with a weight before.
#[test]
fn colors_stand_behind_weights() {
    for (numbers, expected) in [
        ("1 0 1", [255, 0, 255, 255]),
        ("1 0 1 0.2", [255, 0, 255, 51]),
        ("0.5 1 0 1 0.2", [255, 0, 255, 51]),
    ] {
        let line = |xy: &str| format!("v {xy} 0 {numbers}\n");
        let text = ["0 0", "1 0", "0 1"].map(line).concat() + "f 1 2 3\n";
        let scene = read("a.obj", text).expect(numbers);
        let colors = scene.meshes[0].colors.as_deref().expect("colours");
        assert_eq!(colors, [expected; 3], "{numbers}");
    }
}

/// Keywords in any case, and lines that end as on old machines.
#[test]
fn libraries_are_read_as_written() {
    let rig = Rig::new();
    rig.image("there.png", 3);
    let text = format!("mtllib m.mtl\nusemtl m\n{SQUARE}vt 0 0\nf 1/1 2/1 3/1 4/1\n");
    let path = rig.write("a.obj", text);
    let library = "newmtl m\nKd 1 0 0\nd 0.75\nPr 0.5\nmap_Kd there.png\n";
    for library in [
        library.to_owned(),
        library.to_ascii_lowercase(),
        library
            .to_ascii_uppercase()
            .replace("THERE.PNG", "there.png")
            .replace("MTL M", "MTL m"),
        library.replace('\n', "\r"),
        library.replace('\n', "\r\n"),
    ] {
        rig.write("m.mtl", &library);
        let scene = import(&path).expect("is read");
        let material = &scene.materials[0];
        assert_eq!(
            material.base_color_factor,
            [1.0, 0.0, 0.0, 0.75],
            "{library:?}"
        );
        assert_eq!(material.roughness, 0.5);
        let image = material.base_color_image.expect("an image");
        assert_eq!(scene.images[image as usize].width, 3);
    }
    rig.write(
        "m.mtl",
        "newmtl m\nMAP_KE glow.png\nMAP_BUMP b.png\nMap_Odd x\n",
    );
    let scene = import(&path).expect("is read");
    for words in [
        "map_Ke \"glow.png\" left out",
        "MAP_BUMP left out",
        "unknown kinds",
    ] {
        assert!(warns(&scene, &[words]), "{words}: {:?}", scene.warnings);
    }
}

/// A header alone is no image: the texture goes, and the others keep their places.
#[test]
fn textures_that_cannot_be_decoded_are_named() {
    let rig = Rig::new();
    for (name, width) in [("broken.png", 1), ("cut.png", 2), ("whole.png", 3)] {
        rig.image(name, width);
    }
    let path = |name: &str| rig.folder.path().join(name);
    let mut bytes = std::fs::read(path("broken.png")).expect("reads");
    let data = bytes.windows(4).position(|it| it == b"IDAT").expect("data");
    bytes[data + 4..data + 8].fill(0xff);
    rig.write("broken.png", bytes);
    let bytes = std::fs::read(path("cut.png")).expect("reads");
    rig.write("cut.png", &bytes[..bytes.len() - 12]);
    let names = ["broken.png", "whole.png", "cut.png"];
    let material = |name: &str| format!("newmtl {name}\nmap_Kd {name}\n");
    rig.write("m.mtl", names.map(material).concat());
    let face = |name: &str| format!("usemtl {name}\nf 1/1 2/1 3/1\n");
    let faces = names.map(face).concat();
    let obj = rig.write("a.obj", format!("mtllib m.mtl\n{SQUARE}vt 0 0\n{faces}"));
    let ply = "ply\nformat ascii 1.0\ncomment TextureFile broken.png\n\
        comment TextureFile whole.png\ncomment TextureFile cut.png\nelement vertex 3\n\
        property float x\nproperty float y\nproperty float z\nproperty float s\n\
        property float t\nelement face 3\nproperty list uchar int vertex_indices\n\
        property int texnumber\nend_header\n0 0 0 0 0\n1 0 0 0 0\n0 1 0 0 0\n3 0 1 2 0\n\
        3 0 1 2 1\n3 0 1 2 2\n";
    for path in [obj, rig.write("a.ply", ply)] {
        let scene = import(&path).expect("is read");
        let images: Vec<_> = scene
            .materials
            .iter()
            .map(|it| it.base_color_image)
            .collect();
        assert_eq!(images, [None, Some(0), None], "{}", path.display());
        assert_eq!((scene.images.len(), scene.images[0].width), (1, 3));
        for name in ["broken.png", "cut.png"] {
            let words = ["image", name, "left out"];
            assert!(warns(&scene, &words), "{name}: {:?}", scene.warnings);
        }
        assert!(!warns(&scene, &["whole.png"]), "{:?}", scene.warnings);
    }
}

/// Names in letters of another case, where one file alone has them.
#[test]
fn names_are_found_in_another_case() {
    let rig = Rig::new();
    std::fs::create_dir(rig.folder.path().join("Maps")).expect("a folder");
    rig.image("Maps/Tex.PNG.png", 3);
    rig.write("M.MTL", "newmtl m\nmap_Kd C:\\x\\maps\\tex.png.PNG\n");
    let text = format!("mtllib m.mtl\nusemtl m\n{SQUARE}vt 0 0\nf 1/1 2/1 3/1\n");
    let path = rig.write("a.obj", text);
    let scene = import(&path).expect("is read");
    assert_eq!(scene.images[0].width, 3);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let self_contained = OpenOptions {
        self_contained: true,
        ..OpenOptions::default()
    };
    let scene = open(&path, &self_contained).expect("is read");
    assert!(scene.images.is_empty());
    // Two of them: which is meant is not told.
    rig.image("Maps/TEX.png.png", 4);
    let scene = import(&path).expect("is read");
    assert!(scene.images.is_empty());
    assert!(warns(&scene, &["images left out"]), "{:?}", scene.warnings);
    // The exact name goes before the others.
    rig.image("Maps/tex.png.PNG", 5);
    rig.write("M.MTL", "newmtl m\nmap_Kd Maps/tex.png.PNG\n");
    assert_eq!(import(&path).expect("is read").images[0].width, 5);
}
