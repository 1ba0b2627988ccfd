//! Every byte of Lodestream that crosses disk or network.
//!
//! The data's way through this crate:
//!
//! ```text
//! cluster -> page (disk form -> frame -> pack)            server
//! frame -> disk form -> memory form                       client (the memory form is written by `transcode`)
//! groups -> hierarchy      pages + hierarchy -> asset      assets + instances -> scene      scene -> wire
//! ```
//!
//! `FORMAT.md` beside this crate is the byte-exact specification. This crate knows neither tokio nor wgpu nor axum.

pub mod asset;
pub mod bits;
pub mod bounds;
pub mod cluster;
pub mod cluster_view;
pub mod disk_form;
pub mod error;
pub mod frame;
pub mod grid;
pub mod hash;
pub mod hierarchy;
pub mod instances;
pub mod library;
pub mod limits;
pub mod memory_form;
mod message;
pub mod octahedral;
pub mod page_reader;
pub mod proxy;
mod reader;
pub mod scene;
pub mod strips;
pub mod wire;

pub use asset::Asset;
pub use bounds::{Aabb, Sphere};
pub use cluster::Cluster;
pub use error::FormatError;
pub use hash::ContentHash;
pub use hierarchy::Hierarchy;
pub use scene::Scene;
