//! The frame: which passes, in which order.

use lodestream_shaders::SceneArrays;

use super::buffers::Buffers;
use super::error::GpuError;
use super::occlusion::Steps;
use super::passes::{BuildHzb, Cull, Parts, Points, Raster, Requests, Shade};
use super::recorder::Recorder;

/// How much of a frame is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Work {
    /// Streaming requests alone: what a viewer that nobody watches needs while pages come.
    Requests,
    /// The visbuffer too: its depths decide about occlusion.
    Visbuffer,
    /// The picture too.
    Picture,
}

impl Work {
    /// Whether the visbuffer is drawn.
    pub fn draws(self) -> bool {
        self != Self::Requests
    }
}

/// The passes of a frame, bound.
#[derive(Debug)]
pub struct Passes {
    cull: Cull,
    requests: Requests,
    picture: Option<Picture>,
    build_hzb: Option<BuildHzb>,
}

#[derive(Debug)]
struct Picture {
    points: Option<Points>,
    raster: Raster,
    shade: Shade,
}

impl Passes {
    /// Binds the passes of frames that draw, or of those that do not, building pipelines on the
    /// way.
    pub fn new(
        parts: &mut Parts<'_>,
        arrays: &SceneArrays,
        instance_count: u32,
        draws: bool,
        overdraw: bool,
        by_compute: bool,
    ) -> Result<Self, GpuError> {
        let picture = match draws {
            true => Some(Picture {
                points: Points::new(parts, instance_count)?,
                raster: Raster::new(parts, arrays, overdraw, by_compute)?,
                shade: Shade::new(parts)?,
            }),
            false => None,
        };
        Ok(Self {
            cull: Cull::new(parts, arrays, instance_count, draws)?,
            requests: Requests::new(parts, arrays.page_count)?,
            picture,
            build_hzb: None,
        })
    }

    /// Binds the missing passes of `steps`.
    pub fn add(&mut self, parts: &mut Parts<'_>, steps: Steps) -> Result<(), GpuError> {
        if steps.builds && self.build_hzb.is_none() {
            self.build_hzb = Some(BuildHzb::new(parts)?);
        }
        if steps.builds && steps.tests {
            self.cull.add_late(parts)?;
        }
        Ok(())
    }

    /// Draws the clusters that `visible` has already, without any culling.
    pub fn record_picture(&self, recorder: &mut Recorder<'_>) {
        if let Some(picture) = &self.picture {
            picture.raster.record(recorder);
        }
    }

    /// Draws the instances below a pixel, and the clusters of the early pass.
    fn record_early(&self, recorder: &mut Recorder<'_>) {
        let Some(picture) = &self.picture else { return };
        if let Some(points) = &picture.points {
            points.record(recorder);
        }
        picture.raster.record(recorder);
        if let Some(points) = &picture.points {
            points.record_ids(recorder);
        }
    }

    /// Clears the visbuffer, and the colours where the overdraw picture counts in them.
    pub fn clear_picture(&self, encoder: &mut wgpu::CommandEncoder, buffers: &Buffers) {
        encoder.clear_buffer(buffers.get("visbuffer"), 0, None);
        if self.picture.iter().any(|it| it.raster.counts_fragments()) {
            encoder.clear_buffer(buffers.get("color"), 0, None);
        }
    }

    /// Colours of what lies in the visbuffer already.
    pub fn record_shade(&self, recorder: &mut Recorder<'_>) {
        if let Some(picture) = &self.picture {
            picture.shade.record(recorder);
        }
    }

    /// Depths of the early pass to the pyramid, then the rejects once more against them.
    fn record_occlusion(&self, recorder: &mut Recorder<'_>, steps: Steps) {
        if let Some(build_hzb) = &self.build_hzb
            && steps.builds
        {
            build_hzb.record(recorder);
        }
        if let Some(picture) = &self.picture
            && steps.builds
            && steps.tests
        {
            self.cull.record_late(recorder);
            picture.raster.record_late(recorder);
        }
    }
}

/// Records one frame. Pages were transcoded and the page table patched before it, on the same queue.
///
/// Instances, nodes and clusters are tested against the depths of the last frame ("early") and
/// drawn. The rejects are tested once more against the depths of those ("late") and drawn. The
/// compute rasterizer and the hardware write the visbuffer by the same atomic maximum.
pub fn record(
    recorder: &mut Recorder<'_>,
    passes: &Passes,
    buffers: &Buffers,
    work: Work,
    steps: Steps,
) {
    for name in ["counters", "page_priority"] {
        recorder.encoder.clear_buffer(buffers.get(name), 0, None);
    }
    // Requests are written while nodes are visited: for what is installed and for what is not.
    passes.cull.record_nodes(recorder);
    if work.draws() {
        passes.clear_picture(&mut recorder.encoder, buffers);
        passes.cull.record_clusters(recorder);
        passes.record_early(recorder);
        passes.record_occlusion(recorder, steps);
    }
    if work == Work::Picture {
        passes.record_shade(recorder);
    }
    passes.requests.record(recorder);
}
