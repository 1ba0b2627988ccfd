//! Visible clusters to the visbuffer: small ones by the compute rasterizer, the others by the
//! hardware. The pass that looks materials up runs only where one can hide a fragment.

use std::mem::offset_of;

use lodestream_shaders::SceneArrays;
use lodestream_shaders::cpu::needs_masked;
use lodestream_shaders::passes;
use lodestream_shaders::types::IndirectArgs;

use super::Parts;
use crate::gpu::error::GpuError;
use crate::gpu::pipelines::{Bound, NO_COLOR_FORMAT};
use crate::gpu::recorder::Recorder;

/// The draw of the visbuffer, and the fragment counts where the overdraw picture asks for them.
#[derive(Debug)]
pub struct Raster {
    raster: Bound,
    raster_compute: Option<Bound>,
    raster_overdraw: Option<Bound>,
    unwritten: wgpu::TextureView,
    args: wgpu::Buffer,
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
        let [width, height] = parts.buffers.size_px();
        let largest = parts.gpu.limits.max_texture_dimension_2d;
        if width > largest || height > largest {
            return Err(GpuError::Limit {
                adapter: parts.gpu.name.clone(),
                expected: format!("a picture of {width}x{height} pixels"),
                found: format!("at most {largest} pixels an axis"),
            });
        }
        let texture = parts.gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("unwritten"),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: NO_COLOR_FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        Ok(Self {
            raster: parts.bind(pass)?,
            raster_compute: match by_compute {
                true => Some(parts.bind(&passes::RASTER_COMPUTE)?),
                false => None,
            },
            raster_overdraw: match overdraw {
                true => Some(parts.bind(&passes::RASTER_OVERDRAW)?),
                false => None,
            },
            unwritten: texture.create_view(&Default::default()),
            args: parts.buffers.get("args").clone(),
        })
    }

    /// Whether fragments are counted, in the colours.
    pub fn counts_fragments(&self) -> bool {
        self.raster_overdraw.is_some()
    }

    /// Draws the clusters of the early pass.
    pub fn record(&self, recorder: &mut Recorder<'_>) {
        self.record_as(recorder, self.raster.name(), "raster_compute");
    }

    /// Draws the clusters of the late pass.
    pub fn record_late(&self, recorder: &mut Recorder<'_>) {
        self.record_as(recorder, "late_raster", "late_raster_compute");
    }

    fn record_as(&self, recorder: &mut Recorder<'_>, span: &'static str, compute: &'static str) {
        if let Some(pass) = &self.raster_compute {
            recorder.compute(compute, |dispatches| {
                let offset = offset_of!(IndirectArgs, compute);
                dispatches.run_indirect(pass, &self.args, offset);
            });
        }
        let offset = offset_of!(IndirectArgs, raster);
        recorder.draw_indirect(span, &self.raster, &self.unwritten, &self.args, offset);
        if let Some(pass) = &self.raster_overdraw {
            recorder.draw_indirect(pass.name(), pass, &self.unwritten, &self.args, offset);
        }
    }
}
