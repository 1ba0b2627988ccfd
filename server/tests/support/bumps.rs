//! glTF files of many small meshes that can be edited one by one: `NAME.gltf` with `NAME.bin` beside it.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

/// A square of `2 * side * side` triangles; another seed gives other heights.
#[derive(Debug, Clone, Copy)]
pub struct Bump {
    pub name: &'static str,
    pub seed: u32,
    pub side: u32,
}

pub const fn bump(name: &'static str, seed: u32, side: u32) -> Bump {
    Bump { name, seed, side }
}

impl Bump {
    pub fn triangles(&self) -> u64 {
        2 * self.side as u64 * self.side as u64
    }
}

/// Writes the files into `folder`; each mesh stands once, the first also has a texture.
pub fn write(folder: &Path, name: &str, meshes: &[Bump]) -> PathBuf {
    let mut bin: Vec<u8> = vec![];
    let (mut views, mut accessors): (Vec<Value>, Vec<Value>) = (vec![], vec![]);
    let mut view = |bytes: &[u8]| {
        views.push(json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() }));
        bin.extend_from_slice(bytes);
        bin.resize(bin.len().next_multiple_of(4), 0);
        views.len() - 1
    };
    let mut png = vec![];
    image::RgbImage::from_fn(4, 4, |x, y| image::Rgb([x as u8 * 60, y as u8 * 60, 9]))
        .write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png)
        .expect("encodes");
    let image = view(&png);
    let mut made = vec![];
    for (index, mesh) in meshes.iter().enumerate() {
        let (positions, triangles) = surface(mesh);
        let position = view(bytemuck::cast_slice(&positions));
        accessors.push(json!({
            "bufferView": position, "componentType": 5126, "count": positions.len(), "type": "VEC3",
            // The same for every seed: only the `.bin` tells seeds apart.
            "min": [0.0, 0.0, 0.0], "max": [mesh.side as f32, mesh.side as f32, 1.0],
        }));
        let indices = view(bytemuck::cast_slice(&triangles));
        accessors.push(json!({
            "bufferView": indices, "componentType": 5125, "count": 3 * triangles.len(), "type": "SCALAR",
        }));
        made.push(json!({ "name": mesh.name, "primitives": [{
            "attributes": { "POSITION": 2 * index }, "indices": 2 * index + 1, "material": index % 2,
        }] }));
    }
    let nodes: Vec<Value> = (0..meshes.len())
        .map(|mesh| json!({ "mesh": mesh, "translation": [100.0 * mesh as f64, 0.0, 0.0] }))
        .collect();
    let document = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": (0..meshes.len()).collect::<Vec<_>>() }],
        "nodes": nodes,
        "meshes": made,
        "materials": [
            { "name": "painted", "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } },
            { "name": "plain" },
        ],
        "textures": [{ "source": 0 }],
        "images": [{ "bufferView": image, "mimeType": "image/png" }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": bin.len(), "uri": format!("{name}.bin") }],
    });
    std::fs::write(folder.join(format!("{name}.bin")), &bin).expect("writes");
    let path = folder.join(format!("{name}.gltf"));
    std::fs::write(&path, document.to_string()).expect("writes");
    path
}

fn surface(mesh: &Bump) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let (side, row) = (mesh.side, mesh.side + 1);
    let height = |x: u32, y: u32| {
        let mixed = (x * 31 + y * 17 + mesh.seed * 101).wrapping_mul(2_654_435_761) >> 24;
        mixed as f32 / 256.0
    };
    let positions = (0..row * row)
        .map(|at| (at % row, at / row))
        .map(|(x, y)| [x as f32, y as f32, height(x, y)]);
    let triangles = (0..side * side).flat_map(|at| {
        let a = at / side * row + at % side;
        [[a, a + 1, a + row], [a + 1, a + row + 1, a + row]]
    });
    (positions.collect(), triangles.collect())
}
