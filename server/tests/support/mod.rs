//! What the tests of this crate share: a small glTF file, made libraries, a running server.
// Each test binary uses its own part of this.
#![allow(dead_code)]

pub mod binary;
pub mod gltf;
pub mod made;
pub mod server;

/// A runtime of two threads for what is not async.
pub fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .expect("a runtime")
}
