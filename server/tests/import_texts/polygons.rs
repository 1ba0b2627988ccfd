//! Polygons cover the area that their outline encloses.

use super::{area, read, read_in_pieces, warns};

/// A letter of a sign, and a frame whose hole is reached by a bridge.
const LETTER: &[[f64; 2]] = &[[2., 0.], [2., 1.], [1., 1.], [1., 2.], [0., 2.], [0., 0.]];
const FRAME: &[[f64; 2]] = &[
    [0., 0.],
    [1., 1.],
    [1., 2.],
    [2., 2.],
    [2., 1.],
    [1., 1.],
    [0., 0.],
    [3., 0.],
    [3., 3.],
    [0., 3.],
];
const NOTCH: &[[f64; 2]] = &[[0., 0.], [4., 2.], [0., 4.], [1., 2.]];
const OUTLINES: [(&[[f64; 2]], f64); 3] = [(LETTER, 3.0), (FRAME, 8.0), (NOTCH, 6.0)];

fn obj(outline: &[[f64; 2]], first: &str) -> String {
    let mut text = first.to_owned();
    outline
        .iter()
        .for_each(|[x, y]| text += &format!("v {x} {y} 0.5\nvt {x} {y}\nvn 0 0 1\n"));
    text += "f";
    (1..=outline.len()).for_each(|at| text += &format!(" {at}/{at}/{at}"));
    text + "\n"
}

/// The outline as one face, binary; `wedges` gives each corner texture coordinates of its own.
fn ply(outline: &[[f64; 2]], wedges: bool) -> Vec<u8> {
    let count = outline.len() as u8;
    let uvs = match wedges {
        true => "property list uchar float texcoord\n",
        false => "",
    };
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty float x\n\
         property float y\nproperty double z\nelement face 1\n\
         property list uchar uchar vertex_indices\n{uvs}end_header\n"
    )
    .into_bytes();
    for [x, y] in outline {
        bytes.extend(
            [*x as f32, *y as f32]
                .iter()
                .flat_map(|it| it.to_le_bytes()),
        );
        bytes.extend(0.5f64.to_le_bytes());
    }
    bytes.push(count);
    bytes.extend(0..count);
    if wedges {
        bytes.push(2 * count);
        let uvs = outline.iter().flatten();
        bytes.extend(uvs.flat_map(|it| (*it as f32).to_le_bytes()));
    }
    bytes
}

#[test]
fn concave_and_holed_faces_have_their_area() {
    for (outline, expected) in OUTLINES {
        for start in 0..outline.len() {
            let mut outline = outline.to_vec();
            outline.rotate_left(start);
            for turn in 0..2 {
                let scenes = [
                    read("a.obj", obj(&outline, "")),
                    read("a.ply", ply(&outline, false)),
                    read("a.ply", ply(&outline, true)),
                    read_in_pieces("a.ply", ply(&outline, false)),
                    read_in_pieces("a.ply", ply(&outline, true)),
                ];
                for (kind, scene) in scenes.into_iter().enumerate() {
                    let scene = scene.expect("is read");
                    let found = area(&scene);
                    let off = (found - expected).abs();
                    assert!(off < 1e-6, "{kind} {start} {turn}: {found}, {expected}");
                    assert_eq!(scene.source_triangles, outline.len() as u64 - 2);
                    assert!(!warns(&scene, &["polygons"]), "{:?}", scene.warnings);
                }
                outline.reverse();
            }
        }
    }
}

/// Attributes go with their corners, whichever way a polygon is cut.
#[test]
fn corners_keep_their_texture_coordinates() {
    let scenes = [
        read("a.obj", obj(LETTER, "")),
        read("a.ply", ply(LETTER, true)),
        read_in_pieces("a.ply", ply(LETTER, true)),
    ];
    for scene in scenes {
        let scene = scene.expect("is read");
        let mesh = &scene.meshes[0];
        let uvs = mesh.uvs.as_ref().expect("coordinates");
        for ([x, y, _], [u, v]) in mesh.positions.iter().zip(uvs) {
            assert_eq!([*x, *y], [*u, 1.0 - v]);
        }
    }
}

/// Faces may stand before their positions, and keep to their material and their winding.
#[test]
fn faces_before_their_positions_are_cut() {
    let [vertices, face] = [obj(LETTER, ""), String::new()].map(|it| it.replace("f ", "#f "));
    let text = format!("usemtl a\nf 1 2 3 4 5 6\nusemtl b\nf 1 2 3\n{face}{vertices}");
    let scene = read("a.obj", text).expect("is read");
    assert!((area(&scene) - 3.0 - 0.5).abs() < 1e-6);
    assert_eq!(scene.meshes[0].triangle_materials, [0, 0, 0, 0, 1]);
    for [a, b, c] in super::corners(&scene) {
        assert!((b - a).cross(c - a).z >= 0.0, "turned over");
    }
}

#[test]
fn faces_that_cross_themselves_are_named() {
    let bow = obj(&[[0., 0.], [2., 2.], [2., 0.], [0., 1.]], "");
    let scene = read("bow.obj", bow).expect("is read");
    assert_eq!(scene.source_triangles, 2);
    assert!(warns(&scene, &["polygons that cross themselves", ": 1 "]));
}

/// Longer ones are fans, and a warning.
#[test]
fn faces_of_very_many_corners_stay_fans() {
    let mut text = "v 0 0 0\nv 4 2 0\nv 0 4 0\nv 1 2 0\nf".to_owned();
    (0..140_000).for_each(|at| text += [" 1", " 2", " 3", " 4"][at % 4]);
    let scene = read("long.obj", text).expect("is read");
    assert_eq!(scene.source_triangles, 139_998);
    assert!(warns(
        &scene,
        &["polygons of more than 131072 corners cut into fans"]
    ));
}
