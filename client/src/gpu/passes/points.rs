//! Instances below a pixel to the visbuffer.

use lodestream_shaders::passes;

use super::Parts;
use crate::gpu::error::GpuError;
use crate::gpu::pipelines::Bound;
use crate::gpu::recorder::{Recorder, workgroups};

/// `raster_points`.
#[derive(Debug)]
pub struct Points {
    raster_points: Bound,
    instance_count: u32,
}

impl Points {
    /// Binds the pass; none where the scene has a single instance, which is never a point.
    pub fn new(parts: &mut Parts<'_>, instance_count: u32) -> Result<Option<Self>, GpuError> {
        if instance_count < 2 {
            return Ok(None);
        }
        let raster_points = parts.bind(&passes::RASTER_POINTS)?;
        Ok(Some(Self {
            raster_points,
            instance_count,
        }))
    }

    /// A thread an instance: there are at most so many points.
    pub fn record(&self, recorder: &mut Recorder<'_>) {
        recorder.compute("raster_points", |dispatches| {
            dispatches.run(&self.raster_points, workgroups(self.instance_count));
        });
    }
}
