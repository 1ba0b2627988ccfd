//! Views under `EXT_meshopt_compression`, in a document that is right but for them.

use serde_json::json;

use super::imported::import_file;
use super::input::Input;

pub const MOST_BYTES: [usize; 2] = [64 << 20, 4096];

/// Vertices that indices may name.
const VERTICES: usize = 64;

/// Mode, filter, stride, count, then the compressed bytes.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    let (mode, filter, stride) = (input.byte() % 3, input.byte(), input.byte());
    let count = u32::from(input.short());
    let mode = ["ATTRIBUTES", "TRIANGLES", "INDICES"][usize::from(mode)];
    let filters = ["NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR"];
    let filter = filters[usize::from(filter) % filters.len()];
    let compressed = input.0;
    let is_index = mode != "ATTRIBUTES";
    let component = match (is_index, stride) {
        (true, 2) => 5123,
        (true, _) => 5125,
        (false, 4) => 5121,
        (false, 8) => 5122,
        (false, _) => 5126,
    };
    let own = json!({
        "bufferView": 0, "componentType": component, "count": count, "normalized": !is_index && stride < 12,
        "type": if is_index { "SCALAR" } else { "VEC3" },
    });
    let plain =
        json!({ "bufferView": 1, "componentType": 5126, "count": VERTICES, "type": "VEC3" });
    let primitive = match (is_index, stride) {
        (true, _) => json!({ "attributes": { "POSITION": 1 }, "indices": 0 }),
        (false, 4 | 8) => json!({ "attributes": { "POSITION": 1, "NORMAL": 0, "COLOR_0": 0 } }),
        (false, _) => json!({ "attributes": { "POSITION": 0 } }),
    };
    let positions: Vec<u8> = (0..3 * VERTICES as u32)
        .flat_map(|it| (it.wrapping_mul(0x9e37_79b9) as f32).to_le_bytes())
        .collect();
    let document = json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["EXT_meshopt_compression", "KHR_mesh_quantization"],
        "extensionsRequired": ["EXT_meshopt_compression", "KHR_mesh_quantization"],
        "buffers": [{ "byteLength": positions.len() + compressed.len() }],
        "bufferViews": [
            {
                "buffer": 0, "byteLength": count * u32::from(stride), "byteStride": (!is_index).then_some(stride),
                "extensions": { "EXT_meshopt_compression": {
                    "buffer": 0, "byteOffset": positions.len(), "byteLength": compressed.len(), "byteStride": stride,
                    "count": count, "mode": mode, "filter": filter,
                } },
            },
            { "buffer": 0, "byteLength": positions.len() },
        ],
        "accessors": [own, plain],
        "meshes": [{ "primitives": [primitive] }],
        "nodes": [{ "mesh": 0 }],
    });
    import_file(
        "in.glb",
        &glb(&document, &[&positions, compressed].concat()),
    );
}

/// A binary container.
pub fn glb(document: &serde_json::Value, bin: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + bin.len();
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((total as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json[..]), (b"BIN\0", bin)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}
