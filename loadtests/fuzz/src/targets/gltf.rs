//! glTF, as text or in its binary container.

use super::imported::import_file;

pub const MOST_BYTES: [usize; 2] = [32 << 20, 4096];

pub fn run(data: &[u8]) {
    import_file("in.gltf", data);
}
