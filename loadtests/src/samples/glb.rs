//! A glTF 2.0 binary file, written from meshes, materials, PNG textures and a tree of nodes.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Value, json};

use super::surface::{Model, Surface};

const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Why a sample scene could not be written.
#[derive(Debug, thiserror::Error)]
pub enum SampleError {
    /// The file could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The binary container counts its bytes in 32 bits.
    #[error(
        "the scene takes {bytes} bytes, a .glb at most {}; ask for fewer triangles or instances",
        u32::MAX
    )]
    TooLarge {
        /// The bytes that the scene would take.
        bytes: usize,
    },
}

/// A finished scene: the two chunks of a .glb file, and what it holds.
#[derive(Clone, Debug)]
pub struct Glb {
    json: Vec<u8>,
    binary: Vec<u8>,
    /// Triangles of all meshes, each counted once.
    pub unique_triangles: u64,
    /// Nodes that draw a mesh.
    pub instances: u64,
    /// Triangles of all instances.
    pub instanced_triangles: u64,
}

impl Glb {
    /// The file's bytes.
    ///
    /// # Errors
    /// [`SampleError::TooLarge`] past 4 GiB, where the container ends.
    pub fn to_bytes(&self) -> Result<Vec<u8>, SampleError> {
        let bytes = HEADER_BYTES + 2 * CHUNK_HEADER_BYTES + self.json.len() + self.binary.len();
        let too_large = |_| SampleError::TooLarge { bytes };
        let mut file = Vec::with_capacity(bytes);
        file.extend_from_slice(b"glTF");
        file.extend_from_slice(&2u32.to_le_bytes());
        file.extend_from_slice(&u32::try_from(bytes).map_err(too_large)?.to_le_bytes());
        for (kind, chunk) in [(b"JSON", &self.json), (b"BIN\0", &self.binary)] {
            file.extend_from_slice(&u32::try_from(chunk.len()).map_err(too_large)?.to_le_bytes());
            file.extend_from_slice(kind);
            file.extend_from_slice(chunk);
        }
        Ok(file)
    }

    /// Writes the file.
    ///
    /// # Errors
    /// [`SampleError::Write`] with the path, or [`SampleError::TooLarge`].
    pub fn write(&self, path: &Path) -> Result<(), SampleError> {
        std::fs::write(path, self.to_bytes()?).map_err(|source| SampleError::Write {
            path: path.to_owned(),
            source,
        })
    }
}

/// A material: linear base colour, times the texture where there is one, times the vertex colour.
pub(super) struct Material {
    pub(super) name: &'static str,
    pub(super) base_colour: [f64; 3],
    pub(super) roughness: f64,
    pub(super) metallic: f64,
    /// Index of a texture of [`Scene::textures`].
    pub(super) texture: Option<usize>,
    pub(super) double_sided: bool,
}

/// A node: a group (`children`) or an instance (`mesh`).
#[derive(Debug, Default, Serialize)]
pub(super) struct Node {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) name: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) mesh: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) translation: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) rotation: Option<[f64; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) scale: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) children: Vec<usize>,
}

/// Everything a file is made of. Node 0 is the root.
pub(super) struct Scene {
    pub(super) title: String,
    pub(super) materials: Vec<Material>,
    /// PNG files with their names.
    pub(super) textures: Vec<(&'static str, Vec<u8>)>,
    pub(super) models: Vec<Model>,
    pub(super) nodes: Vec<Node>,
}

impl Scene {
    pub(super) fn finish(self) -> Glb {
        let mut chunk = Chunk::default();
        let meshes: Vec<Value> = self.models.iter().map(|model| chunk.mesh(model)).collect();
        let images: Vec<Value> = self
            .textures
            .iter()
            .map(|(name, png)| {
                json!({"name": name, "mimeType": "image/png", "bufferView": chunk.view(png, None)})
            })
            .collect();
        let mut document = json!({
            "asset": {"version": "2.0", "generator": "lodestream-loadtests sample", "copyright": "CC0 1.0",
                      "extras": {"title": self.title}},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": self.nodes,
            "meshes": meshes,
            "materials": self.materials.iter().map(material).collect::<Vec<_>>(),
            "accessors": chunk.accessors,
            "bufferViews": chunk.views,
            "buffers": [{"byteLength": chunk.bytes.len()}],
        });
        if !images.is_empty() {
            let textures = (0..images.len()).map(|source| json!({"source": source, "sampler": 0}));
            document["textures"] = textures.collect();
            document["images"] = images.into();
            document["samplers"] =
                json!([{"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}]);
        }
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let triangles: Vec<u64> = self.models.iter().map(Model::triangles).collect();
        let drawn = self.nodes.iter().filter_map(|node| node.mesh);
        Glb {
            json: text,
            binary: chunk.bytes,
            unique_triangles: triangles.iter().sum(),
            instances: drawn.clone().count() as u64,
            instanced_triangles: drawn.map(|mesh| triangles[mesh]).sum(),
        }
    }
}

fn material(material: &Material) -> Value {
    let [red, green, blue] = material.base_colour;
    let mut value = json!({
        "name": material.name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [red, green, blue, 1.0],
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        },
    });
    if let Some(texture) = material.texture {
        value["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": texture});
    }
    if material.double_sided {
        value["doubleSided"] = json!(true);
    }
    value
}

/// The binary chunk in the making.
#[derive(Default)]
struct Chunk {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Chunk {
    fn mesh(&mut self, model: &Model) -> Value {
        let primitives: Vec<Value> = model
            .parts
            .iter()
            .filter(|(_, surface)| !surface.indices.is_empty())
            .map(|(material, surface)| self.primitive(model, *material, surface))
            .collect();
        json!({"name": model.name, "primitives": primitives})
    }

    fn primitive(&mut self, model: &Model, material: usize, surface: &Surface) -> Value {
        let floats =
            |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
        let count = surface.positions.len();
        let position = self.accessor(
            &floats(surface.positions.as_flattened()),
            ARRAY_BUFFER,
            5126,
            "VEC3",
            count,
        );
        let (low, high) = surface.bounds();
        self.accessors[position]["min"] = json!(low);
        self.accessors[position]["max"] = json!(high);
        let normal = self.accessor(
            &floats(surface.normals.as_flattened()),
            ARRAY_BUFFER,
            5126,
            "VEC3",
            count,
        );
        let mut attributes = json!({"POSITION": position, "NORMAL": normal});
        if model.has_uv {
            let bytes = floats(surface.uvs.as_flattened());
            attributes["TEXCOORD_0"] = self
                .accessor(&bytes, ARRAY_BUFFER, 5126, "VEC2", count)
                .into();
        }
        if model.has_colour {
            let bytes = surface.colours.as_flattened();
            let colour = self.accessor(bytes, ARRAY_BUFFER, 5121, "VEC4", count);
            self.accessors[colour]["normalized"] = json!(true);
            attributes["COLOR_0"] = colour.into();
        }
        // Index 65535 is kept free: it would restart a primitive.
        let (bytes, kind): (Vec<u8>, u32) = if count < 65536 {
            (
                surface
                    .indices
                    .iter()
                    .flat_map(|&i| (i as u16).to_le_bytes())
                    .collect(),
                5123,
            )
        } else {
            (
                surface
                    .indices
                    .iter()
                    .flat_map(|i| i.to_le_bytes())
                    .collect(),
                5125,
            )
        };
        let indices = self.accessor(
            &bytes,
            ELEMENT_ARRAY_BUFFER,
            kind,
            "SCALAR",
            surface.indices.len(),
        );
        json!({"attributes": attributes, "indices": indices, "material": material})
    }

    fn accessor(
        &mut self,
        bytes: &[u8],
        target: u32,
        component: u32,
        kind: &str,
        count: usize,
    ) -> usize {
        let view = self.view(bytes, Some(target));
        self.accessors.push(
            json!({"bufferView": view, "componentType": component, "type": kind, "count": count}),
        );
        self.accessors.len() - 1
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let mut view =
            json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bytes.extend_from_slice(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(view);
        self.views.len() - 1
    }
}
