//! Coordinates of surveys keep their millimetres.

use glam::DVec3;
use lodestream_server::import::ImportedScene;

use super::{area, corners, read, read_in_pieces};

/// Offsets in metres: UTM and earth-centred ones.
const OFFSETS: [[f64; 3]; 3] = [
    [0.0, 0.0, 0.0],
    [456_789.123, 120.5, -5_428_123.456],
    [4_075_539.886, 931_735.270, 4_801_629.352],
];
const SIDE: usize = 12;

/// A sheet of hills, `[corners of triangles]`, with three decimals.
fn sheet(offset: [f64; 3]) -> Vec<[[f64; 3]; 3]> {
    let point = |x: usize, z: usize| {
        let y = ((x * 7 + z * 13) % 11) as f64 * 0.043;
        let local = [0.2 * x as f64, y, 0.2 * z as f64];
        std::array::from_fn(|axis| {
            let value: f64 = local[axis] + offset[axis];
            (value * 1000.0).round() / 1000.0
        })
    };
    let mut triangles = vec![];
    for (x, z) in (0..SIDE).flat_map(|x| (0..SIDE).map(move |z| (x, z))) {
        let [a, b, c, d] =
            [(x, z), (x, z + 1), (x + 1, z + 1), (x + 1, z)].map(|(x, z)| point(x, z));
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    triangles
}

fn obj(triangles: &[[[f64; 3]; 3]]) -> String {
    let vertices = triangles.iter().flatten();
    let mut text: String = vertices
        .map(|[x, y, z]| format!("v {x:.3} {y:.3} {z:.3}\n"))
        .collect();
    let faces = (0..triangles.len()).map(|at| 3 * at + 1);
    text.extend(faces.map(|at| format!("f {at} {} {}\n", at + 1, at + 2)));
    text
}

fn stl(triangles: &[[[f64; 3]; 3]]) -> String {
    let mut text = "solid sheet\n".to_owned();
    for facet in triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        let vertex = |[x, y, z]: &[f64; 3]| format!("vertex {x:.3} {y:.3} {z:.3}\n");
        text.extend(facet.iter().map(vertex));
        text += "endloop\nendfacet\n";
    }
    text + "endsolid\n"
}

/// `format` and type of the coordinates. A vertex that no face uses lies at the origin.
fn ply(triangles: &[[[f64; 3]; 3]], format: &str, kind: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {format} 1.0\nelement vertex {}\nproperty {kind} x\nproperty {kind} y\n\
         property {kind} z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        triangles.len() * 3 + 1,
        triangles.len()
    )
    .into_bytes();
    let origin = [[0.0; 3]];
    for position in origin.iter().chain(triangles.iter().flatten()) {
        match (format, kind) {
            ("ascii", _) => {
                let [x, y, z] = position;
                bytes.extend(format!("{x:.3} {y:.3} {z:.3}\n").into_bytes());
            }
            (_, "double") => bytes.extend(position.iter().flat_map(|it| it.to_le_bytes())),
            _ => bytes.extend(position.iter().flat_map(|it| (*it as f32).to_le_bytes())),
        }
    }
    for at in (0..triangles.len() as u32).map(|at| 3 * at + 1) {
        let face = [at, at + 1, at + 2];
        match format {
            "ascii" => bytes.extend(format!("3 {} {} {}\n", face[0], face[1], face[2]).bytes()),
            _ => {
                bytes.push(3);
                bytes.extend(face.iter().flat_map(|it| it.to_le_bytes()));
            }
        }
    }
    bytes
}

fn binary_stl(triangles: &[[[f64; 3]; 3]]) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for facet in triangles {
        bytes.extend([0; 12]);
        let floats = facet.iter().flatten().map(|it| *it as f32);
        bytes.extend(floats.flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}

/// Every corner lies where `triangles` has it, to within `most_off` metres.
fn lies_at(scene: &ImportedScene, triangles: &[[[f64; 3]; 3]], most_off: f64) {
    let found = corners(scene);
    assert_eq!(found.len(), triangles.len());
    let pairs = found.iter().flatten().zip(triangles.iter().flatten());
    for (found, expected) in pairs {
        let off = found.distance(DVec3::from(*expected));
        assert!(off <= most_off, "{off} m off {expected:?}");
    }
}

#[test]
fn texts_and_doubles_keep_their_place() {
    let near = area(&read("near.obj", obj(&sheet(OFFSETS[0]))).expect("is read"));
    for offset in OFFSETS {
        let triangles = sheet(offset);
        let little = "binary_little_endian";
        let scenes = [
            ("obj", read("a.obj", obj(&triangles))),
            ("stl", read("a.stl", stl(&triangles))),
            ("text", read("a.ply", ply(&triangles, "ascii", "float"))),
            ("doubles", read("a.ply", ply(&triangles, little, "double"))),
            (
                "pieces",
                read_in_pieces("a.ply", ply(&triangles, little, "double")),
            ),
        ];
        for (kind, scene) in scenes {
            let scene = scene.expect(kind);
            // Half a step of f32 at two metres, on each axis.
            lies_at(&scene, &triangles, 3e-7);
            assert!((area(&scene) - near).abs() < 1e-4 * near, "{kind}");
            assert_eq!(scene.meshes[0].triangles.len(), 2 * SIDE * SIDE);
        }
    }
}

/// Files of floats are told from a point near them, too, and lose nothing.
#[test]
fn floats_are_kept_as_they_are() {
    for offset in OFFSETS {
        let round = |it: f64| f64::from(it as f32);
        let sheet = sheet(offset).into_iter();
        let triangles: Vec<[[f64; 3]; 3]> =
            sheet.map(|it| it.map(|corner| corner.map(round))).collect();
        let binary = ply(&triangles, "binary_little_endian", "float");
        // A facet of which two corners have become one is left out; a face keeps its indices.
        let is_whole = |[a, b, c]: &[[f64; 3]; 3]| a != b && b != c && c != a;
        let facets: Vec<_> = triangles.iter().copied().filter(is_whole).collect();
        let scenes = [
            (read("a.stl", binary_stl(&triangles)), &facets),
            (read_in_pieces("a.stl", binary_stl(&triangles)), &facets),
            (read("a.ply", &binary), &triangles),
            (read_in_pieces("a.ply", &binary), &triangles),
        ];
        for (scene, expected) in scenes {
            let scene = scene.expect("is read");
            let kept = corners(&scene)
                .into_iter()
                .map(|it| it.map(|it| it.to_array()));
            assert!(kept.eq(expected.iter().copied()), "moved at {offset:?}");
        }
    }
}

/// Normal files are in the scene as they are in the file.
#[test]
fn near_meshes_have_no_place_of_their_own() {
    for name in ["a.obj", "a.stl"] {
        let triangles = sheet([1.5, -0.25, 3.0]);
        let bytes = if name == "a.obj" {
            obj(&triangles)
        } else {
            stl(&triangles)
        };
        let scene = read(name, bytes).expect("is read");
        let place = scene.instances[0].world_from_object;
        assert_eq!(place, glam::DAffine3::IDENTITY);
        let first = triangles[0][0].map(|it| it as f32);
        let mesh = &scene.meshes[0];
        assert_eq!(mesh.positions[mesh.triangles[0][0] as usize], first);
    }
}
