//! OBJ with the material library beside it.

use super::imported::import_file;
use super::input::folder;

pub const MOST_BYTES: [usize; 2] = [32 << 20, 4096];

/// The mesh; after a zero the library, which it knows as `m.mtl`.
pub fn run(data: &[u8]) {
    let mut files = data.splitn(2, |&byte| byte == 0);
    let mesh = files.next().unwrap_or_default();
    let library = folder("import").join("m.mtl");
    std::fs::write(library, files.next().unwrap_or_default()).expect("writes");
    import_file("in.obj", mesh);
}
