//! The thin viewer: streams pages by what culling found missing, and draws any amount of geometry at a fixed memory
//! budget and a fixed pixel error.
//!
//! Everything that names wgpu or winit stands behind the feature `gpu`; the rest drives virtual viewers too.

pub mod camera;
pub mod path;
pub mod stream;
pub mod subject;

#[cfg(feature = "gpu")]
pub mod cut_file;
#[cfg(feature = "gpu")]
pub mod error;
#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(feature = "gpu")]
pub mod images;
#[cfg(feature = "gpu")]
pub mod opening;
#[cfg(feature = "gpu")]
pub mod picture;
#[cfg(feature = "gpu")]
pub mod play;
#[cfg(feature = "gpu")]
pub mod reference;
#[cfg(feature = "gpu")]
pub mod render;
#[cfg(feature = "gpu")]
pub mod report;
#[cfg(feature = "gpu")]
pub mod session;
pub mod trace;
#[cfg(feature = "gpu")]
pub mod view;
