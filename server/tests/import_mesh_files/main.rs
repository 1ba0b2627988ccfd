//! Mesh files: `.obj`, `.ply` and `.stl`, each written here, read right or refused in one clear line.

// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

mod broken;
mod pieces;
mod right;

use lodestream_server::import::{ImportedScene, import};

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
