//! The passes on the GPU. Everything that names wgpu is here and in the window.
//!
//! ```text
//! device -> pool, buffers -> pipelines (from shaders::passes) -> passes -> frame -> readback
//! ```
//!
//! `renderer` holds one scene and its frames; `snapshot` reads whole buffers back for pictures, cuts and tests.

mod bindings;
mod buffers;
mod device;
mod error;
mod frame;
mod instances;
mod items;
mod occlusion;
mod passes;
mod pipelines;
mod pool;
mod readback;
mod recorder;
mod renderer;
mod snapshot;
mod target;
mod textures;
mod timestamps;

pub use buffers::{Buffers, Capacities};
pub use device::{Gpu, WIDE_ATOMICS, instance};
pub use error::GpuError;
pub use frame::Work;
pub use passes::PageUpload;
pub use pipelines::Pipelines;
pub use pool::{MAX_POOL_BINDINGS, Pool, cut, max_bytes};
pub use readback::FrameResult;
pub use recorder::Recorder;
pub use renderer::Renderer;
pub use snapshot::read_buffer;
pub use textures::TextureUpload;
