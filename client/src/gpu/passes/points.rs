//! Instances below a pixel to the visbuffer.

use lodestream_shaders::{VisbufferTarget, passes};

use super::Parts;
use crate::gpu::error::GpuError;
use crate::gpu::pipelines::Bound;
use crate::gpu::recorder::{Recorder, workgroups};

/// `raster_points`.
#[derive(Debug)]
pub struct Points {
    raster_points: Bound,
    /// Ids, where the first round writes depths alone.
    second: Option<Bound>,
    instance_count: u32,
}

impl Points {
    /// Binds the pass; none where the scene has a single instance, which is never a point.
    pub fn new(parts: &mut Parts<'_>, instance_count: u32) -> Result<Option<Self>, GpuError> {
        if instance_count < 2 {
            return Ok(None);
        }
        Ok(Some(Self {
            raster_points: parts.bind(&passes::RASTER_POINTS)?,
            second: match parts.pipelines.target() {
                VisbufferTarget::U64 => None,
                VisbufferTarget::TwoRound | VisbufferTarget::Attachment => {
                    Some(parts.bind_second(&passes::RASTER_POINTS)?)
                }
            },
            instance_count,
        }))
    }

    /// A thread an instance: there are at most so many points.
    pub fn record(&self, recorder: &mut Recorder<'_>) {
        self.run(recorder, "raster_points", &self.raster_points);
    }

    /// The second round, where the target has one: after the clusters' depths.
    pub fn record_ids(&self, recorder: &mut Recorder<'_>) {
        if let Some(second) = &self.second {
            self.run(recorder, "raster_points_ids", second);
        }
    }

    fn run(&self, recorder: &mut Recorder<'_>, span: &'static str, pass: &Bound) {
        recorder.compute(span, |dispatches| {
            dispatches.run(pass, workgroups(self.instance_count));
        });
    }
}
