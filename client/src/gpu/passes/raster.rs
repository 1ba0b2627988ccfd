//! Visible clusters to the visbuffer: small ones by the compute rasterizer, the others by the
//! hardware. The pass that looks materials up runs only where one can hide a fragment.

use std::mem::offset_of;

use lodestream_shaders::cpu::needs_masked;
use lodestream_shaders::types::IndirectArgs;
use lodestream_shaders::{SceneArrays, VisbufferTarget, passes};

use super::{Attachments, Parts};
use crate::gpu::error::GpuError;
use crate::gpu::pipelines::Bound;
use crate::gpu::recorder::Recorder;

/// Spans of a round: the compute rasterizer's and the hardware's.
type Spans = [&'static str; 2];

/// The draw of the visbuffer, and the fragment counts where the overdraw picture asks for them.
#[derive(Debug)]
pub struct Raster {
    first: Round,
    /// Ids, where the first round writes depths alone.
    second: Option<Round>,
    raster_overdraw: Option<Bound>,
    attachments: Attachments,
    args: wgpu::Buffer,
}

#[derive(Debug)]
struct Round {
    raster: Bound,
    raster_compute: Option<Bound>,
}

impl Raster {
    /// Binds the passes. `by_compute` adds the compute rasterizer.
    pub fn new(
        parts: &mut Parts<'_>,
        arrays: &SceneArrays,
        overdraw: bool,
        by_compute: bool,
    ) -> Result<Self, GpuError> {
        let pass = match needs_masked(&arrays.materials) {
            true => &passes::RASTER_MASKED,
            false => &passes::RASTER,
        };
        let first = Round {
            raster: parts.bind(pass)?,
            raster_compute: match by_compute {
                true => Some(parts.bind(&passes::RASTER_COMPUTE)?),
                false => None,
            },
        };
        let second = match parts.pipelines.target() {
            VisbufferTarget::TwoRound => Some(Round {
                raster: parts.bind_second(pass)?,
                raster_compute: match by_compute {
                    true => Some(parts.bind_second(&passes::RASTER_COMPUTE)?),
                    false => None,
                },
            }),
            VisbufferTarget::U64 | VisbufferTarget::Attachment => None,
        };
        Ok(Self {
            first,
            second,
            raster_overdraw: match overdraw {
                true => Some(parts.bind(&passes::RASTER_OVERDRAW)?),
                false => None,
            },
            attachments: Attachments::new(parts)?,
            args: parts.buffers.get("args").clone(),
        })
    }

    /// Whether fragments are counted, in the colours.
    pub fn counts_fragments(&self) -> bool {
        self.raster_overdraw.is_some()
    }

    /// Draws the clusters of the early pass.
    pub fn record(&self, recorder: &mut Recorder<'_>) {
        let raster = self.first.raster.name();
        self.record_round(recorder, &self.first, ["raster_compute", raster]);
        if let Some(second) = &self.second {
            self.record_round(recorder, second, ["raster_compute_ids", "raster_ids"]);
        }
        self.record_rest(recorder, "resolve");
    }

    /// Draws the clusters of the late pass.
    pub fn record_late(&self, recorder: &mut Recorder<'_>) {
        let spans = ["late_raster_compute", "late_raster"];
        self.record_round(recorder, &self.first, spans);
        if let Some(second) = &self.second {
            let spans = ["late_raster_compute_ids", "late_raster_ids"];
            self.record_round(recorder, second, spans);
        }
        self.record_rest(recorder, "late_resolve");
    }

    fn record_round(&self, recorder: &mut Recorder<'_>, round: &Round, spans: Spans) {
        if let Some(pass) = &round.raster_compute {
            recorder.compute(spans[0], |dispatches| {
                let offset = offset_of!(IndirectArgs, compute);
                dispatches.run_indirect(pass, &self.args, offset);
            });
        }
        let depths = self.attachments.depths();
        self.draw(recorder, &round.raster, spans[1], depths);
    }

    fn record_rest(&self, recorder: &mut Recorder<'_>, span: &'static str) {
        self.attachments.record(recorder, span);
        if let Some(pass) = &self.raster_overdraw {
            self.draw(recorder, pass, pass.name(), None);
        }
    }

    fn draw(
        &self,
        recorder: &mut Recorder<'_>,
        pass: &Bound,
        span: &'static str,
        depths: Option<&wgpu::TextureView>,
    ) {
        let offset = offset_of!(IndirectArgs, raster);
        recorder.draw_indirect(
            span,
            pass,
            &self.attachments.ids,
            depths,
            &self.args,
            offset,
        );
    }
}
