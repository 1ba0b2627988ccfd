//! Pages in staged form, through a staging buffer, into the pool.

use lodestream_format::disk_form::DiskForm;
use lodestream_shaders::passes;
use lodestream_shaders::types::TranscodeJob;

use super::Parts;
use crate::gpu::buffers::{Buffers, create};
use crate::gpu::device::Gpu;
use crate::gpu::error::GpuError;
use crate::gpu::recorder::Recorder;

/// Words of disk forms and spans that one submission takes.
const STAGING_WORDS: usize = 2 << 20;
/// Pages that one submission takes: a row of workgroups each.
const MOST_JOBS: usize = 65_535;

/// A checked page and where it goes.
#[derive(Debug, Clone, Copy)]
pub struct PageUpload<'a> {
    /// The page.
    pub form: &'a DiskForm,
    /// First word in the pool.
    pub pool_word: u32,
}

/// Gathers pages into batches of at most [`STAGING_WORDS`] words.
#[derive(Debug, Default)]
pub struct Transcode {
    jobs: Vec<TranscodeJob>,
    staging: Vec<u32>,
    most_clusters: u32,
}

impl Transcode {
    /// Takes `pages` in order, calling `submit` for every batch that is full and for the rest.
    pub fn batches(
        &mut self,
        pages: &[PageUpload<'_>],
        mut submit: impl FnMut(&Self) -> Result<(), GpuError>,
    ) -> Result<(), GpuError> {
        for page in pages {
            let words = page.form.words().len() + page.form.spans().len() * 3;
            let full = self.staging.len() + words > STAGING_WORDS || self.jobs.len() == MOST_JOBS;
            if full && !self.jobs.is_empty() {
                submit(self)?;
                self.clear();
            }
            self.push(page);
        }
        if !self.jobs.is_empty() {
            submit(self)?;
            self.clear();
        }
        Ok(())
    }

    fn push(&mut self, page: &PageUpload<'_>) {
        let disk_word = self.staging.len() as u32;
        self.staging.extend_from_slice(page.form.words());
        let span_word = self.staging.len() as u32;
        self.staging
            .extend_from_slice(bytemuck::cast_slice(page.form.spans()));
        self.jobs.push(TranscodeJob {
            disk_word,
            span_word,
            pool_word: page.pool_word,
            tables_word: page.form.memory_tables_word(),
        });
        self.most_clusters = self.most_clusters.max(page.form.headers().len() as u32);
    }

    fn clear(&mut self) {
        self.jobs.clear();
        self.staging.clear();
        self.most_clusters = 0;
    }

    /// Copies the batch to the GPU and records its dispatch: a workgroup a cluster, one more a page.
    pub fn record(
        &self,
        parts: &mut Parts<'_>,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        let queue = &parts.gpu.queue;
        let jobs = parts.buffers.get("transcode_jobs");
        queue.write_buffer(jobs, 0, bytemuck::cast_slice(&self.jobs));
        let staging = parts.buffers.get("staging");
        queue.write_buffer(staging, 0, bytemuck::cast_slice(&self.staging));
        let transcode = parts.bind(&passes::TRANSCODE, &[])?;
        recorder.compute("transcode", |dispatches| {
            let workgroups = [self.most_clusters + 1, self.jobs.len() as u32, 1];
            dispatches.run(&transcode, workgroups);
        });
        Ok(())
    }

    /// Makes the staging buffers: as long as a batch, or as one page longer than that.
    pub fn make_buffers(gpu: &Gpu, buffers: &mut Buffers) -> Result<(), GpuError> {
        use lodestream_format::limits::{MAX_DISK_FORM_BYTES, MAX_PAGE_CLUSTERS};
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let largest = MAX_DISK_FORM_BYTES / 4 + MAX_PAGE_CLUSTERS * 3;
        let words = STAGING_WORDS.max(largest);
        buffers.replace("staging", create(gpu, "staging", words as u64 * 4, usage)?);
        let bytes = (MOST_JOBS * size_of::<TranscodeJob>()) as u64;
        buffers.replace(
            "transcode_jobs",
            create(gpu, "transcode_jobs", bytes, usage)?,
        );
        Ok(())
    }
}
