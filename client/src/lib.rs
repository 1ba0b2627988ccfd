//! The thin viewer: streams pages by what culling found missing, and draws any amount of geometry at a fixed memory
//! budget and a fixed pixel error.
//!
//! Everything that names wgpu or winit stands behind the feature `gpu`; the rest drives virtual viewers too.

#[cfg(feature = "gpu")]
pub mod gpu;
