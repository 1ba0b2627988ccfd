//! Server side of Lodestream: glTF to cluster hierarchies, pages, a library of scenes, and HTTP over it.

pub mod build;
pub mod cli;
pub mod confine;
pub mod export;
pub mod http;
pub mod import;
pub mod ingest;
pub mod library;
pub mod verify;
