//! Mesh files: `.obj`, `.ply` and `.stl`, each written here, read right or refused in one clear line.

// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use lodestream_server::import::{
    AlphaMode, ImportedScene, MeshSource, OpenOptions, OpenedMesh, SamplerWrap, import, open,
};

fn read(name: &str, bytes: &[u8]) -> Result<ImportedScene, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    import(&path).map_err(|error| error.to_string())
}

/// Corner positions, triangle by triangle.
fn corners(scene: &ImportedScene) -> Vec<[[f32; 3]; 3]> {
    let mesh = &scene.meshes[0];
    let corner = |vertex: u32| mesh.positions[vertex as usize];
    mesh.triangles.iter().map(|it| it.map(corner)).collect()
}

const SQUARE: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
];

fn square_corners() -> Vec<[[f32; 3]; 3]> {
    let [a, b, c, d] = SQUARE;
    vec![[a, b, c], [a, c, d]]
}

const OBJ: &str = "# a square with an apex
mtllib square.mtl
o square
v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0.5 0.5 0.5\nv 0 1 0 1 1 1
vt 0 0\nvt 1 0\nvt 1 0.75\nvt 0 1
vn 0 0 2
usemtl painted wall
f -4/-4/1 -3/-3/1 \\
  -2/-2/1 -1/-1/1
v 0.5 0.5 1
usemtl glass
f 1 2 5
l 1 2
f 1 1 2
";

const MTL: &str = "newmtl painted wall
Kd 0.5 0.5 0.5
Ke 1 0 0
map_Kd -s 2 2 1 -clamp on textures\\wall 1.png
newmtl glass
Kd 0 0 0
d 0.25
map_bump bump.png
";

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

const PLY_VERTEX: &str = "element vertex 4
property float x\nproperty double y\nproperty float z
property float nx\nproperty float ny\nproperty float nz
property float s\nproperty float t
property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha
property short quality
";
const PLY_REST: &str = "element face 1
property uchar flags\nproperty list uchar int vertex_indices
element edge 1\nproperty list ushort short ends\nproperty float weight
";

/// The square in one of the three encodings; `faces_first` turns the order of the elements around.
fn ply(format: &str, faces_first: bool) -> Vec<u8> {
    let parts = match faces_first {
        true => [PLY_REST, PLY_VERTEX],
        false => [PLY_VERTEX, PLY_REST],
    };
    let header = format!(
        "ply\nformat {format} 1.0\ncomment TextureFile none.png\n{}{}end_header\n",
        parts[0], parts[1]
    );
    let mut vertices = Body::new(format);
    for (at, [x, y, z]) in SQUARE.into_iter().enumerate() {
        vertices.f32(x);
        vertices.f64(f64::from(y));
        [z, 0.0, 0.0, 4.0, x, y]
            .into_iter()
            .for_each(|it| vertices.f32(it));
        [188, 0, 255, 60 * at as u8]
            .into_iter()
            .for_each(|it| vertices.u8(it));
        vertices.i16(-7);
    }
    let mut rest = Body::new(format);
    rest.u8(1);
    rest.u8(4);
    (0..4).for_each(|it| rest.i32(it));
    rest.i16(2);
    rest.i16(0);
    rest.i16(1);
    rest.f32(0.5);
    let mut bytes = header.into_bytes();
    let (first, second) = match faces_first {
        true => (rest, vertices),
        false => (vertices, rest),
    };
    bytes.extend(first.bytes);
    bytes.extend(second.bytes);
    bytes
}

struct Body {
    text: bool,
    big: bool,
    bytes: Vec<u8>,
}

impl Body {
    fn new(format: &str) -> Self {
        Self {
            text: format == "ascii",
            big: format == "binary_big_endian",
            bytes: vec![],
        }
    }

    fn put(&mut self, text: String, mut little: Vec<u8>) {
        if self.big {
            little.reverse();
        }
        match self.text {
            true => self.bytes.extend(format!("{text}\n").into_bytes()),
            false => self.bytes.extend(little),
        }
    }

    fn f32(&mut self, it: f32) {
        self.put(it.to_string(), it.to_le_bytes().to_vec());
    }

    fn f64(&mut self, it: f64) {
        self.put(it.to_string(), it.to_le_bytes().to_vec());
    }

    fn u8(&mut self, it: u8) {
        self.put(it.to_string(), vec![it]);
    }

    fn i16(&mut self, it: i16) {
        self.put(it.to_string(), it.to_le_bytes().to_vec());
    }

    fn i32(&mut self, it: i32) {
        self.put(it.to_string(), it.to_le_bytes().to_vec());
    }
}

const FORMATS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

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

fn binary_stl(header: &str, triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = header.as_bytes().to_vec();
    bytes.resize(80, 0);
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        // A normal that must not matter.
        bytes.extend([0x7f; 12]);
        let floats = triangle.iter().flatten();
        bytes.extend(floats.flat_map(|it| it.to_le_bytes()));
        bytes.extend([0, 0]);
    }
    bytes
}

fn text_stl() -> String {
    let mut text = "solid facet of a name\n".to_owned();
    for triangle in square_corners() {
        text += "  facet normal nan nan nan\n    outer loop\n";
        for [x, y, z] in triangle {
            text += &format!("      vertex {x:e} {y:e} {z:e}\n");
        }
        text += "    endloop\n  endfacet\n";
    }
    text + "endsolid facet of a name"
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

#[test]
fn broken_mesh_files_are_refused_with_their_place() {
    let ply = |body: &str| format!("ply\nformat ascii 1.0\n{body}").into_bytes();
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let one = |vertices: &str, face: &str| {
        let count = vertices.lines().count();
        ply(&format!(
            "element vertex {count}\n{xyz}{faces}{vertices}{face}"
        ))
    };
    let three = "0 0 0\n1 0 0\n0 1 0\n";
    let mut nan_stl = binary_stl("", &square_corners());
    nan_stl[84 + 50 + 12..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    let mut lying_stl = binary_stl("", &square_corners());
    lying_stl[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    let huge = format!("element vertex 4294967290\n{xyz}{faces}");
    let huge_binary = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\n{xyz}element face 99999999999\n\
         property list uint int vertex_indices\nend_header\n"
    );
    let mut long_list = huge_binary.clone().into_bytes();
    long_list.extend([0; 36]);
    long_list.extend(u32::MAX.to_le_bytes());
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        (
            "a.obj",
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n".to_vec(),
            "line 4: expected an index into 3 positions, found 4",
        ),
        (
            "a.obj",
            b"v 0 0 0\nf 1 1 -2\n".to_vec(),
            "line 2: expected an index into 1 positions, from 1 or from -1",
        ),
        (
            "a.obj",
            b"v 0 0 0\nf 0 1 1\n".to_vec(),
            "line 2: expected an index",
        ),
        (
            "a.obj",
            b"v 0 0 0\nf 1/1 1/1 1/1\n".to_vec(),
            "line 2: expected an index into 0 texture",
        ),
        (
            "a.obj",
            b"v 0 nan 0\n".to_vec(),
            "line 1: expected three finite numbers",
        ),
        (
            "a.obj",
            b"v 0 zero 0\n".to_vec(),
            "line 1: expected a number, found \"zero\"",
        ),
        (
            "a.obj",
            b"v 0 0\n".to_vec(),
            "line 1: expected three finite numbers",
        ),
        (
            "a.obj",
            vec![0x4c, 1, 0, 0, 0xff, 0xfe, 10, 3],
            "line 1: expected a statement of OBJ",
        ),
        ("a.ply", b"plyx\n".to_vec(), "header line 1: expected ply"),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\n".to_vec(),
            "header line 3: expected end_header",
        ),
        (
            "a.ply",
            b"ply\nformat ascii 2.0\nend_header\n".to_vec(),
            "header line 2",
        ),
        (
            "a.ply",
            ply("element vertex -1\nend_header\n"),
            "header line 3: expected a number of elements",
        ),
        (
            "a.ply",
            ply("element vertex 1\nproperty half x\nend_header\n"),
            "header line 4",
        ),
        (
            "a.ply",
            ply("element vertex 1\nproperty float x\nend_header\n0\n"),
            "the properties x, y and z",
        ),
        (
            "a.ply",
            one(three, "3 0 1 3\n"),
            "face 0: expected indices below 3, found 3",
        ),
        (
            "a.ply",
            one(three, "3 0 1 -1\n"),
            "face 0: expected indices below 3, found -1",
        ),
        (
            "a.ply",
            one(three, "3 0 1 1.5\n"),
            "face 0: expected indices below 3, found 1.5",
        ),
        (
            "a.ply",
            one(three, "3 0 1\n"),
            "expected a number, found the end of the file",
        ),
        (
            "a.ply",
            one(three, "-3 0 1 2\n"),
            "expected a list's length, found -3",
        ),
        (
            "a.ply",
            one(three, "three\n"),
            "line 4 of the body: expected a number, found \"three\"",
        ),
        (
            "a.ply",
            one("0 0 0\n1 inf 0\n0 1 0\n", "3 0 1 2\n"),
            "vertex 1: expected finite numbers",
        ),
        ("a.ply", ply(&huge), "expected a number, found the end"),
        (
            "a.ply",
            huge_binary.into_bytes(),
            "expected 36 bytes more, found the end of the file after 0",
        ),
        (
            "a.ply",
            long_list,
            "expected 4 bytes more, found the end of the file after 0",
        ),
        (
            "a.stl",
            b"".to_vec(),
            "\"solid\" or a header of 84 bytes, found 0 bytes",
        ),
        ("a.stl", nan_stl, "facet 1: expected finite numbers"),
        (
            "a.stl",
            lying_stl,
            "expected 214748364834 bytes for 4294967295 facets",
        ),
        (
            "a.stl",
            b"solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0\nendloop".to_vec(),
            "line 5: expected a number, found \"endloop\"",
        ),
        (
            "a.stl",
            b"solid\n".to_vec(),
            "line 2: expected facet or endsolid, found the end of the file",
        ),
        ("a.xyz", b"1 2 3\n".to_vec(), "expected the magic"),
        ("a.glb", b"1 2 3\n".to_vec(), "expected the magic"),
    ];
    for (name, bytes, expected) in cases {
        let error = read(name, &bytes).expect_err(expected);
        assert!(error.contains(expected), "{error:?} has no {expected:?}");
        assert!(
            error.lines().count() == 1 && error.contains(name),
            "{error:?}"
        );
    }
}

/// Cut and changed files: an answer for each, never a panic. A cut binary file is always refused.
#[test]
fn no_cut_or_flipped_byte_panics() {
    let folder = tempfile::tempdir().unwrap();
    let files: Vec<(&str, Vec<u8>, bool)> = vec![
        ("a.obj", OBJ.as_bytes().to_vec(), false),
        ("b.ply", ply(FORMATS[0], false), false),
        ("c.ply", ply(FORMATS[1], false), true),
        ("d.ply", ply(FORMATS[2], true), true),
        ("e.stl", binary_stl("solid", &square_corners()), true),
        ("f.stl", text_stl().into_bytes(), false),
    ];
    let streaming = OpenOptions { max_mesh_bytes: 0 };
    for (name, whole, binary) in files {
        let path = folder.path().join(name);
        let answer = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let loaded = import(&path).map_err(|error| error.to_string());
            let streamed = open(&path, &streaming).and_then(|it| it.into_imported());
            if let Err(error) = &loaded {
                assert_eq!(error.lines().count(), 1, "{error:?}");
            }
            assert_eq!(
                loaded.is_ok(),
                streamed.is_ok(),
                "{name}: {loaded:?} {streamed:?}"
            );
            loaded
        };
        assert!(answer(&whole).is_ok(), "{name}");
        for length in 0..whole.len() {
            assert!(
                answer(&whole[..length]).is_err() || !binary,
                "{name} cut to {length}"
            );
        }
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << (at * 5 % 8);
            let _ = answer(&bytes);
        }
    }
}

/// A grid of 400 by 500 quads, some of them as two triangles, one corner as a pentagon: more than one piece.
fn grid_ply(folder: &Path) -> std::path::PathBuf {
    const WIDE: i32 = 400;
    const HIGH: i32 = 500;
    let mut body = Body::new("binary_little_endian");
    for y in 0..=HIGH {
        for x in 0..=WIDE {
            body.f32(x as f32);
            body.f32(y as f32);
            body.f32(((x * 7 + y * 13) % 17) as f32 * 0.1);
            [x as u8, y as u8, 9].into_iter().for_each(|it| body.u8(it));
        }
    }
    let mut faces = 0;
    let mut face = |body: &mut Body, corners: &[i32]| {
        body.u8(corners.len() as u8);
        corners.iter().for_each(|&it| body.i32(it));
        faces += 1;
    };
    for y in 0..HIGH {
        for x in 0..WIDE {
            let a = y * (WIDE + 1) + x;
            let [b, c, d] = [a + 1, a + WIDE + 2, a + WIDE + 1];
            match (x + y) % 3 {
                0 => face(&mut body, &[a, b, c, d]),
                1 => face(&mut body, &[a, b, c, d, d]),
                _ => {
                    face(&mut body, &[a, b, c]);
                    face(&mut body, &[a, c, d]);
                }
            }
        }
    }
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n",
        (WIDE + 1) * (HIGH + 1)
    );
    let path = folder.join("grid.ply");
    let bytes = [header.into_bytes(), body.bytes].concat();
    std::fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn large_mesh_files_are_read_in_pieces() {
    let folder = tempfile::tempdir().unwrap();
    let ply = grid_ply(folder.path());
    let whole = import(&ply).unwrap();
    let stl = folder.path().join("grid.stl");
    std::fs::write(&stl, binary_stl("grid", &corners(&whole))).unwrap();
    for path in [ply, stl] {
        let whole = import(&path).unwrap();
        let options = OpenOptions {
            max_mesh_bytes: 1 << 20,
        };
        let opened = open(&path, &options).unwrap();
        let OpenedMesh::Streamed(mesh) = &opened.meshes[0] else {
            panic!("{} is loaded", path.display());
        };
        assert_eq!(mesh.triangle_count(), whole.source_triangles);
        assert_eq!(opened.source_triangles, whole.source_triangles);
        assert!(mesh.piece_count() >= 2);
        for index in 0..mesh.piece_count() {
            let piece = mesh.piece(index).unwrap();
            assert!(piece.triangles.len() <= 1 << 18);
            // Vertices stand in the order of first use.
            let mut next = 0;
            for &corner in piece.triangles.iter().flatten() {
                assert!(corner <= next);
                next = next.max(corner + 1);
            }
            assert_eq!(next as usize, piece.positions.len());
        }
        let whole_colors = whole.meshes[0].colors.clone();
        let streamed = opened.into_imported().unwrap();
        assert_eq!(corners(&streamed), corners(&whole));
        let mesh = &streamed.meshes[0];
        assert!(mesh.normals.is_none());
        if let Some(expected) = whole_colors {
            let colors = mesh.colors.as_ref().unwrap();
            let pairs = mesh.triangles.iter().zip(&whole.meshes[0].triangles);
            for (a, b) in pairs.flat_map(|(a, b)| a.iter().zip(b)) {
                assert_eq!(colors[*a as usize], expected[*b as usize]);
            }
        }
    }
}
