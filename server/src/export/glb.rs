//! Binary glTF 2.0: one mesh an asset, instances as nodes, materials and textures.

use std::io::{self, Write};
use std::path::Path;

use bytes::Bytes;
use glam::DVec3;
use gltf::json::accessor::{FLOAT, UNSIGNED_BYTE, UNSIGNED_INT};
use lodestream_format::Scene;
use lodestream_format::scene::{Instance, MediaType};
use serde_json::{Value, json};
use tokio::runtime::Handle;

use super::ExportError;
use super::material::Materials;
use super::mesh::PlainMesh;
use crate::library::{Library, LibraryError};

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// The image files of the scene's textures, in order.
pub(super) fn images(
    runtime: &Handle,
    library: &Library,
    scene: &Scene,
) -> Result<Vec<Bytes>, LibraryError> {
    let read = |hash| runtime.block_on(library.object(hash));
    scene
        .textures
        .iter()
        .map(|texture| read(&texture.object))
        .collect()
}

/// Writes the whole file.
pub(super) fn write(
    file: &mut impl Write,
    out: &Path,
    scene: &Scene,
    meshes: &[PlainMesh],
    images: &[Bytes],
) -> Result<(), ExportError> {
    let mut document = Document::default();
    let names = scene.assets.iter().map(|asset| asset.name.as_str());
    let mesh_json: Vec<Value> = scene
        .assets
        .iter()
        .zip(meshes)
        .zip(names)
        .map(|((asset, mesh), name)| document.mesh(mesh, name, &asset.materials))
        .collect();
    let image_json: Vec<Value> = scene
        .textures
        .iter()
        .zip(images)
        .map(|(texture, bytes)| {
            let media_type = match texture.media_type {
                MediaType::Png => "image/png",
                MediaType::Jpeg => "image/jpeg",
            };
            json!({ "bufferView": document.view(bytes, None), "mimeType": media_type })
        })
        .collect();
    let origins: Vec<DVec3> = meshes.iter().map(|mesh| mesh.origin().into()).collect();
    let placed = |instance: &Instance| node(instance, origins[instance.asset as usize]);
    let nodes: Vec<Value> = scene.instances.iter().map(placed).collect();
    let materials = Materials::of(scene);
    let mut root = json!({
        "asset": { "version": "2.0", "generator": "lodestream-server export" },
        "scene": 0,
        "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
        "nodes": nodes,
        "meshes": mesh_json,
        "accessors": document.accessors,
        "bufferViews": document.views,
        "buffers": [{ "byteLength": document.bytes.len() }],
    });
    // glTF forbids empty arrays.
    for (key, list) in [
        ("materials", materials.materials),
        ("textures", materials.textures),
        ("samplers", materials.samplers),
        ("images", image_json),
        (
            "extensionsUsed",
            materials.extensions.into_iter().map(Value::from).collect(),
        ),
    ] {
        if !list.is_empty() {
            root[key] = Value::Array(list);
        }
    }
    if scene.instances.is_empty() {
        root["scenes"] = json!([{}]);
        drop_keys(&mut root, &["nodes"]);
    }
    if meshes.is_empty() {
        drop_keys(
            &mut root,
            &["meshes", "accessors", "bufferViews", "buffers"],
        );
    }
    write_chunks(file, out, root.to_string().into_bytes(), document.bytes)
}

fn drop_keys(root: &mut Value, keys: &[&str]) {
    if let Some(object) = root.as_object_mut() {
        object.retain(|key, _| !keys.contains(&key.as_str()));
    }
}

fn write_chunks(
    file: &mut impl Write,
    out: &Path,
    mut json: Vec<u8>,
    bin: Vec<u8>,
) -> Result<(), ExportError> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let bin_bytes = if bin.is_empty() { 0 } else { 8 + bin.len() };
    let total = 12 + 8 + json.len() + bin_bytes;
    let Ok(total) = u32::try_from(total) else {
        return Err(ExportError::TooLarge {
            file: out.to_owned(),
            expected: "at most 4294967295 bytes".to_owned(),
            found: total.to_string(),
        });
    };
    let mut put = || -> io::Result<()> {
        file.write_all(b"glTF")?;
        file.write_all(&2u32.to_le_bytes())?;
        file.write_all(&total.to_le_bytes())?;
        let chunks = [(b"JSON", &json), (b"BIN\0", &bin)];
        for (kind, chunk) in chunks.into_iter().filter(|(_, chunk)| !chunk.is_empty()) {
            file.write_all(&(chunk.len() as u32).to_le_bytes())?;
            file.write_all(kind)?;
            file.write_all(chunk)?;
        }
        Ok(())
    };
    put().map_err(|cause| ExportError::File {
        file: out.to_owned(),
        cause,
    })
}

/// `origin`: what the mesh's positions are relative to.
fn node(instance: &Instance, origin: DVec3) -> Value {
    let rows = instance.world_from_object.map(|[x, y, z, translation]| {
        let moved = DVec3::new(x, y, z).dot(origin) + translation;
        [x, y, z, moved]
    });
    // Column-major, as glTF stores it; 32-bit readers round each number once.
    let matrix: Vec<f64> = (0..4)
        .flat_map(|column| {
            let last = if column == 3 { 1.0 } else { 0.0 };
            [rows[0][column], rows[1][column], rows[2][column], last]
        })
        .collect();
    json!({ "mesh": instance.asset, "matrix": matrix })
}

/// The binary chunk and what describes it.
#[derive(Debug, Default)]
struct Document {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Document {
    /// A buffer view over `bytes`, 4-byte aligned.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn mesh(&mut self, mesh: &PlainMesh, name: &str, materials: &[u32]) -> Value {
        let count = mesh.vertex_count();
        let mut attributes = json!({ "POSITION": self.positions(mesh) });
        if let Some(normals) = mesh.normals() {
            let normals: Vec<[f32; 3]> = normals.collect();
            let view = self.view(bytemuck::cast_slice(&normals), Some(ARRAY_BUFFER));
            attributes["NORMAL"] = json!(self.accessor(json!({
                "bufferView": view, "componentType": FLOAT, "count": count, "type": "VEC3",
            })));
        }
        if let Some(uvs) = mesh.uvs() {
            let uvs: Vec<[f32; 2]> = uvs.collect();
            let view = self.view(bytemuck::cast_slice(&uvs), Some(ARRAY_BUFFER));
            attributes["TEXCOORD_0"] = json!(self.accessor(json!({
                "bufferView": view, "componentType": FLOAT, "count": count, "type": "VEC2",
            })));
        }
        if let Some(colors) = mesh.colors() {
            let colors: Vec<[u8; 4]> = colors.collect();
            let view = self.view(bytemuck::cast_slice(&colors), Some(ARRAY_BUFFER));
            attributes["COLOR_0"] = json!(self.accessor(json!({
                "bufferView": view, "componentType": UNSIGNED_BYTE, "normalized": true,
                "count": count, "type": "VEC4",
            })));
        }
        let used = mesh.slots.iter().enumerate();
        let primitives: Vec<Value> = used
            .filter(|(_, triangles)| !triangles.is_empty())
            .map(|(slot, triangles)| {
                let bytes = bytemuck::cast_slice(triangles);
                let view = self.view(bytes, Some(ELEMENT_ARRAY_BUFFER));
                let indices = self.accessor(json!({
                    "bufferView": view, "componentType": UNSIGNED_INT,
                    "count": 3 * triangles.len(), "type": "SCALAR",
                }));
                let mut primitive = json!({ "attributes": attributes, "indices": indices });
                if let Some(material) = materials.get(slot) {
                    primitive["material"] = json!(material);
                }
                primitive
            })
            .collect();
        json!({ "name": name, "primitives": primitives })
    }

    fn positions(&mut self, mesh: &PlainMesh) -> usize {
        let origin = mesh.origin();
        let relative = |position: [f64; 3]| -> [f32; 3] {
            std::array::from_fn(|axis| (position[axis] - origin[axis]) as f32)
        };
        let positions: Vec<[f32; 3]> = mesh.positions().map(relative).collect();
        let (mut min, mut max) = ([f32::MAX; 3], [f32::MIN; 3]);
        for position in &positions {
            for axis in 0..3 {
                min[axis] = min[axis].min(position[axis]);
                max[axis] = max[axis].max(position[axis]);
            }
        }
        let view = self.view(bytemuck::cast_slice(&positions), Some(ARRAY_BUFFER));
        self.accessor(json!({
            "bufferView": view, "componentType": FLOAT, "count": positions.len(),
            "type": "VEC3", "min": min, "max": max,
        }))
    }
}
