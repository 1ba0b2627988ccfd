//! A glTF file as a modelling program would write it: a textured sphere and a torus of two materials, five instances.

use std::f32::consts::TAU;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

/// Triangles of the sphere.
pub const SPHERE_TRIANGLES: u64 = 2 * RINGS * SEGMENTS - 2 * SEGMENTS;
/// Triangles of the torus.
pub const TORUS_TRIANGLES: u64 = 2 * 48 * 96;
/// Triangles over all instances: two spheres and three toruses.
pub const DRAWN_TRIANGLES: u64 = 2 * SPHERE_TRIANGLES + 3 * TORUS_TRIANGLES;
/// Instances.
pub const INSTANCES: u64 = 5;
/// Area of the sphere of radius 1, square metres.
pub const SPHERE_AREA: f64 = 12.566_370_6;

const RINGS: u64 = 64;
const SEGMENTS: u64 = 128;

#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    fn view(&mut self, bytes: &[u8]) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views
            .push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }));
        self.views.len() - 1
    }

    fn accessor(&mut self, bytes: &[u8], component: u32, count: usize, kind: &str) -> usize {
        let view = self.view(bytes);
        self.accessors.push(json!({
            "bufferView": view, "componentType": component, "count": count, "type": kind,
        }));
        self.accessors.len() - 1
    }

    fn vec3(&mut self, values: &[[f32; 3]]) -> usize {
        let accessor = self.accessor(bytemuck::cast_slice(values), 5126, values.len(), "VEC3");
        let fold = |f: fn(f32, f32) -> f32, start: f32| -> [f32; 3] {
            std::array::from_fn(|axis| values.iter().map(|v| v[axis]).fold(start, f))
        };
        self.accessors[accessor]["min"] = json!(fold(f32::min, f32::MAX));
        self.accessors[accessor]["max"] = json!(fold(f32::max, f32::MIN));
        accessor
    }

    fn vec2(&mut self, values: &[[f32; 2]]) -> usize {
        self.accessor(bytemuck::cast_slice(values), 5126, values.len(), "VEC2")
    }

    fn indices(&mut self, triangles: &[[u32; 3]]) -> usize {
        self.accessor(
            bytemuck::cast_slice(triangles),
            5125,
            3 * triangles.len(),
            "SCALAR",
        )
    }
}

/// Writes `model.glb` into `folder`.
pub fn write(folder: &Path) -> PathBuf {
    let mut buffer = Buffer::default();
    let meshes = json!([sphere(&mut buffer), torus(&mut buffer)]);
    let mut png = vec![];
    let picture =
        image::RgbImage::from_fn(8, 4, |x, y| image::Rgb([x as u8 * 30, y as u8 * 60, 9]));
    picture
        .write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png)
        .expect("encodes");
    let image = buffer.view(&png);
    let document = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 1, 2, 3, 4] }],
        "nodes": [
            { "mesh": 0 },
            { "mesh": 0, "translation": [4.0, 0.0, 0.0], "scale": [2.0, 2.0, 2.0] },
            { "mesh": 1 },
            { "mesh": 1, "translation": [0.0, 5.0, 0.0] },
            { "mesh": 1, "translation": [0.0, -5.0, 0.0], "scale": [-1.0, 1.0, 1.0] },
        ],
        "meshes": meshes,
        "materials": [
            {
                "name": "painted",
                "pbrMetallicRoughness": {
                    "baseColorTexture": { "index": 0 }, "metallicFactor": 0.0, "roughnessFactor": 0.5,
                },
            },
            { "name": "red", "pbrMetallicRoughness": { "baseColorFactor": [1.0, 0.0, 0.0, 1.0] } },
            { "name": "glow", "emissiveFactor": [0.0, 1.0, 0.0], "doubleSided": true },
        ],
        "textures": [{ "source": 0, "sampler": 0 }],
        "samplers": [{ "wrapS": 33648, "wrapT": 33071, "magFilter": 9728 }],
        "images": [{ "bufferView": image, "mimeType": "image/png" }],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{ "byteLength": buffer.bytes.len() }],
    });
    let path = folder.join("model.glb");
    std::fs::write(&path, glb(&document, &buffer.bytes)).expect("writes");
    path
}

fn glb(document: &Value, bin: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + bin.len();
    let mut bytes = b"glTF".to_vec();
    bytes.extend(2u32.to_le_bytes());
    bytes.extend((total as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json[..]), (b"BIN\0", bin)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

/// Radius 1, one vertex at each pole.
fn sphere(buffer: &mut Buffer) -> Value {
    let (mut positions, mut uvs, mut triangles) = (vec![], vec![], vec![]);
    let row = SEGMENTS as u32 + 1;
    for ring in 0..=RINGS {
        for segment in 0..=SEGMENTS {
            let (v, u) = (ring as f32 / RINGS as f32, segment as f32 / SEGMENTS as f32);
            let (polar, around) = (v * TAU / 2.0, u % 1.0 * TAU);
            // The poles are exact, so that the fans close.
            let radius = if ring == 0 || ring == RINGS {
                0.0
            } else {
                polar.sin()
            };
            positions.push([radius * around.cos(), polar.cos(), radius * -around.sin()]);
            uvs.push([u, v]);
        }
    }
    for ring in 0..RINGS as u32 {
        for segment in 0..SEGMENTS as u32 {
            let (a, b) = (ring * row + segment, (ring + 1) * row + segment);
            if ring > 0 {
                triangles.push([a, b, a + 1]);
            }
            if ring + 1 < RINGS as u32 {
                triangles.push([a + 1, b, b + 1]);
            }
        }
    }
    assert_eq!(triangles.len() as u64, SPHERE_TRIANGLES);
    let attributes = json!({
        "POSITION": buffer.vec3(&positions), "NORMAL": buffer.vec3(&positions), "TEXCOORD_0": buffer.vec2(&uvs),
    });
    let indices = buffer.indices(&triangles);
    json!({ "name": "sphere", "primitives": [{ "attributes": attributes, "indices": indices, "material": 0 }] })
}

/// Two halves with a material each.
fn torus(buffer: &mut Buffer) -> Value {
    const TUBE: u32 = 48;
    const WAY: u32 = 96;
    let mut positions = vec![];
    for i in 0..WAY {
        for j in 0..TUBE {
            let (around, tube) = (i as f32 / WAY as f32 * TAU, j as f32 / TUBE as f32 * TAU);
            let radius = 1.0 + 0.3 * tube.cos();
            positions.push([
                radius * around.cos(),
                0.3 * tube.sin(),
                radius * -around.sin(),
            ]);
        }
    }
    let position = buffer.vec3(&positions);
    let primitives: Vec<Value> = (0..2)
        .map(|half| {
            let quads = (half * WAY / 2..(half + 1) * WAY / 2).flat_map(|i| {
                (0..TUBE).flat_map(move |j| {
                    let at = |i: u32, j: u32| i % WAY * TUBE + j % TUBE;
                    let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
                    [[a, b, c], [c, b, d]]
                })
            });
            let indices = buffer.indices(&quads.collect::<Vec<_>>());
            json!({ "attributes": { "POSITION": position }, "indices": indices, "material": 1 + half })
        })
        .collect();
    json!({ "name": "torus", "primitives": primitives })
}
