//! The visbuffer's depths to the pyramid that occlusion tests read.

use lodestream_shaders::cpu::hzb::hzb_top;
use lodestream_shaders::passes;

use super::Parts;
use crate::gpu::error::GpuError;
use crate::gpu::pipelines::Bound;
use crate::gpu::recorder::Recorder;

/// Pixels a side that a workgroup of `build_hzb` takes.
const TILE_PX: u32 = 64;

/// `build_hzb`, and `build_hzb_top` where one tile is not the whole picture.
#[derive(Debug)]
pub struct BuildHzb {
    build_hzb: Bound,
    build_hzb_top: Option<Bound>,
    workgroups: [u32; 3],
}

impl BuildHzb {
    /// Binds the passes for a picture of the buffers' size.
    pub fn new(parts: &mut Parts<'_>) -> Result<Self, GpuError> {
        let size_px = parts.buffers.size_px();
        let [width, height] = size_px.map(|size| size.div_ceil(TILE_PX));
        let has_top = hzb_top(size_px) > TILE_PX.ilog2();
        Ok(Self {
            build_hzb: parts.bind(&passes::BUILD_HZB)?,
            build_hzb_top: match has_top {
                true => Some(parts.bind(&passes::BUILD_HZB_TOP)?),
                false => None,
            },
            workgroups: [width, height, 1],
        })
    }

    /// Builds all levels.
    pub fn record(&self, recorder: &mut Recorder<'_>) {
        recorder.compute("build_hzb", |dispatches| {
            dispatches.run(&self.build_hzb, self.workgroups);
            if let Some(top) = &self.build_hzb_top {
                dispatches.run(top, [1, 1, 1]);
            }
        });
    }
}
