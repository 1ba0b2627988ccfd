//! Habits of programs that write texts.

use lodestream_server::import::{ImportedScene, OpenOptions, import, open};

use super::{Rig, area, corners, read, read_in_pieces, warns};

const MARK: &str = "\u{feff}";
const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
    vn 0 0 1\n";

fn facet(corners: [[&str; 3]; 3]) -> String {
    let vertices = corners.map(|it| format!("vertex {}\n", it.join(" ")));
    let vertices = vertices.concat();
    format!("facet normal 0 0 1\nouter loop\n{vertices}endloop\nendfacet\n")
}

fn binary_stl(header: &str, count: u32, facets: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = header.as_bytes().to_vec();
    bytes.resize(80, b' ');
    bytes.extend(count.to_le_bytes());
    for facet in facets {
        bytes.extend([0; 12]);
        bytes.extend(facet.iter().flatten().flat_map(|it| it.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

/// A strip of facets; sines of whole turns stand where zeros should.
fn facets(count: usize) -> Vec<[[f32; 3]; 3]> {
    let facet = |at: usize| {
        let x = at as f32;
        [[x, 0.0, -2.4e-16], [x + 1.0, 0.0, 1.2e-16], [x, 1.0, -0.0]]
    };
    (0..count).map(facet).collect()
}

#[test]
fn byte_order_marks_are_passed_over() {
    let obj = format!("{MARK}{SQUARE}f 1/1/1 2/2/1 3/3/1 4/4/1\n");
    let stl = format!(
        "{MARK}solid a\n{}endsolid a\n",
        facet([["0", "0", "0"], ["2", "0", "0"], ["0", "1", "0"]])
    );
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
    for (name, text) in [
        ("a.obj", obj),
        ("a.stl", stl),
        ("a.ply", format!("{MARK}{ply}")),
    ] {
        // With and without the extension.
        for name in [name, "a"] {
            let scene = read(name, &text).expect(name);
            assert_eq!(area(&scene), 1.0, "{name}");
            assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        }
    }
    let rig = Rig::new();
    rig.write("m.mtl", format!("{MARK}newmtl m\nKd 1 0 0\n"));
    let obj = format!("mtllib m.mtl\nusemtl m\n{SQUARE}f 1 2 3\n");
    let scene = import(&rig.write("a.obj", obj)).expect("is read");
    assert_eq!(scene.materials[0].base_color_factor, [1.0, 0.0, 0.0, 1.0]);
}

#[test]
fn lines_may_end_by_a_carriage_return() {
    let obj = format!("# old\n{SQUARE}f 1 2 3 4\n");
    let triangle = facet([["0", "0", "0"], ["2", "0", "0"], ["0", "1", "0"]]);
    let stl = format!("solid a name\n{triangle}endsolid a name\n");
    for (name, text) in [("a.obj", obj), ("a.stl", stl)] {
        for end in ["\r", "\r\n"] {
            let scene = read(name, text.replace('\n', end)).expect(name);
            assert_eq!(area(&scene), 1.0, "{name} {end:?}");
            assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        }
    }
}

/// Binary, the mark moves the body.
#[test]
fn a_mark_before_a_binary_ply_moves_its_body() {
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n\
        property float y\nproperty float z\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n";
    let mut bytes = format!("{MARK}{header}").into_bytes();
    let positions = [0f32, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0, 0.0];
    bytes.extend(positions.iter().flat_map(|it| it.to_le_bytes()));
    bytes.push(3);
    bytes.extend([0u32, 1, 2].iter().flat_map(|it| it.to_le_bytes()));
    assert_eq!(area(&read("a.ply", &bytes).expect("is read")), 3.0);
    assert_eq!(
        area(&read_in_pieces("a.ply", &bytes).expect("is read")),
        3.0
    );
}

fn normals(scene: &ImportedScene) -> &[[f32; 3]] {
    scene.meshes[0].normals.as_deref().expect("normals")
}

#[test]
fn zero_stands_for_no_attribute() {
    for face in [
        "f 1/1/0 2/2/1 3/3/1 4/4/1",
        "f 1/0/0 2/0/0 3/0/0 4/0/0",
        "f 1/0 2/0 3/0 4/0",
        "f 1/0/1 2/0/1 3/0/1 4/0/1",
    ] {
        let scene = read("a.obj", format!("{SQUARE}{face}\n")).expect(face);
        assert_eq!(area(&scene), 1.0, "{face}");
        assert!(normals(&scene).iter().all(|it| *it == [0.0, 0.0, 1.0]));
        let has_uvs = scene.meshes[0].uvs.is_some();
        assert_eq!(has_uvs, face.contains("/1/"), "{face}");
        assert!(!warns(&scene, &["lacks"]), "{:?}", scene.warnings);
    }
    let error = read("a.obj", format!("{SQUARE}f 0/1 2/2 3/3\n")).expect_err("is refused");
    assert!(
        error.contains("line 10: expected an index into 4 positions"),
        "{error}"
    );
}

#[test]
fn attributes_that_are_not_there_are_left_out() {
    for (face, words) in [
        (
            "f 1/9/1 2/2/1 3/3/1 4/4/1",
            "texture coordinates that faces name",
        ),
        (
            "f 1/-9/1 2/2/1 3/3/1 4/4/1",
            "texture coordinates that faces name",
        ),
        ("f 1/1/2 2/2/1 3/3/1 4/4/1", "normals that faces name"),
        ("f 1/1/-2 2/2/1 3/3/1 4/4/1", "normals that faces name"),
        (
            "f 1/1/99999999999 2/2/1 3/3/1 4/4/1",
            "normals that faces name",
        ),
    ] {
        let scene = read("a.obj", format!("{SQUARE}{face}\n")).expect(face);
        assert_eq!(area(&scene), 1.0, "{face}");
        assert!(
            warns(&scene, &[words, "lacks", ": 1 (at line 10)"]),
            "{:?}",
            scene.warnings
        );
        assert!(normals(&scene).iter().all(|it| *it == [0.0, 0.0, 1.0]));
    }
    // None of them at all: as a file without.
    let bare = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
    for face in [
        "f 1/1 2/2 3/3 4/4",
        "f 1//1 2//1 3//1 4//1",
        "f 1/1/1 2/2/2 3/3/3 4/4/4",
    ] {
        let scene = read("a.obj", format!("{bare}{face}\n")).expect(face);
        assert_eq!(area(&scene), 1.0, "{face}");
        assert!(scene.meshes[0].uvs.is_none());
        assert!(normals(&scene).iter().all(|it| *it == [0.0, 0.0, 1.0]));
        assert!(warns(&scene, &["lacks"]), "{:?}", scene.warnings);
    }
}

/// A normal that is there stays, beside faces that lack theirs.
#[test]
fn normals_of_other_faces_stay() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 1 0 0\nf 1//1 2//1 3//1\nf 1//1 3//7 4//1\n";
    let scene = read("a.obj", text).expect("is read");
    let mesh = &scene.meshes[0];
    let of = |triangle: usize| mesh.triangles[triangle].map(|at| normals(&scene)[at as usize]);
    assert_eq!(of(0), [[1.0, 0.0, 0.0]; 3]);
    assert_eq!(of(1), [[0.0, 0.0, 1.0]; 3]);
}

#[test]
fn positions_that_are_nowhere_matter_where_they_are_used() {
    for none in [
        "nan 0 0",
        "0 -nan(ind) 0",
        "0 0 1.#QNAN",
        "inf 0 0",
        "0 1e300 0",
    ] {
        let text = format!("v 9 9 9\nv {none}\n{SQUARE}f 3 4 5 6\n");
        let scene = read("a.obj", text).expect(none);
        assert_eq!(area(&scene), 1.0);
        let words = ["not finite", "no face uses", ": 1 (at line 2)"];
        assert!(warns(&scene, &words), "{:?}", scene.warnings);
        let text = format!("v 9 9 9\nv {none}\n{SQUARE}f 1 2 3\n");
        let error = read("a.obj", text).expect_err(none);
        assert!(
            error.contains("line 2: expected three finite numbers"),
            "{error}"
        );
    }
    let ply = |faces: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
             property float z\nelement face 1\nproperty list uchar int vertex_indices\n\
             end_header\n0 0 0\nnan 0 0\n2 0 0\n0 1 0\n{faces}\n"
        )
    };
    assert_eq!(area(&read("a.ply", ply("3 0 2 3")).expect("is read")), 1.0);
    let error = read("a.ply", ply("3 0 1 2")).expect_err("is refused");
    assert!(
        error.contains("vertex 1: expected finite numbers"),
        "{error}"
    );
}

#[test]
fn facets_that_are_nowhere_are_left_out() {
    let mut list = facets(300);
    for (at, value) in [(5, f32::NAN), (17, f32::INFINITY), (299, -f32::NAN)] {
        list[at][1][2] = value;
    }
    let bytes = binary_stl("a", 300, &list);
    for scene in [read("a.stl", &bytes), read_in_pieces("a.stl", &bytes)] {
        let scene = scene.expect("is read");
        assert_eq!((scene.source_triangles, corners(&scene).len()), (297, 297));
        let words = ["facets that are not finite left out: 3 (at facet 5)"];
        assert!(warns(&scene, &words), "{:?}", scene.warnings);
    }
    let text = ["nan", "-1.#IND", "1e999", "0"]
        .map(|z| facet([["0", "0", z], ["2", "0", "0"], ["0", "1", "0"]]));
    let text = format!("solid a\n{}endsolid\n", text.concat());
    let scene = read("a.stl", text).expect("is read");
    assert_eq!((scene.source_triangles, area(&scene)), (1, 1.0));
    assert!(warns(&scene, &["facets that are not finite left out: 3"]));
    // Nothing is left: no mesh.
    let none = binary_stl("a", 1, &[[[f32::NAN; 3]; 3]]);
    for scene in [read("a.stl", &none), read_in_pieces("a.stl", &none)] {
        assert!(scene.expect("is read").meshes.is_empty());
    }
}

/// The length of the file says how many facets there are, where the header does not.
#[test]
fn facets_are_counted_by_the_length() {
    let list = facets(960);
    for header in ["made by a pipe", "solid made by a pipe"] {
        for count in [0, 1, 959] {
            let bytes = binary_stl(header, count, &list);
            for scene in [read("a.stl", &bytes), read_in_pieces("a.stl", &bytes)] {
                let scene = scene.expect("is read");
                assert_eq!(corners(&scene).len(), 960, "{header} {count}");
                assert!(warns(
                    &scene,
                    &["counts of headers", &format!("count {count} before 960")]
                ));
            }
        }
    }
    // A cut file: the header says what is missing.
    let cut = binary_stl("a", 961, &list);
    let error = read("a.stl", cut).expect_err("is refused");
    assert!(
        error.contains("expected 48134 bytes for 961 facets, found 48084"),
        "{error}"
    );
    // Bytes after the facets that the header counts.
    let mut longer = binary_stl("a", 960, &list);
    longer.extend([7; 170]);
    let scene = read("a.stl", longer).expect("is read");
    assert_eq!(corners(&scene).len(), 960);
    assert!(warns(&scene, &["bytes after the last facet left out: 170"]));
}

/// Paths of the machine that wrote the file, and its spelling, for textures that lie beside it.
#[test]
fn textures_are_found_by_their_name() {
    let rig = Rig::new();
    rig.image("tex one.png", 1);
    std::fs::create_dir(rig.folder.path().join("maps")).expect("makes");
    rig.image("maps/two.png", 2);
    for (name, width) in [
        ("C:\\Users\\a\\tex one.png", 1),
        ("C:tex one.png", 1),
        ("/home/a/tex one.png", 1),
        ("..\\..\\tex one.png", 1),
        (".\\tex one.png", 1),
        ("\"tex one.png\"", 1),
        ("\\\\server\\share\\tex one.png", 1),
        ("D:\\models\\maps\\two.png", 2),
        ("maps\\two.png", 2),
    ] {
        rig.write("m.mtl", format!("newmtl m\nmap_Kd {name}\n"));
        let obj = format!("mtllib Z:\\x\\m.mtl\nusemtl m\n{SQUARE}f 1/1 2/2 3/3\n");
        let path = rig.write("a.obj", obj);
        let scene = import(&path).expect(name);
        let widths: Vec<u32> = scene.images.iter().map(|it| it.width).collect();
        assert_eq!(widths, [width], "{name}: {:?}", scene.warnings);
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        let options = OpenOptions {
            self_contained: true,
            ..OpenOptions::default()
        };
        assert!(open(&path, &options).expect(name).images.is_empty());
    }
}

/// A library in a folder names what lies beside itself.
#[test]
fn textures_are_found_beside_their_library() {
    let rig = Rig::new();
    std::fs::create_dir(rig.folder.path().join("looks")).expect("makes");
    rig.image("looks/a.png", 3);
    rig.write("looks/m.mtl", "newmtl m\nmap_Kd a.png\n");
    for library in ["looks/m.mtl", "looks\\m.mtl", "C:\\x\\looks\\m.mtl"] {
        let obj = format!("mtllib {library}\nusemtl m\n{SQUARE}f 1/1 2/2 3/3\n");
        let scene = import(&rig.write("a.obj", obj)).expect(library);
        assert_eq!(scene.images.len(), 1, "{library}: {:?}", scene.warnings);
    }
}

/// A name is never followed out of the folder.
#[test]
fn textures_outside_stay_outside() {
    let rig = Rig::new();
    std::fs::create_dir(rig.folder.path().join("model")).expect("makes");
    rig.image("secret.png", 1);
    let outside = rig.folder.path().join("secret.png");
    for name in [
        "../secret.png",
        "..\\secret.png",
        outside.to_str().expect("a name"),
    ] {
        rig.write("model/m.mtl", format!("newmtl m\nmap_Kd {name}\n"));
        let obj = format!("mtllib m.mtl\nusemtl m\n{SQUARE}f 1/1 2/2 3/3\n");
        let scene = import(&rig.write("model/a.obj", obj)).expect(name);
        assert!(scene.images.is_empty(), "{name}");
        assert!(warns(&scene, &["images left out"]), "{:?}", scene.warnings);
    }
}
