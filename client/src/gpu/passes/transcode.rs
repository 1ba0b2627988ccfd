//! Pages in staged form, through a staging buffer, into the pool: `restore`, `restore_normals` and `transcode`.

use std::collections::HashMap;

use lodestream_format::cluster::Attributes;
use lodestream_format::disk_form::{DiskForm, FIELDS, header_word};
use lodestream_format::limits::{MAX_DISK_FORM_BYTES, MAX_PAGE_CLUSTERS};
use lodestream_shaders::passes;
use lodestream_shaders::types::TranscodeJob;

use super::Parts;
use crate::gpu::buffers::{Buffers, create};
use crate::gpu::device::Gpu;
use crate::gpu::error::GpuError;
use crate::gpu::recorder::Recorder;

/// Words of disk forms, spans and parents that one submission takes: at least those of the largest page.
const STAGING_WORDS: usize = 2 << 20;
/// Words of restored vertices that one submission takes: at least those of the largest page.
const RESTORED_WORDS: usize = 4 << 20;
/// Pages that one submission takes: a row of workgroups each.
const MOST_JOBS: usize = 65_535;

const _: () = assert!(
    MAX_DISK_FORM_BYTES / 4 * FIELDS + MAX_PAGE_CLUSTERS * 3 <= RESTORED_WORDS,
    "a page of vertices alone, with all fields"
);

/// A checked page and where it goes.
#[derive(Debug, Clone, Copy)]
pub struct PageUpload<'a> {
    /// The page.
    pub form: &'a DiskForm,
    /// First word in the pool.
    pub pool_word: u32,
    /// For each of [`DiskForm::parents`] the first word of its page in the pool. Its page was uploaded before, or comes
    /// before in the same uploads.
    pub parents: &'a [u32],
}

/// Gathers pages into batches that fit the buffers, none with a page and its parent.
#[derive(Debug, Default)]
pub struct Transcode {
    jobs: Vec<TranscodeJob>,
    staging: Vec<u32>,
    restored_words: usize,
    most_clusters: u32,
    has_normals: bool,
}

impl Transcode {
    /// Takes `pages`, parents before children, calling `submit` for every batch.
    pub fn batches(
        &mut self,
        pages: &[PageUpload<'_>],
        mut submit: impl FnMut(&Self) -> Result<(), GpuError>,
    ) -> Result<(), GpuError> {
        for wave in waves(pages) {
            for page in wave {
                if !self.has_room(page) {
                    submit(self)?;
                    self.clear();
                }
                self.push(page);
            }
            if !self.jobs.is_empty() {
                submit(self)?;
                self.clear();
            }
        }
        Ok(())
    }

    fn has_room(&self, page: &PageUpload<'_>) -> bool {
        self.jobs.is_empty()
            || self.jobs.len() < MOST_JOBS
                && self.staging.len() + staging_words(page.form) <= STAGING_WORDS
                && self.restored_words + restored_words(page.form) <= RESTORED_WORDS
    }

    fn push(&mut self, page: &PageUpload<'_>) {
        let form = page.form;
        let disk_word = self.staging.len() as u32;
        self.staging.extend_from_slice(form.words());
        let span_word = self.staging.len() as u32;
        self.staging
            .extend_from_slice(bytemuck::cast_slice(form.spans()));
        let parents_word = self.staging.len() as u32;
        let parents = page.parents.iter().zip(form.parents());
        self.staging
            .extend(parents.flat_map(|(&word, &[_, cluster])| [word, cluster]));
        self.jobs.push(TranscodeJob {
            disk_word,
            span_word,
            pool_word: page.pool_word,
            tables_word: form.memory_tables_word(),
            parents_word,
            restored_word: self.restored_words as u32,
        });
        self.restored_words += restored_words(form);
        self.most_clusters = self.most_clusters.max(form.headers().len() as u32);
        self.has_normals |= form.attributes().has(Attributes::NORMAL);
    }

    fn clear(&mut self) {
        self.jobs.clear();
        self.staging.clear();
        self.restored_words = 0;
        self.most_clusters = 0;
        self.has_normals = false;
    }

    /// Copies the batch to the GPU and records its dispatches.
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
        let jobs = self.jobs.len() as u32;
        let restore = parts.bind(&passes::RESTORE)?;
        recorder.compute("restore", |dispatches| {
            dispatches.run(&restore, [jobs, 1, 1]);
        });
        if self.has_normals {
            let normals = parts.bind(&passes::RESTORE_NORMALS)?;
            recorder.compute("restore_normals", |dispatches| {
                dispatches.run(&normals, [self.most_clusters, jobs, 1]);
            });
        }
        let transcode = parts.bind(&passes::TRANSCODE)?;
        recorder.compute("transcode", |dispatches| {
            dispatches.run(&transcode, [self.most_clusters + 1, jobs, 1]);
        });
        Ok(())
    }

    /// Makes the buffers.
    pub fn make_buffers(gpu: &Gpu, buffers: &mut Buffers) -> Result<(), GpuError> {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let jobs = MOST_JOBS * size_of::<TranscodeJob>();
        for (name, bytes) in [
            ("staging", 4 * STAGING_WORDS),
            ("restored", 4 * RESTORED_WORDS),
            ("transcode_jobs", jobs),
        ] {
            buffers.replace(name, create(gpu, name, bytes as u64, usage)?);
        }
        Ok(())
    }
}

const _: () = assert!(
    // Spans of four words; a group names 256 parents at most, of two words.
    MAX_DISK_FORM_BYTES / 4 + MAX_PAGE_CLUSTERS * (4 + 2 * 256) <= STAGING_WORDS,
    "the largest page"
);

fn staging_words(form: &DiskForm) -> usize {
    form.words().len() + 4 * form.spans().len() + 2 * form.parents().len()
}

/// A word for each field of each vertex that the page has, and three a cluster.
fn restored_words(form: &DiskForm) -> usize {
    let when = |flag, fields| match form.attributes().has(flag) {
        true => fields,
        false => 0,
    };
    let fields =
        3 + when(Attributes::NORMAL, 2) + when(Attributes::UV, 2) + when(Attributes::COLOR, 4);
    fields * form.words()[header_word::VERTEX_COUNT] as usize + 3 * form.headers().len()
}

/// Pages in the order of waves: none needs one of its own wave.
fn waves<'a, 'p>(pages: &'a [PageUpload<'p>]) -> Vec<Vec<&'a PageUpload<'p>>> {
    let mut wave_of: HashMap<u32, usize> = HashMap::with_capacity(pages.len());
    let mut waves: Vec<Vec<&PageUpload<'_>>> = Vec::new();
    for page in pages {
        let parents = page.parents.iter();
        let after = parents.filter_map(|word| wave_of.get(word));
        let wave = after.max().map_or(0, |wave| wave + 1);
        wave_of.insert(page.pool_word, wave);
        if wave == waves.len() {
            waves.push(Vec::new());
        }
        waves[wave].push(page);
    }
    waves
}
