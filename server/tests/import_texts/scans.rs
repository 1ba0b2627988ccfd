//! PLY of scanning programs: strips, texture coordinates of corners, several textures.

use lodestream_server::import::{ImportedScene, OpenOptions, import, open};

use super::{Rig, corners, read, warns};

const SQUARE: &str = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";

/// A square of two triangles, each with a texture and coordinates of its own, as OpenMVS and
/// MeshLab write them.
fn wedges(order: [&str; 2], numbers: [i32; 2]) -> String {
    let property = |name: &str| match name {
        "uv" => "property list uchar float texcoord\nproperty int texnumber\n",
        _ => "property list uchar int vertex_indices\n",
    };
    let header = format!(
        "ply\nformat ascii 1.0\ncomment VCGLIB generated\ncomment TextureFile one.png\n\
         comment TextureFile C:\\scans\\two 2.png\nelement vertex 4\nproperty float x\n\
         property float y\nproperty float z\nelement face 2\n{}{}property uchar red\nend_header\n",
        property(order[0]),
        property(order[1])
    );
    let corners = ["3 0 1 2", "3 0 2 3"];
    let uvs = ["6 0 0 0.5 0 0.5 0.5", "6 0 0 1 1 0 1"];
    let face = |at: usize| {
        let value = |name: &str| match name {
            "uv" => format!("{} {}", uvs[at], numbers[at]),
            _ => corners[at].to_owned(),
        };
        format!("{} {} 9\n", value(order[0]), value(order[1]))
    };
    format!("{header}{SQUARE}{}{}", face(0), face(1))
}

/// Texture coordinates of the corners, triangle by triangle.
fn corner_uvs(scene: &ImportedScene) -> Vec<[[f32; 2]; 3]> {
    let mesh = &scene.meshes[0];
    let uvs = mesh.uvs.as_ref().expect("coordinates");
    let corner = |at: u32| uvs[at as usize];
    mesh.triangles.iter().map(|it| it.map(corner)).collect()
}

#[test]
fn corners_have_textures_of_their_own() {
    let rig = Rig::new();
    rig.image("one.png", 1);
    rig.image("two 2.png", 2);
    for order in [["corners", "uv"], ["uv", "corners"]] {
        let scene = import(&rig.write("scan.ply", wedges(order, [1, 0]))).expect("is read");
        // Top-down; vertices 0 and 2 stand twice, 2 with other coordinates.
        let expected = [
            [[0.0, 1.0], [0.5, 1.0], [0.5, 0.5]],
            [[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]],
        ];
        assert_eq!(corner_uvs(&scene), expected);
        assert_eq!(scene.meshes[0].positions.len(), 5);
        let widths: Vec<u32> = (0..2)
            .map(|triangle| {
                let mesh = &scene.meshes[0];
                let slot = mesh.triangle_materials[triangle];
                let material = mesh.material_slots[usize::from(slot)] as usize;
                let image = scene.materials[material].base_color_image;
                scene.images[image.expect("an image") as usize].width
            })
            .collect();
        assert_eq!(widths, [2, 1]);
        assert!(warns(&scene, &["face properties red left out"]));
        assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    }
}

#[test]
fn faces_without_a_texture_are_plain() {
    let rig = Rig::new();
    rig.image("one.png", 1);
    let path = rig.write("scan.ply", wedges(["corners", "uv"], [-1, 0]));
    let scene = import(&path).expect("is read");
    let image = |slot: u16| scene.materials[usize::from(slot)].base_color_image;
    let slots = &scene.meshes[0].triangle_materials;
    assert_eq!([image(slots[0]), image(slots[1])], [None, Some(0)]);
    assert!(warns(&scene, &["textures that no face uses left out: 1"]));
}

/// A texture that is not there costs the looks and is named; nothing outside is looked for where
/// nothing may be.
#[test]
fn textures_that_are_not_there_are_named() {
    let rig = Rig::new();
    let path = rig.write("scan.ply", wedges(["corners", "uv"], [0, 1]));
    let scene = import(&path).expect("is read");
    assert_eq!(scene.source_triangles, 2);
    assert!(warns(&scene, &["images left out", "one.png"]));
    rig.image("one.png", 1);
    let options = OpenOptions {
        self_contained: true,
        ..OpenOptions::default()
    };
    let scene = open(&path, &options).expect("is read");
    assert!(scene.images.is_empty());
    assert!(scene.warnings.concat().contains("in other files left out"));
}

#[test]
fn faces_with_too_few_coordinates_are_counted() {
    let text = wedges(["corners", "uv"], [0, 0]).replace("6 0 0 1 1 0 1", "4 0 0 1 1");
    let scene = read("scan.ply", text).expect("is read");
    assert_eq!(corner_uvs(&scene)[1], [[0.0; 2]; 3]);
    assert!(warns(&scene, &["coordinates for each corner", ": 1 "]));
}

/// In pieces the triangles, their coordinates and their textures are those of the whole.
#[test]
fn pieces_have_the_same_corners() {
    const FACES: u32 = 300_000;
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment TextureFile one.png\n\
         comment TextureFile two.png\nelement vertex 1000\nproperty float x\nproperty float y\n\
         property float z\nelement face {FACES}\nproperty list uchar int vertex_indices\n\
         property list uchar float texcoord\nproperty uchar texnumber\nend_header\n"
    )
    .into_bytes();
    for at in 0..1000u32 {
        let position = [at % 40, at / 40, at % 7].map(|it| it as f32);
        bytes.extend(position.iter().flat_map(|it| it.to_le_bytes()));
    }
    for face in 0..FACES {
        // Every fifth is a quad, so that one lies in two pieces; every eleventh is of the second
        // texture.
        let count = if face % 5 == 3 { 4 } else { 3 };
        bytes.push(count);
        let corner = |at: u32| (face * 3 + at * at * 41) % 1000;
        let indices = (0..u32::from(count)).flat_map(|at| corner(at).to_le_bytes());
        bytes.extend(indices);
        bytes.push(2 * count);
        for at in 0..2 * u32::from(count) {
            bytes.extend((((face + at) % 8) as f32 / 8.0).to_le_bytes());
        }
        bytes.push(u8::from(face % 11 == 0));
    }
    let rig = Rig::new();
    let path = rig.write("scan.ply", bytes);
    let whole = import(&path).expect("is read");
    let opened = open(&path, &OpenOptions::with_max_mesh_bytes(1 << 20)).expect("is read");
    let pieces = opened.into_imported().expect("is read");
    assert_eq!(corners(&pieces), corners(&whole));
    assert_eq!(corner_uvs(&pieces), corner_uvs(&whole));
    let slots = |scene: &ImportedScene| scene.meshes[0].triangle_materials.clone();
    assert_eq!(slots(&pieces), slots(&whole));
    assert!(slots(&whole).contains(&1));
}

fn strips(format: &str, kind: &str, indices: &[i64]) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {format} 1.0\ncomment zipper output\nelement vertex 5\nproperty float x\n\
         property float y\nproperty float z\nelement tristrips 1\n\
         property list int {kind} vertex_indices\nend_header\n"
    )
    .into_bytes();
    let positions = [[0, 0], [0, 1], [1, 0], [1, 1], [2, 0]];
    if format == "ascii" {
        let line = |[x, y]: [i32; 2]| format!("{x} {y} 0\n");
        bytes.extend(positions.into_iter().flat_map(|it| line(it).into_bytes()));
        let list = indices.iter().map(|it| format!(" {it}"));
        bytes.extend(format!("{}{}\n", indices.len(), list.collect::<String>()).bytes());
        return bytes;
    }
    for [x, y] in positions {
        bytes.extend(
            [x as f32, y as f32, 0.0]
                .iter()
                .flat_map(|it| it.to_be_bytes()),
        );
    }
    bytes.extend((indices.len() as i32).to_be_bytes());
    bytes.extend(indices.iter().flat_map(|it| (*it as i32).to_be_bytes()));
    bytes
}

#[test]
fn strips_turn_every_other_triangle() {
    // A strip of three triangles, one that stitches, and a strip of one.
    let indices = [0, 2, 1, 3, 4, -1, -1, 1, 0, 2, 2, -1, 4];
    let expected = [[0, 2, 1], [1, 2, 3], [1, 3, 4], [1, 0, 2]];
    for (format, kind) in [
        ("ascii", "int"),
        ("binary_big_endian", "int"),
        ("binary_big_endian", "uint"),
    ] {
        let scene = read("strips.ply", strips(format, kind, &indices)).expect("is read");
        let positions = [[0, 0], [0, 1], [1, 0], [1, 1], [2, 0]];
        let corner = |at: usize| positions[at].map(f64::from);
        let found = corners(&scene);
        let found = found.iter().map(|it| it.map(|it| [it.x, it.y]));
        let expected = expected.iter().map(|it| it.map(corner));
        assert!(found.eq(expected), "{format} {kind}: {:?}", corners(&scene));
        assert_eq!(scene.source_triangles, 4);
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    }
    let wrong = read("strips.ply", strips("ascii", "int", &[0, 1, 5]));
    let error = wrong.expect_err("is refused");
    assert!(error.contains("tristrips 0: expected indices below 5 or -1, found 5"));
}

/// An error is a line of at most 300 characters behind the name, however long the header's words.
#[test]
fn errors_are_short() {
    let long = "x".repeat(10_000);
    let header = "ply\nformat ascii 1.0\n";
    let vertex = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
    for text in [
        format!("ply\n{long}\n"),
        format!("ply\nformat {long} 1.0\n"),
        format!("{header}element {long} x\n"),
        format!("{header}element vertex {long}\n"),
        format!("{header}property {long} x\n"),
        format!("{header}element {long} 1\nelement {long} 1\n"),
        format!("{header}{vertex}end_header\n{long}\n"),
        format!("{header}{vertex}property float {long}\nend_header\n1 2 3\n"),
        format!(
            "{header}{vertex}element face 1\nproperty list uchar int vertex_indices\n\
            end_header\n0 0 0 3 0 {} 0\n",
            "9".repeat(200)
        ),
    ] {
        let error = read("a.ply", &text).expect_err("is refused");
        let fault = error.split_once("a.ply: ").expect("names the file").1;
        assert!(fault.chars().count() <= 300, "{}: {fault}", fault.len());
    }
    let text = format!(
        "{header}{vertex}property float {long}\nelement {long} 0\nelement face 1\n\
         property list uchar int vertex_indices\nproperty float {long}\nend_header\n\
         0 0 0 0 3 0 0 0 1\n"
    );
    let scene = read("a.ply", text).expect("is read");
    assert!(
        scene
            .warnings
            .iter()
            .all(|line| line.chars().count() <= 300)
    );
}
