//! The picture at full detail: every source triangle of every instance, without culling and without level of detail.
//!
//! The visbuffer accumulates by atomic maximum, so the triangles may come in batches that fit the pool: after each the
//! pixels that it won are shaded, while its pages are still there, and kept.

use std::time::Instant;

use lodestream_format::cluster::NO_GROUP;
use lodestream_format::disk_form::DiskForm;
use lodestream_format::page_reader::PageReader;
use lodestream_shaders::cpu::Camera;
use lodestream_shaders::types::{ClusterItem, ShadeMode, View};

use crate::camera::near_metres;
use crate::error::ClientError;
use crate::gpu::{self, Capacities, Gpu, Renderer};
use crate::opening::{DEFAULT_POOL_BYTES, Opening, SessionOptions};
use crate::report::{Drawn, Report};
use crate::stream::{OpenedAsset, StreamError, decode_page, split_frames};

/// Pages fetched at once.
const PAGES_A_FETCH: u32 = 32;
/// Clusters a batch.
const CLUSTERS_A_BATCH: u32 = 1 << 19;

/// A finished reference.
#[derive(Debug)]
pub struct Reference {
    /// RGBA words (sRGB).
    pub color: Vec<u32>,
    /// Visbuffer words; their ids mean nothing across batches, their depths do.
    pub visbuffer: Vec<u64>,
    /// What was done.
    pub report: Report,
}

struct Batches<'a> {
    renderer: Renderer,
    view: View,
    opening: &'a Opening,
    mode: ShadeMode,
    items: Vec<ClusterItem>,
    next_word: u32,
    color: Vec<u32>,
    visbuffer: Vec<u64>,
    batches: u32,
    drawn: Drawn,
}

/// Draws `camera`'s picture of the scene.
pub fn reference(
    gpu: &Gpu,
    options: &SessionOptions,
    camera: impl FnOnce(&Opening) -> Camera,
) -> Result<Reference, ClientError> {
    let start = Instant::now();
    let opening = Opening::new(options)?;
    let mut report = Report {
        scene: options.scene.clone(),
        open_secs: Some(opening.secs),
        open_bytes: opening.scene.open_bytes,
        bytes_fetched: opening.scene.open_bytes,
        adapter: gpu.name.clone(),
        ..Report::default()
    };
    let camera = camera(&opening);
    let mut batches = Batches::new(gpu, &opening, options, &camera, &mut report)?;
    for (index, used) in opening.scene.assets.iter().enumerate() {
        batches.asset(index, used, &mut report)?;
    }
    batches.flush()?;
    if options.mode == ShadeMode::Overdraw {
        // Counts accumulate over the batches by themselves.
        batches.renderer.shade(&batches.view)?;
        batches.color = batches.renderer.read_color()?;
    }
    report.settled_secs = Some(start.elapsed().as_secs_f64());
    report.frames = 1;
    report.bytes_fetched += report.texture_bytes_fetched;
    report.pool_bytes = batches.renderer.pool().bytes();
    report.reference_batches = Some(batches.batches);
    report.visbuffer = batches.renderer.target().name();
    report.passes_recorded = batches.renderer.passes_recorded();
    report.pipelines_built = batches.renderer.pipelines_built();
    batches.drawn.instances = opening.arrays.instances.len() as u64;
    batches.drawn.clusters_hardware = batches.drawn.clusters;
    report.drawn = Some(batches.drawn);
    Ok(Reference {
        color: batches.color,
        visbuffer: batches.visbuffer,
        report,
    })
}

/// Words of the pool: the whole scene where it fits, else what was asked for or is usual.
fn pool_words(gpu: &Gpu, opening: &Opening, asked: Option<u64>) -> u64 {
    let pages = opening
        .scene
        .assets
        .iter()
        .flat_map(|used| &used.asset.pages);
    let whole: u64 = pages.map(|page| page.memory_words as u64).sum();
    let most = gpu::max_bytes(gpu).min(asked.unwrap_or(4 * DEFAULT_POOL_BYTES)) / 4;
    let page = lodestream_format::limits::PAGE_WORDS as u64;
    whole.min(most).max(page)
}

impl<'a> Batches<'a> {
    fn new(
        gpu: &Gpu,
        opening: &'a Opening,
        options: &SessionOptions,
        camera: &Camera,
        report: &mut Report,
    ) -> Result<Self, ClientError> {
        let words = pool_words(gpu, opening, options.pool_bytes);
        let mut renderer = Renderer::new(gpu, opening.arrays.clone(), words, options.size_px)?;
        renderer.set_mode(options.mode)?;
        renderer.set_target(options.visbuffer)?;
        let clusters: u64 = opening
            .arrays
            .instances
            .iter()
            .filter_map(|instance| opening.scene.assets.get(instance.asset as usize))
            .map(|used| used.asset.clusters)
            .sum();
        renderer.set_capacities(Capacities {
            clusters: clusters.clamp(1, CLUSTERS_A_BATCH as u64) as u32,
            ..renderer.capacities()
        })?;
        opening.load_textures(&mut renderer, options, report)?;
        let near = near_metres(&opening.arrays, &opening.subject);
        let view = camera.view(near, 0.0);
        // The background. Shading overwrites the fragment counts, so they are cleared again.
        renderer.clear_visbuffer()?;
        renderer.shade(&view)?;
        let color = renderer.read_color()?;
        renderer.clear_visbuffer()?;
        Ok(Self {
            color,
            visbuffer: renderer.read_visbuffer()?,
            renderer,
            view,
            opening,
            mode: options.mode,
            items: Vec::new(),
            next_word: 0,
            batches: 0,
            drawn: Drawn::default(),
        })
    }

    fn asset(
        &mut self,
        index: usize,
        used: &OpenedAsset,
        report: &mut Report,
    ) -> Result<(), ClientError> {
        let instances: Vec<u32> = (0..)
            .zip(&self.opening.arrays.instances)
            .filter(|(_, instance)| instance.asset as usize == index)
            .map(|(instance, _)| instance)
            .collect();
        if instances.is_empty() {
            return Ok(());
        }
        let mut reader = PageReader::new(&used.asset);
        for form in &used.root_pages {
            self.page(used, form, &mut reader, &instances)?;
        }
        let pages = used.asset.pages.len() as u32;
        let mut first = used.asset.root_page_count;
        while first < pages {
            let last = (first + PAGES_A_FETCH).min(pages) - 1;
            let bytes = self
                .opening
                .runtime
                .block_on(self.opening.source.pages(used, first, last))?;
            report.requests += 1;
            report.bytes_fetched += bytes.len() as u64;
            let frames = split_frames(&used.hash, &used.asset, first, last, &bytes)?;
            for (page, frame) in (first..).zip(&frames) {
                let decoded: Result<DiskForm, StreamError> =
                    decode_page(&used.hash, &used.asset, &used.hierarchy, page, frame);
                self.page(used, &decoded?, &mut reader, &instances)?;
                report.pages_fetched += 1;
            }
            first = last + 1;
        }
        Ok(())
    }

    /// Puts a page into the pool and its source triangles, for every instance, into the batch.
    fn page(
        &mut self,
        used: &OpenedAsset,
        form: &DiskForm,
        reader: &mut PageReader,
        instances: &[u32],
    ) -> Result<(), ClientError> {
        let page = used.page_base + form.page();
        let place = format!("page {} of asset {}", form.page(), used.hash);
        let memory = reader.read(form).map_err(StreamError::format(place))?;
        let leaves: Vec<u32> = (0..)
            .zip(form.headers())
            .filter(|(_, header)| header.child_group() == NO_GROUP)
            .map(|(cluster, _)| cluster)
            .collect();
        if leaves.is_empty() {
            return Ok(());
        }
        let words = memory.len() as u32;
        if self.next_word as u64 + words as u64 > self.renderer.pool().words {
            self.flush()?;
            self.next_word = 0;
        }
        let page_word = self.next_word;
        self.next_word += words;
        self.renderer.write_page(page_word, memory);
        for &instance in instances {
            for &cluster in &leaves {
                if self.items.len() == self.renderer.capacities().clusters as usize {
                    self.flush()?;
                }
                self.items.push(ClusterItem {
                    instance,
                    page,
                    cluster,
                    page_word,
                });
                self.drawn.clusters += 1;
                self.drawn.triangles += form.headers()[cluster as usize].triangle_count() as u64;
            }
        }
        Ok(())
    }

    /// Draws the batch over what came before and keeps the pixels that it won.
    fn flush(&mut self) -> Result<(), ClientError> {
        if self.items.is_empty() {
            return Ok(());
        }
        self.batches += 1;
        self.renderer.raster_items(&self.view, &self.items)?;
        self.items.clear();
        let words = self.renderer.read_visbuffer()?;
        if self.mode != ShadeMode::Overdraw {
            let won = |(new, old): (&u64, &u64)| if new == old { 0 } else { *new };
            let won: Vec<u64> = words.iter().zip(&self.visbuffer).map(won).collect();
            // Pixels of other batches must not be looked up in this one's pages.
            self.renderer
                .write_buffer("visbuffer", bytemuck::cast_slice(&won));
            self.renderer.shade(&self.view)?;
            let color = self.renderer.read_color()?;
            for ((kept, new), won) in self.color.iter_mut().zip(color).zip(&won) {
                if *won != 0 {
                    *kept = new;
                }
            }
            self.renderer
                .write_buffer("visbuffer", bytemuck::cast_slice(&words));
        }
        self.visbuffer = words;
        Ok(())
    }
}
