//! A scene on the GPU: its buffers, its pool, the page table, and frames over them.

use std::collections::BTreeSet;
use std::sync::Arc;

use lodestream_shaders::cpu::needs_masked;
use lodestream_shaders::types::{
    MaterialRecord, NOT_INSTALLED, ShadeMode, TextureRecord, View, view_flag,
};
use lodestream_shaders::{SceneArrays, SceneRows, VisbufferTarget};

use super::buffers::{Buffers, Capacities};
use super::device::Gpu;
use super::error::GpuError;
use super::frame::{Passes, Work, record};
use super::instances::Instances;
use super::occlusion::{Occlusion, Steps};
use super::passes::{PageUpload, Parts, Present, Transcode};
use super::pipelines::Pipelines;
use super::pool::Pool;
use super::readback::{FrameResult, Readback};
use super::recorder::Recorder;
use super::timestamps::Timestamps;

/// Everything of one scene that lives on the GPU.
#[derive(Debug)]
pub struct Renderer {
    /// The device.
    pub gpu: Gpu,
    pub(super) arrays: Arc<SceneArrays>,
    pub(super) instances: Instances,
    pool: Pool,
    pub(super) pipelines: Pipelines,
    pub(super) buffers: Buffers,
    /// Of frames that do not draw, and of those that do.
    pub(super) passes: [Option<Passes>; 2],
    present: Option<Present>,
    readback: Readback,
    timestamps: Option<Timestamps>,
    transcode: Transcode,
    page_table: Vec<u32>,
    mode: ShadeMode,
    occlusion: Occlusion,
    by_compute: bool,
    is_masked: bool,
    /// Changes of the page table so far.
    patches: u64,
    /// Changes of instances before the last frame that drew.
    drawn_edits: u64,
    frame: u64,
    pub(super) recorded: BTreeSet<&'static str>,
}

impl Renderer {
    /// Uploads the scene's arrays and makes a pool of `pool_words` words; nothing is installed.
    pub fn new(
        gpu: &Gpu,
        arrays: Arc<SceneArrays>,
        pool_words: u64,
        size_px: [u32; 2],
    ) -> Result<Self, GpuError> {
        let pool = Pool::new(gpu, pool_words)?;
        let mut buffers = Buffers::new(gpu, &arrays, size_px)?;
        Transcode::make_buffers(gpu, &mut buffers)?;
        let is_masked = needs_masked(&arrays.materials);
        Ok(Self {
            pipelines: Pipelines::new(gpu, pool.bindings),
            readback: Readback::new(gpu, arrays.page_count),
            timestamps: Timestamps::new(gpu),
            page_table: arrays.empty_page_table(),
            gpu: gpu.clone(),
            instances: Instances::new(arrays.instances.len() as u32),
            arrays,
            pool,
            buffers,
            passes: [None, None],
            present: None,
            transcode: Transcode::default(),
            mode: ShadeMode::Shaded,
            occlusion: Occlusion::default(),
            by_compute: true,
            is_masked,
            patches: 0,
            drawn_edits: 0,
            frame: 0,
            recorded: BTreeSet::new(),
        })
    }

    /// The scene's arrays.
    pub fn arrays(&self) -> &Arc<SceneArrays> {
        &self.arrays
    }

    /// The pool.
    pub fn pool(&self) -> &Pool {
        &self.pool
    }

    /// Words of the pool where each scene page begins, or `NOT_INSTALLED`: what culling reads.
    pub fn page_table(&self) -> &[u32] {
        &self.page_table
    }

    /// Names of all passes recorded so far.
    pub fn passes_recorded(&self) -> Vec<&'static str> {
        self.recorded.iter().copied().collect()
    }

    /// Names of all pipelines built so far.
    pub fn pipelines_built(&self) -> Vec<&'static str> {
        self.pipelines.names()
    }

    /// Items that the queues hold.
    pub fn capacities(&self) -> Capacities {
        self.buffers.capacities()
    }

    /// Width and height of the picture.
    pub fn size_px(&self) -> [u32; 2] {
        self.buffers.size_px()
    }

    /// What the picture shows.
    pub fn set_mode(&mut self, mode: ShadeMode) -> Result<(), GpuError> {
        let overdraw = mode == ShadeMode::Overdraw;
        if overdraw != (self.mode == ShadeMode::Overdraw) {
            self.unbind();
        }
        self.mode = mode;
        Ok(())
    }

    /// Another size of the picture.
    pub fn resize(&mut self, size_px: [u32; 2]) -> Result<(), GpuError> {
        if size_px != self.buffers.size_px() {
            self.unbind();
            self.occlusion.forget();
            self.buffers.set_size(&self.gpu, size_px)?;
        }
        Ok(())
    }

    /// Whether small clusters go to the compute rasterizer, or all to the hardware.
    pub fn set_compute_raster(&mut self, on: bool) {
        if on != self.by_compute {
            self.unbind();
            self.by_compute = on;
        }
    }

    /// Overdraw counts fragments of the hardware, so it draws all.
    fn draws_by_compute(&self) -> bool {
        let has_compute = self.target() != VisbufferTarget::Attachment;
        self.by_compute && has_compute && self.mode != ShadeMode::Overdraw
    }

    /// Turns occlusion culling off, or on again.
    pub fn set_occlusion(&mut self, on: bool) {
        self.occlusion.set_off(!on);
    }

    /// Whether hidden geometry is culled.
    pub fn has_occlusion(&self) -> bool {
        self.occlusion.is_on()
    }

    /// Whether small clusters go to the compute rasterizer.
    pub fn has_compute_raster(&self) -> bool {
        self.by_compute
    }

    fn changes(&self) -> u64 {
        self.patches + self.instances.edits
    }

    /// Whether requests of `view` are known without drawing: nothing is tested, or against depths
    /// of that very view.
    pub fn sees(&self, view: &View) -> bool {
        self.occlusion.sees(&self.filled(view))
    }

    /// Whether the next frame of `view` is tested for occlusion, or none is.
    pub fn has_depths(&self, view: &View) -> bool {
        self.occlusion.has_depths(&self.filled(view))
    }

    /// [`Renderer::sees`], with all pages drawn that are installed now.
    pub fn is_current(&self, view: &View) -> bool {
        self.occlusion
            .is_current(&self.filled(view), self.changes())
    }

    /// Other queues; what a frame in flight wrote to the old ones is still read back.
    pub fn set_capacities(&mut self, capacities: Capacities) -> Result<(), GpuError> {
        if capacities != self.buffers.capacities() {
            self.unbind();
            self.buffers.set_capacities(&self.gpu, capacities)?;
        }
        Ok(())
    }

    /// Textures made elsewhere, and the materials that use them.
    pub fn set_textures(
        &mut self,
        records: &[TextureRecord],
        texels: wgpu::Buffer,
        materials: &[MaterialRecord],
    ) -> Result<(), GpuError> {
        self.unbind();
        self.buffers.replace("texels", texels);
        let rows = SceneRows::new(&self.arrays, materials, records);
        self.buffers.set_rows(&self.gpu, &rows)
    }

    pub(super) fn unbind(&mut self) {
        self.passes = [None, None];
        self.present = None;
    }

    /// Puts a page in memory form into the pool, as [`Renderer::apply`] does one in disk form.
    pub fn write_page(&self, pool_word: u32, words: &[u32]) {
        self.pool.write(&self.gpu, pool_word.into(), words);
    }

    /// Takes pages out of the page table, transcodes `uploads`, then puts `installed` (page, first word) in, all before
    /// the next frame's culling.
    pub fn apply(
        &mut self,
        evicted: impl IntoIterator<Item = u32>,
        uploads: &[PageUpload<'_>],
        installed: impl IntoIterator<Item = (u32, u32)>,
    ) -> Result<(), GpuError> {
        let evicted: Vec<_> = evicted
            .into_iter()
            .map(|page| (page, NOT_INSTALLED))
            .collect();
        self.patch(&evicted);
        let mut transcode = std::mem::take(&mut self.transcode);
        let outcome = transcode.batches(uploads, |batch| {
            let mut recorder = Recorder::new(&self.gpu.device, None);
            let mut parts = Parts {
                gpu: &self.gpu,
                pipelines: &mut self.pipelines,
                buffers: &self.buffers,
                pool: &self.pool.buffers,
            };
            batch.record(&mut parts, &mut recorder)?;
            self.recorded.extend(&recorder.passes);
            self.gpu.queue.submit([recorder.encoder.finish()]);
            Ok(())
        });
        self.transcode = transcode;
        outcome?;
        let installed: Vec<_> = installed.into_iter().collect();
        self.patch(&installed);
        Ok(())
    }

    /// Writes page table entries, runs of neighbours at once.
    fn patch(&mut self, entries: &[(u32, u32)]) {
        let mut pages: Vec<u32> = Vec::with_capacity(entries.len());
        for &(page, word) in entries {
            if let Some(entry) = self.page_table.get_mut(page as usize) {
                self.patches += 1;
                *entry = word;
                pages.push(page);
            }
        }
        pages.sort_unstable();
        pages.dedup();
        for run in pages.chunk_by(|a, b| a + 1 == *b) {
            let words = &self.page_table[run[0] as usize..run[0] as usize + run.len()];
            self.gpu.queue.write_buffer(
                self.buffers.get("page_table"),
                run[0] as u64 * 4,
                bytemuck::cast_slice(words),
            );
        }
    }

    /// Draws one frame of `view`, whose capacities and counts are filled in here; returns the frame's number.
    pub fn draw(&mut self, view: &View, work: Work) -> Result<u64, GpuError> {
        self.draw_onto(view, work, |_, _| {})
    }

    /// [`Renderer::draw`], with `after` recording what follows the frame's passes.
    pub fn draw_onto(
        &mut self,
        view: &View,
        work: Work,
        after: impl FnOnce(&mut Recorder<'_>, &Buffers),
    ) -> Result<u64, GpuError> {
        self.bind(work)?;
        let view = self.write_view(view);
        let steps = self.plan_occlusion(&view, work)?;
        let mut recorder = Recorder::new(&self.gpu.device, self.timestamps.as_ref());
        if let Some(passes) = &self.passes[usize::from(work.draws())] {
            record(&mut recorder, passes, &self.buffers, work, steps);
        }
        after(&mut recorder, &self.buffers);
        let timestamps = self.timestamps.as_ref();
        let copied = self
            .readback
            .record(&mut recorder, &self.buffers, timestamps);
        self.recorded.extend(&recorder.passes);
        self.gpu.queue.submit([recorder.encoder.finish()]);
        self.frame += 1;
        if let Some(copied) = copied {
            self.readback.submitted(self.frame, copied);
        }
        Ok(self.frame)
    }

    /// Copies the last picture to a window's surface, with `overlay` drawing over its colours first.
    pub fn present(
        &mut self,
        target: &wgpu::TextureView,
        format: wgpu::TextureFormat,
        overlay: impl FnOnce(&Gpu, &mut wgpu::CommandEncoder, &wgpu::Buffer),
    ) -> Result<(), GpuError> {
        if self.present.is_none() {
            self.present = Some(Present::new(&mut self.parts(), format)?);
        }
        let mut recorder = Recorder::new(&self.gpu.device, None);
        overlay(&self.gpu, &mut recorder.encoder, self.buffers.get("color"));
        if let Some(present) = &self.present {
            present.record(&mut recorder, target);
        }
        self.recorded.extend(&recorder.passes);
        self.gpu.queue.submit([recorder.encoder.finish()]);
        Ok(())
    }

    /// Frames that came back, oldest first; `wait` waits for all.
    pub fn collect(&mut self, wait: bool) -> Result<Vec<FrameResult>, GpuError> {
        let results = self
            .readback
            .collect(&self.gpu, self.timestamps.as_ref(), wait)?;
        for result in &results {
            self.occlusion.take(&result.counters);
        }
        Ok(results)
    }

    /// Frames whose results are still on their way.
    pub fn in_flight(&self) -> usize {
        self.readback.in_flight()
    }

    /// The buffer that the passes bind as `name`.
    pub fn buffer(&self, name: &str) -> &wgpu::Buffer {
        self.buffers.get(name)
    }

    /// First byte of the visible clusters in `clusters`.
    pub fn visible_offset(&self) -> u64 {
        self.buffers.visible_offset()
    }

    /// Overwrites the buffer that the passes bind as `name`, from its first byte on.
    pub fn write_buffer(&self, name: &str, bytes: &[u8]) {
        self.gpu
            .queue
            .write_buffer(self.buffers.get(name), 0, bytes);
    }

    /// Builds and binds what `work` needs, ahead of its first frame.
    pub fn prepare(&mut self, work: Work) -> Result<(), GpuError> {
        self.bind(work)
    }

    /// `view` with the counts of the scene and the capacities of the queues.
    fn filled(&self, view: &View) -> View {
        let capacities = self.buffers.capacities();
        let by_compute = self.draws_by_compute() && !view.is_reference();
        let flag = |bit: u32, on: bool| if on { bit } else { 0 };
        View {
            size_px: self.buffers.size_px(),
            instance_count: self.instances.count,
            page_count: self.arrays.page_count,
            shade_mode: self.mode as u32,
            node_capacity: capacities.nodes,
            cluster_capacity: capacities.clusters,
            request_capacity: self.arrays.page_count,
            flags: view.flags
                | flag(view_flag::HARDWARE, !by_compute)
                | flag(view_flag::MASKED, self.is_masked)
                | flag(
                    view_flag::ORDERED,
                    self.target() == VisbufferTarget::Attachment,
                ),
            ..*view
        }
        .with_rows(self.buffers.first_rows())
    }

    pub(super) fn write_view(&self, view: &View) -> View {
        let view = self.filled(view);
        self.write_buffer("view", bytemuck::bytes_of(&view));
        let second = View {
            flags: view.flags | view_flag::SECOND_ROUND,
            ..view
        };
        self.write_buffer("second_view", bytemuck::bytes_of(&second));
        view
    }

    /// Decides about occlusion, and writes the views that drew the depths of both passes.
    fn plan_occlusion(&mut self, view: &View, work: Work) -> Result<Steps, GpuError> {
        let mut steps = self.occlusion.plan(view, work.draws());
        if !work.draws() && self.instances.edits != self.drawn_edits {
            // Nothing looks again at what depths of other instances hide.
            steps.tests = false;
        }
        if work.draws() {
            self.drawn_edits = self.instances.edits;
        }
        let early = self.occlusion.early(steps, work.draws());
        let early = early.unwrap_or(View { flags: 0, ..*view });
        let late = View {
            flags: view_flag::OCCLUSION | view_flag::LATE,
            ..*view
        };
        self.write_buffer("occluder", bytemuck::bytes_of(&early));
        self.write_buffer("late_occluder", bytemuck::bytes_of(&late));
        if let Some(mut passes) = self.passes[usize::from(work.draws())].take() {
            let added = passes.add(&mut self.parts(), steps);
            self.passes[usize::from(work.draws())] = Some(passes);
            added?;
        }
        self.occlusion.recorded(view, steps, self.changes());
        Ok(steps)
    }

    fn parts(&mut self) -> Parts<'_> {
        Parts {
            gpu: &self.gpu,
            pipelines: &mut self.pipelines,
            buffers: &self.buffers,
            pool: &self.pool.buffers,
        }
    }

    pub(super) fn bind(&mut self, work: Work) -> Result<(), GpuError> {
        let index = usize::from(work.draws());
        if self.passes[index].is_none() {
            let arrays = self.arrays.clone();
            let overdraw = self.mode == ShadeMode::Overdraw;
            let by_compute = self.draws_by_compute();
            let instance_count = self.instances.count;
            let passes = Passes::new(
                &mut self.parts(),
                &arrays,
                instance_count,
                work.draws(),
                overdraw,
                by_compute,
            )?;
            self.passes[index] = Some(passes);
        }
        Ok(())
    }
}
