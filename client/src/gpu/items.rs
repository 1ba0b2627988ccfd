//! Clusters that a caller chose, into the visbuffer and into colours: for references, whose cut does
//! not fit one frame, and for tests.

use lodestream_shaders::cpu::prepare::RASTER_VERTICES;
use lodestream_shaders::types::{ClusterItem, IndirectArgs, View};

use super::error::GpuError;
use super::frame::{Passes, Work};
use super::recorder::Recorder;
use super::renderer::Renderer;

impl Renderer {
    /// Clears the visbuffer, and the fragment counts in overdraw mode.
    pub fn clear_visbuffer(&mut self) -> Result<(), GpuError> {
        self.bind(Work::Picture)?;
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        if let Some(passes) = &self.passes[usize::from(Work::Picture.draws())] {
            passes.clear_picture(&mut encoder, &self.buffers);
        }
        self.gpu.queue.submit([encoder.finish()]);
        Ok(())
    }

    /// Rasterizes `items` into the visbuffer as it is: no culling, no level of detail.
    pub fn raster_items(&mut self, view: &View, items: &[ClusterItem]) -> Result<(), GpuError> {
        self.bind(Work::Picture)?;
        self.write_view(view);
        let args = IndirectArgs {
            raster: [RASTER_VERTICES, items.len() as u32, 0, 0],
            ..IndirectArgs::default()
        };
        let queue = &self.gpu.queue;
        queue.write_buffer(self.buffers.get("args"), 0, bytemuck::bytes_of(&args));
        let visible = self.buffers.visible_offset();
        let bytes = bytemuck::cast_slice(items);
        queue.write_buffer(self.buffers.get("clusters"), visible, bytes);
        let indices: Vec<u32> = (0..items.len() as u32).collect();
        let hardware = 4 * u64::from(self.buffers.capacities().clusters);
        let bytes = bytemuck::cast_slice(&indices);
        queue.write_buffer(self.buffers.get("draw_lists"), hardware, bytes);
        self.submit(|passes, recorder| passes.record_picture(recorder));
        Ok(())
    }

    /// Shades the visbuffer as it is.
    pub fn shade(&mut self, view: &View) -> Result<(), GpuError> {
        self.bind(Work::Picture)?;
        self.write_view(view);
        self.submit(|passes, recorder| passes.record_shade(recorder));
        Ok(())
    }

    fn submit(&mut self, record: impl FnOnce(&Passes, &mut Recorder<'_>)) {
        let mut recorder = Recorder::new(&self.gpu.device, None);
        if let Some(passes) = &self.passes[usize::from(Work::Picture.draws())] {
            record(passes, &mut recorder);
        }
        self.recorded.extend(&recorder.passes);
        self.gpu.queue.submit([recorder.encoder.finish()]);
    }
}
