//! Visbuffer to colours.

use lodestream_shaders::passes;

use super::Parts;
use crate::gpu::error::GpuError;
use crate::gpu::pipelines::Bound;
use crate::gpu::recorder::Recorder;

/// `shade`.
#[derive(Debug)]
pub struct Shade {
    shade: Bound,
    workgroups: [u32; 3],
}

impl Shade {
    /// Binds the pass for a picture of the buffers' size.
    pub fn new(parts: &mut Parts<'_>) -> Result<Self, GpuError> {
        let [width, height] = parts.buffers.size_px();
        Ok(Self {
            shade: parts.bind(&passes::SHADE)?,
            workgroups: [width.div_ceil(8), height.div_ceil(8), 1],
        })
    }

    /// A thread a pixel.
    pub fn record(&self, recorder: &mut Recorder<'_>) {
        recorder.compute("shade", |dispatches| {
            dispatches.run(&self.shade, self.workgroups)
        });
    }
}
