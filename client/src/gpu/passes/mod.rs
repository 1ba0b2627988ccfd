//! The passes in frame order, a file a family: which pipelines a frame needs, with which buffers, over how many threads.

mod cull;
mod hzb;
mod points;
mod present;
mod raster;
mod requests;
mod resolve;
mod shade;
mod transcode;

pub use cull::Cull;
pub use hzb::BuildHzb;
pub use points::Points;
pub use present::Present;
pub use raster::Raster;
pub use requests::Requests;
pub use resolve::Attachments;
pub use shade::Shade;
pub use transcode::{PageUpload, Transcode};

use super::buffers::Buffers;
use super::device::Gpu;
use super::error::GpuError;
use super::pipelines::Pipelines;

/// What passes are built from.
#[derive(Debug)]
pub struct Parts<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// Pipelines built so far.
    pub pipelines: &'a mut Pipelines,
    /// All buffers but the pool's.
    pub buffers: &'a Buffers,
    /// The pool's buffers.
    pub pool: &'a [wgpu::Buffer],
}

impl Parts<'_> {
    fn bind(
        &mut self,
        pass: &lodestream_shaders::passes::Pass,
    ) -> Result<super::pipelines::Bound, GpuError> {
        self.pipelines.bind(pass, &self.buffers.named(self.pool))
    }

    fn bind_second(
        &mut self,
        pass: &lodestream_shaders::passes::Pass,
    ) -> Result<super::pipelines::Bound, GpuError> {
        self.pipelines
            .bind(pass, &self.buffers.named_second(self.pool))
    }

    fn bind_late(
        &mut self,
        pass: &lodestream_shaders::passes::Pass,
    ) -> Result<super::pipelines::Bound, GpuError> {
        self.pipelines
            .bind(pass, &self.buffers.named_late(self.pool))
    }
}
