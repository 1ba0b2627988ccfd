//! Colours to the window's surface.

use lodestream_shaders::passes;

use super::Parts;
use crate::gpu::error::GpuError;
use crate::gpu::pipelines::Bound;
use crate::gpu::recorder::Recorder;

/// `present`.
#[derive(Debug)]
pub struct Present {
    present: Bound,
}

impl Present {
    /// Binds the pass for a surface of `format`.
    pub fn new(parts: &mut Parts<'_>, format: wgpu::TextureFormat) -> Result<Self, GpuError> {
        let named = parts.buffers.named(parts.pool);
        let present = parts
            .pipelines
            .bind_to(&passes::PRESENT, Some(format), &named)?;
        Ok(Self { present })
    }

    /// Covers `target`.
    pub fn record(&self, recorder: &mut Recorder<'_>, target: &wgpu::TextureView) {
        recorder.cover(&self.present, target);
    }
}
