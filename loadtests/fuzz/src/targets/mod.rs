//! What is fuzzed: each target takes any bytes and fails on nothing but a broken promise.

pub mod asset;
pub mod blocks;
pub mod client_answer;
pub mod client_files;
pub mod connection;
pub mod disk_form;
pub mod frame;
pub mod gltf;
pub mod hierarchy;
mod imported;
pub mod input;
pub mod memory_form;
pub mod mesh_build;
pub mod meshopt;
pub mod obj;
pub mod opened_scene;
pub mod ply;
pub mod post;
pub mod records;
pub mod request;
pub mod scene;
pub mod served;
pub mod stl;
pub mod tokens;

/// A target's name and function.
pub type Target = (&'static str, fn(&[u8]));

/// All of them, by their folders in the corpus.
pub const TARGETS: [Target; 21] = [
    ("asset", asset::run),
    ("blocks", blocks::run),
    ("client_answer", client_answer::run),
    ("client_files", client_files::run),
    ("connection", connection::run),
    ("disk_form", disk_form::run),
    ("frame", frame::run),
    ("gltf", gltf::run),
    ("hierarchy", hierarchy::run),
    ("memory_form", memory_form::run),
    ("mesh_build", mesh_build::run),
    ("meshopt", meshopt::run),
    ("obj", obj::run),
    ("opened_scene", opened_scene::run),
    ("ply", ply::run),
    ("post", post::run),
    ("records", records::run),
    ("request", request::run),
    ("scene", scene::run),
    ("stl", stl::run),
    ("tokens", tokens::run),
];
