//! Numbers of PLY and OBJ: colours of every type, positions that are nowhere, old line ends.

use super::{area, corners, read, read_in_pieces, warns};

/// A binary triangle with colours of this type; each value is of all three corners.
fn colored(kind: &str, values: [f64; 4]) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n\
         property float y\nproperty float z\nproperty {kind} red\nproperty {kind} green\n\
         property {kind} blue\nproperty {kind} alpha\nelement face 1\n\
         property list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    for [x, y] in [[0f32, 0.0], [2.0, 0.0], [0.0, 1.0]] {
        bytes.extend([x, y, 0.0].iter().flat_map(|it| it.to_le_bytes()));
        for value in values {
            match kind {
                "uchar" => bytes.push(value as u8),
                "short" => bytes.extend((value as i16).to_le_bytes()),
                "ushort" => bytes.extend((value as u16).to_le_bytes()),
                "int" => bytes.extend((value as i32).to_le_bytes()),
                "uint" => bytes.extend((value as u32).to_le_bytes()),
                "float" => bytes.extend((value as f32).to_le_bytes()),
                _ => bytes.extend(value.to_le_bytes()),
            }
        }
    }
    bytes.push(3);
    bytes.extend([0i32, 1, 2].iter().flat_map(|it| it.to_le_bytes()));
    bytes
}

/// 188 is about a half in linear light.
#[test]
fn colors_are_read_by_their_range() {
    let half = 128;
    for (kind, values, expected, is_told) in [
        (
            "uchar",
            [255.0, 188.0, 0.0, 51.0],
            [255, half, 0, 51],
            false,
        ),
        (
            "short",
            [255.0, 188.0, 0.0, 51.0],
            [255, half, 0, 51],
            false,
        ),
        (
            "ushort",
            [255.0, 188.0, 0.0, 255.0],
            [255, half, 0, 255],
            false,
        ),
        ("int", [255.0, 188.0, 0.0, 51.0], [255, half, 0, 51], false),
        ("uint", [1.0, 188.0, 0.0, 51.0], [0, half, 0, 51], false),
        (
            "short",
            [32767.0, 24158.0, 0.0, 32767.0],
            [255, half, 0, 255],
            false,
        ),
        (
            "ushort",
            [65535.0, 48316.0, 0.0, 13107.0],
            [255, half, 0, 51],
            false,
        ),
        (
            "uint",
            [4294967295.0, 3166485692.0, 0.0, 4294967295.0],
            [255, half, 0, 255],
            false,
        ),
        ("float", [1.0, 0.7373, 0.0, 0.2], [255, half, 0, 51], false),
        ("float", [255.0, 188.0, 0.0, 51.0], [255, half, 0, 51], true),
        (
            "double",
            [255.0, 188.0, 0.0, 1.0],
            [255, half, 0, 255],
            true,
        ),
    ] {
        let bytes = colored(kind, values);
        for scene in [read("a.ply", &bytes), read_in_pieces("a.ply", &bytes)] {
            let scene = scene.expect(kind);
            let colors = scene.meshes[0].colors.as_deref().expect("colours");
            assert_eq!(colors, [expected; 3], "{kind} {values:?}");
            let told = warns(&scene, &["vertex colours above 1 read as 0..255: 3"]);
            assert_eq!(told, is_told, "{kind}: {:?}", scene.warnings);
        }
    }
}

const HEADER: &str = "element vertex 7\nproperty float x\nproperty float y\nproperty float z\n";
const POINTS: [[f32; 3]; 7] = [
    [0.0, 0.0, 0.0],
    [2.0, 0.0, 0.0],
    [2.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
    [f32::NAN, 0.0, 0.0],
    [0.0, f32::INFINITY, 0.0],
    [9.0, 9.0, 9.0],
];
const FACES: [&[i32]; 5] = [
    &[0, 1, 2],
    &[0, 1, 2, 6, 4],
    &[0, 2, 3],
    &[4, 5, 6],
    &[0, 1, 5],
];

/// Faces with a corner that is nowhere go as a whole, and the others stay.
#[test]
fn faces_that_are_nowhere_are_left_out() {
    let words = ["faces with a position that is not finite left out: 3"];
    let line = |name: &str, it: [f32; 3]| format!("{name}{} {} {}\n", it[0], it[1], it[2]);
    let mut obj = POINTS.map(|it| line("v ", it)).concat();
    for (at, face) in FACES.iter().enumerate() {
        let corners = face.iter().map(|it| format!(" {}", it + 1));
        obj += &format!("usemtl m{at}\nf{}\n", corners.collect::<String>());
    }
    let scene = read("a.obj", obj).expect("is read");
    assert_eq!((corners(&scene).len(), area(&scene)), (2, 2.0));
    assert_eq!(
        (scene.source_triangles, scene.meshes[0].positions.len()),
        (2, 4)
    );
    assert!(warns(&scene, &words), "{:?}", scene.warnings);
    let mesh = &scene.meshes[0];
    let name = |at: usize| {
        let slot = usize::from(mesh.triangle_materials[at]);
        &*scene.materials[mesh.material_slots[slot] as usize].name
    };
    assert_eq!([name(0), name(1)], ["m0", "m2"]);

    let faces = "element face 5\nproperty list uchar int vertex_indices\nend_header\n";
    let mut text = format!("ply\nformat ascii 1.0\n{HEADER}{faces}");
    let mut binary = format!("ply\nformat binary_little_endian 1.0\n{HEADER}{faces}").into_bytes();
    text += &POINTS.map(|it| line("", it)).concat();
    binary.extend(POINTS.iter().flatten().flat_map(|it| it.to_le_bytes()));
    for face in FACES {
        let corners = face.iter().map(|it| format!(" {it}"));
        text += &format!("{}{}\n", face.len(), corners.collect::<String>());
        binary.push(face.len() as u8);
        binary.extend(face.iter().flat_map(|it| it.to_le_bytes()));
    }
    for (bytes, in_pieces) in [(text.as_bytes(), false), (&binary, false), (&binary, true)] {
        let scene = match in_pieces {
            false => read("a.ply", bytes),
            true => read_in_pieces("a.ply", bytes),
        };
        let scene = scene.expect("is read");
        assert_eq!((corners(&scene).len(), area(&scene)), (2, 2.0));
        assert_eq!(
            (scene.source_triangles, scene.meshes[0].positions.len()),
            (2, 4)
        );
        assert!(warns(&scene, &words), "{:?}", scene.warnings);
    }
    let strips = format!(
        "ply\nformat ascii 1.0\n{HEADER}element tristrips 1\n\
         property list int int vertex_indices\nend_header\n{}8 0 1 2 4 -1 0 2 3\n",
        POINTS.map(|it| line("", it)).concat()
    );
    let scene = read("a.ply", strips).expect("is read");
    assert_eq!((corners(&scene).len(), area(&scene)), (2, 2.0));
}

/// Old programs of the Macintosh; the body may begin with a line feed.
#[test]
fn headers_may_end_lines_by_a_carriage_return() {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment old\nelement vertex 3\nproperty uchar x\n\
             property uchar y\nproperty uchar z\nelement face 1\n\
             property list uchar uchar vertex_indices\nend_header\n"
        )
        .replace('\n', "\r")
    };
    let text = header("ascii") + &"10 0 0\n12 0 0\n10 1 0\n3 0 1 2\n".replace('\n', "\r");
    let mut binary = header("binary_big_endian").into_bytes();
    binary.extend([10, 0, 0, 12, 0, 0, 10, 1, 0, 3, 0, 1, 2]);
    for bytes in [text.as_bytes(), &binary] {
        let scene = read("a.ply", bytes).expect("is read");
        assert_eq!((area(&scene), scene.warnings.len()), (1.0, 0));
        assert_eq!(corners(&scene)[0][0].x, 10.0);
    }
}
