//! The frame: which passes, in which order.

use lodestream_shaders::SceneArrays;

use super::buffers::Buffers;
use super::error::GpuError;
use super::passes::{Cull, Parts, Raster, Requests, Shade};
use super::recorder::Recorder;

/// How much of a frame is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Work {
    /// Streaming requests alone: what a viewer that nobody watches needs while pages come.
    Requests,
    /// The picture too.
    Picture,
}

/// The passes of a frame, bound.
#[derive(Debug)]
pub struct Passes {
    cull: Cull,
    requests: Requests,
    picture: Option<(Raster, Shade)>,
}

impl Passes {
    /// Binds what `work` needs, building pipelines on the way.
    pub fn new(
        parts: &mut Parts<'_>,
        arrays: &SceneArrays,
        work: Work,
        overdraw: bool,
    ) -> Result<Self, GpuError> {
        let draws = work == Work::Picture;
        let picture = match draws {
            true => Some((Raster::new(parts, arrays, overdraw)?, Shade::new(parts)?)),
            false => None,
        };
        Ok(Self {
            cull: Cull::new(parts, arrays, draws)?,
            requests: Requests::new(parts, arrays.page_count)?,
            picture,
        })
    }

    /// Visbuffer and picture of what lies in `visible` already, without any culling.
    pub fn record_picture(&self, recorder: &mut Recorder<'_>) {
        if let Some((raster, _)) = &self.picture {
            raster.record(recorder);
        }
    }

    /// Clears the visbuffer, and the colours where the overdraw picture counts in them.
    pub fn clear_picture(&self, encoder: &mut wgpu::CommandEncoder, buffers: &Buffers) {
        encoder.clear_buffer(buffers.get("visbuffer"), 0, None);
        if self
            .picture
            .iter()
            .any(|(raster, _)| raster.counts_fragments())
        {
            encoder.clear_buffer(buffers.get("color"), 0, None);
        }
    }

    /// Colours of what lies in the visbuffer already.
    pub fn record_shade(&self, recorder: &mut Recorder<'_>) {
        if let Some((_, shade)) = &self.picture {
            shade.record(recorder);
        }
    }
}

/// Records one frame. Pages were transcoded and the page table patched before it, on the same queue.
///
/// Occlusion culling has its place here: nodes and clusters against last frame's HZB first ("early"), then raster, then the
/// HZB of this visbuffer, then what the early pass rejected once more against it ("late"), then raster again. Small
/// triangles go to a compute rasterizer beside the hardware one, split by `cull_clusters`; both write the visbuffer by the
/// same atomic maximum, so neither has to know of the other.
pub fn record(recorder: &mut Recorder<'_>, passes: &Passes, buffers: &Buffers, work: Work) {
    for name in ["counters", "page_priority"] {
        recorder.encoder.clear_buffer(buffers.get(name), 0, None);
    }
    // Requests are written while nodes are visited: for what is installed and for what is not.
    passes.cull.record_nodes(recorder);
    if work == Work::Picture {
        passes.clear_picture(&mut recorder.encoder, buffers);
        passes.cull.record_clusters(recorder);
        passes.record_picture(recorder);
        passes.record_shade(recorder);
    }
    passes.requests.record(recorder);
}
