//! The WGSL of Lodestream, the structs that cross the bus, and a CPU twin of every pass.
//!
//! A frame, in order (`passes.rs` holds the table):
//!
//! ```text
//! transcode -> cull_instances -> (prepare_nodes -> cull_nodes) x depth -> prepare_clusters -> cull_clusters
//!           -> prepare_raster -> raster -> build_hzb -> build_hzb_top
//!           -> prepare_rejected -> cull_rejected -> (the same from prepare_nodes to raster)
//!           -> shade -> compact_requests
//! ```
//!
//! `wgsl/NAME.wgsl` is the pass, `src/cpu/NAME.rs` its twin; `wgsl/shared/` is what passes share. A pass is believed when
//! its twin agrees: exactly for integers, within a bound for shading. This crate does not know wgpu.

pub mod arrays;
mod assembly;
pub mod cpu;
pub mod passes;
pub mod proxies;
pub mod scene_rows;
mod target;
pub mod types;

pub use arrays::SceneArrays;
pub use scene_rows::SceneRows;
pub use target::VisbufferTarget;
