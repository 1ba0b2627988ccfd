//! Small files made in code: each holds one thing, and the test says what must come of it.

// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

mod extensions;
mod habits;
mod looks;
mod nodes;
mod normals;
mod poses;
mod ranges;
mod robust;
mod scene;

use std::path::Path;

use glam::DVec3;
use serde_json::{Value, json};

use super::OpenOptions;
use super::allowance::Allowance;
use super::error::Fault;
use super::file::Extent;
use super::scene::{ImportedScene, Instance};

const FLOAT: u32 = 5126;

/// A glTF document with one buffer, grown accessor by accessor.
struct File {
    json: Value,
    bin: Vec<u8>,
}

impl File {
    /// One mesh without primitives, one node that shows it.
    fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}], "meshes": [{"primitives": []}],
            "accessors": [], "bufferViews": [], "buffers": [{}],
        });
        Self {
            json,
            bin: Vec::new(),
        }
    }

    fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.json[list].as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()});
        self.bin.extend(bytes);
        self.push("bufferViews", view)
    }

    fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        let accessor = json!({
            "bufferView": view, "componentType": component, "type": kind, "count": count,
        });
        self.push("accessors", accessor)
    }

    fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values
            .iter()
            .flatten()
            .flat_map(|it| it.to_le_bytes())
            .collect();
        self.accessor(&bytes, FLOAT, &format!("VEC{N}"), values.len())
    }

    fn indices(&mut self, indices: &[u16]) -> usize {
        let bytes: Vec<u8> = indices.iter().flat_map(|it| it.to_le_bytes()).collect();
        self.accessor(&bytes, 5123, "SCALAR", indices.len())
    }

    fn primitive(&mut self, primitive: Value) {
        let primitives = &mut self.json["meshes"][0]["primitives"];
        primitives.as_array_mut().unwrap().push(primitive);
    }

    fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"][0]["byteLength"] = self.bin.len().into();
        let mut json = json.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut glb = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
        for (kind, data) in [(b"JSON", &json), (b"BIN\0", &self.bin)] {
            glb.extend((data.len() as u32).to_le_bytes());
            glb.extend(kind);
            glb.extend(data);
        }
        let length = glb.len() as u32;
        glb[8..12].copy_from_slice(&length.to_le_bytes());
        glb
    }

    fn matrices(&mut self, matrices: &[glam::DMat4]) -> usize {
        let numbers = matrices.iter().flat_map(|it| it.to_cols_array());
        let bytes: Vec<u8> = numbers.flat_map(|it| (it as f32).to_le_bytes()).collect();
        self.accessor(&bytes, FLOAT, "MAT4", matrices.len())
    }

    fn read(&self) -> Result<ImportedScene, Fault> {
        read(&self.glb())
    }

    fn scene(&self) -> ImportedScene {
        self.read().unwrap()
    }

    fn fault(&self) -> String {
        self.read().unwrap_err().to_string()
    }
}

const QUAD: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
];

fn quad() -> File {
    let mut file = File::new();
    let position = file.floats(&QUAD);
    let indices = file.indices(&[0, 1, 2, 0, 2, 3]);
    file.primitive(json!({"attributes": {"POSITION": position}, "indices": indices}));
    file
}

/// Reads a file in memory.
fn read(bytes: &[u8]) -> Result<ImportedScene, Fault> {
    read_with(bytes, &OpenOptions::default())
}

fn read_with(bytes: &[u8], options: &OpenOptions) -> Result<ImportedScene, Fault> {
    let file = Extent::memory(bytes.to_vec());
    let allowance = Allowance::new(Path::new("."), options);
    let scene = super::read_gltf(&file, &allowance, "test", options)?;
    scene.into_imported().map_err(|error| error.fault)
}

/// The line that has `what` in it.
fn find<'a>(warnings: &'a [String], what: &str) -> &'a str {
    let line = warnings.iter().find(|it| it.contains(what));
    line.unwrap_or_else(|| panic!("{what}: {warnings:?}"))
}

/// Corners of all triangles in the world, by instance.
fn corners(scene: &ImportedScene) -> Vec<Vec<DVec3>> {
    let of_instance = |instance: &Instance| {
        let mesh = &scene.meshes[instance.mesh as usize];
        let vertices = mesh.triangles.iter().flatten();
        let positions = vertices.map(|&at| mesh.positions[at as usize].map(f64::from));
        let world = |it: [f64; 3]| instance.world_from_object.transform_point3(it.into());
        positions.map(world).collect()
    };
    scene.instances.iter().map(of_instance).collect()
}

/// A picture of 3 by 2 pixels.
fn picture(format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let picture = image::DynamicImage::new_rgb8(3, 2);
    picture.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}
