//! Scene manifests (LSS2).

use lodestream_format::Scene;

use super::input::{Input, manifest};

/// bincode makes room for as many as a list says, up to the limit of 1 GiB, before it reads them.
pub const MOST_BYTES: [usize; 2] = [8 << 20, 4096];

/// A byte that says whether the rest is a whole manifest or its plain bytes.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    let message = match input.byte() {
        0 => input.0.to_vec(),
        _ => manifest(b"LSS2", input.0),
    };
    let Ok(scene) = Scene::decode(&message) else {
        return;
    };
    let bytes = scene.encode().expect("what was read can be written");
    let again = Scene::decode(&bytes).expect("what was written can be read");
    // Some numbers may be none, which equal nothing.
    assert_eq!(bytes, again.encode().expect("as before"));
    for instance in &scene.instances {
        assert!((instance.asset as usize) < scene.assets.len());
    }
    for material in scene.assets.iter().flat_map(|it| &it.materials) {
        assert!((*material as usize) < scene.materials.len());
    }
}
