//! A viewer without a window: a scene opened from a library, its streamer and its renderer, frame by frame.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use lodestream_shaders::SceneArrays;
use lodestream_shaders::cpu::Camera;
use lodestream_shaders::types::{Counters, ShadeMode, View};

use crate::camera::{framing, near_metres};
use crate::error::ClientError;
use crate::gpu::{self, FrameResult, Gpu, GpuError, PageUpload, Renderer, Work};
use crate::opening::{Opening, SessionOptions, pool_bytes};
use crate::report::{Drawn, Percentiles, Report};
use crate::stream::{Changes, PixelErrorLimit, ResidencyConfig, Streamer, StreamingRequest};
use crate::subject::Subject;

/// Longest sleep for an arrival before the view is looked at again.
const ARRIVAL_WAIT: Duration = Duration::from_millis(20);
/// Most frame times kept.
const MOST_TIMES: usize = 1 << 14;
/// Step by which the pixel error rises when the adapter cannot hold a frame's queues.
const QUEUE_RAISE: f32 = 1.25;
/// Pixel error past which a scene whose queues still do not fit is given up: it is coarser than any picture is large.
const MOST_PIXEL_ERROR: f32 = 1e6;

/// See the module.
pub struct Session {
    /// The renderer.
    pub renderer: Renderer,
    /// The streamer.
    pub streamer: Streamer,
    scene_name: String,
    mode: ShadeMode,
    near_metres: f32,
    subject: Arc<Subject>,
    /// Least pixel error that the adapter's queues can hold.
    queue_pixel_error: f32,
    looked_from: Option<Camera>,
    frames: u64,
    last_counters: Option<Counters>,
    frame_ms: Vec<f64>,
    gpu_ms: BTreeMap<&'static str, Vec<f64>>,
    /// Whether every frame is a picture; else those that only ask for pages would water the times down.
    times_frames: bool,
    report: Report,
    // Dropped last: the streamer's tasks run on it.
    _runtime: tokio::runtime::Runtime,
}

impl Session {
    /// Opens the scene on the best adapter.
    pub fn open(options: &SessionOptions) -> Result<Self, ClientError> {
        let (gpu, _) = Gpu::open(&gpu::instance(), options.adapter.as_deref(), None)?;
        Self::on(&gpu, options)
    }

    /// Opens the scene on a device that exists.
    pub fn on(gpu: &Gpu, options: &SessionOptions) -> Result<Self, ClientError> {
        let opening = Opening::new(options)?;
        let mut report = Report {
            scene: options.scene.clone(),
            open_secs: Some(opening.secs),
            open_bytes: opening.scene.open_bytes,
            ..Report::default()
        };
        let pool_bytes = pool_bytes(
            gpu,
            &opening.scene,
            options.pool_bytes,
            &mut report.warnings,
        );
        let config = ResidencyConfig {
            pixel_error_px: options.pixel_error_px,
            readback_updates: options.readback_updates,
            fetches_hidden: options.fetches_hidden,
            ..ResidencyConfig::new(pool_bytes)
        };
        let streamer = Streamer::new(
            opening.source.clone(),
            opening.scene.clone(),
            config,
            options.transport,
            opening.runtime.handle().clone(),
        )?;
        let words = streamer.residency().layout().words();
        let mut renderer =
            Renderer::new(gpu, opening.arrays.clone(), words as u64, options.size_px)?;
        renderer.set_mode(options.mode)?;
        renderer.set_occlusion(options.occlusion);
        renderer.set_compute_raster(options.compute_raster);
        renderer.set_target(options.visbuffer)?;
        opening.load_textures(&mut renderer, options, &mut report)?;
        let mut session = Self {
            near_metres: near_metres(&opening.arrays, &opening.subject),
            subject: opening.subject.clone(),
            renderer,
            streamer,
            scene_name: options.scene.clone(),
            mode: options.mode,
            queue_pixel_error: 0.0,
            looked_from: None,
            frames: 0,
            last_counters: None,
            frame_ms: Vec::new(),
            gpu_ms: BTreeMap::new(),
            times_frames: false,
            report,
            _runtime: opening.runtime,
        };
        // The root pages: from here on there is always something to draw.
        let changes = session.streamer.poll();
        session.apply(&changes)?;
        Ok(session)
    }

    /// The scene's arrays.
    pub fn arrays(&self) -> &Arc<SceneArrays> {
        self.renderer.arrays()
    }

    /// The camera that frames the scene's subject; the report says what it leaves out.
    pub fn framing(&mut self, size_px: [u32; 2]) -> Camera {
        self.report.tell_outside(&self.subject);
        framing(&self.subject, size_px)
    }

    /// The part of the scene that is framed.
    pub fn subject(&self) -> &Subject {
        &self.subject
    }

    /// Distance of the near plane, metres.
    pub fn near_metres(&self) -> f32 {
        self.near_metres
    }

    /// What a frame of `camera` is culled with now.
    pub fn view(&self, camera: &Camera) -> View {
        camera.view(self.near_metres, self.pixel_error())
    }

    /// Pixel error of the next frame: what the streamer or the adapter's queues can hold, at least what was asked for.
    pub fn pixel_error(&self) -> f32 {
        self.streamer.pixel_error().max(self.queue_pixel_error)
    }

    /// Pixel error of the last picture: what its cut may show, or the rounding of the source to its
    /// grid where that shows more.
    pub fn pixel_error_shown(&self) -> f32 {
        self.pixel_error().max(self.rounding_px())
    }

    fn rounding_px(&self) -> f32 {
        let bits = self.last_counters.map(|counters| counters.rounding_px_bits);
        bits.map_or(0.0, f32::from_bits)
    }

    /// Changes what the picture shows. Textures are those of the mode that the session was opened with.
    pub fn set_mode(&mut self, mode: ShadeMode) -> Result<(), ClientError> {
        self.mode = mode;
        Ok(self.renderer.set_mode(mode)?)
    }

    /// What the picture shows.
    pub fn mode(&self) -> ShadeMode {
        self.mode
    }

    /// Does what the streamer asks of the GPU.
    pub fn apply(&mut self, changes: &Changes) -> Result<(), ClientError> {
        if changes.is_empty() {
            return Ok(());
        }
        let uploads: Vec<_> = changes
            .uploads
            .iter()
            .map(|upload| PageUpload {
                form: &upload.form,
                pool_word: upload.word_offset,
                parents: &upload.parents,
            })
            .collect();
        let evicted = changes.evicted.iter().copied();
        let installed = changes.installed.iter().copied();
        Ok(self.renderer.apply(evicted, &uploads, installed)?)
    }

    /// Takes what frames told: grows queues, hands requests to the streamer, applies its changes. Returns whether every
    /// frame was whole.
    pub fn take(&mut self, results: Vec<FrameResult>) -> Result<bool, ClientError> {
        let mut whole = true;
        for result in results {
            if self.grow(&result.counters)? {
                // Its requests are as incomplete as its picture.
                whole = false;
                continue;
            }
            let requests: Vec<_> = result.requests.iter().map(Into::into).collect();
            let changes = self.streamer.tick(&requests);
            self.apply(&changes)?;
            self.last_counters = Some(result.counters);
            if self.times_frames {
                self.keep_gpu_ms(result.gpu_ms);
            }
        }
        Ok(whole)
    }

    /// Doubles queues that a frame found too small; where the adapter cannot hold them, raises the pixel error.
    fn grow(&mut self, counters: &Counters) -> Result<bool, ClientError> {
        let capacities = self.renderer.capacities();
        match capacities.grown(&self.renderer.gpu, counters) {
            Ok(grown) if grown == capacities => Ok(false),
            Ok(grown) => {
                self.renderer.set_capacities(grown)?;
                Ok(true)
            }
            Err(error @ GpuError::Limit { .. }) => {
                self.queue_pixel_error = self.pixel_error() * QUEUE_RAISE;
                if self.queue_pixel_error > MOST_PIXEL_ERROR {
                    return Err(error.into());
                }
                self.report.pixel_error_limit = Some(error.to_string());
                Ok(true)
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Says where the next frames look from: after a move, nothing is settled until frames of the new view came back.
    pub fn look(&mut self, camera: &Camera) {
        if self.looked_from.as_ref() != Some(camera) {
            self.looked_from = Some(*camera);
            self.streamer.view_changed();
        }
    }

    /// One frame that asks for pages, waited for. It draws where no depths of this
    /// view are there for the occlusion test. Returns its requests, once it is whole.
    pub fn request_pages(&mut self, camera: &Camera) -> Result<Vec<StreamingRequest>, ClientError> {
        let view = self.view(camera);
        if !self.renderer.has_depths(&view) {
            // Without depths a frame asks for hidden pages as if they were visible: only its depths
            // are taken.
            self.renderer.draw(&view, Work::Visbuffer)?;
            self.frames += 1;
            for result in self.renderer.collect(true)? {
                self.grow(&result.counters)?;
            }
        }
        let work = match self.renderer.sees(&view) {
            true => Work::Requests,
            false => Work::Visbuffer,
        };
        self.ask(camera, work)
    }

    fn ask(&mut self, camera: &Camera, work: Work) -> Result<Vec<StreamingRequest>, ClientError> {
        self.look(camera);
        loop {
            let view = self.view(camera);
            tracing::debug!(?work, "frame");
            self.renderer.draw(&view, work)?;
            self.frames += 1;
            let results = self.renderer.collect(true)?;
            let requests = results.last().map_or(Vec::new(), |last| {
                last.requests.iter().map(Into::into).collect()
            });
            if self.take(results)? {
                return Ok(requests);
            }
        }
    }

    /// Asks and waits until all that `camera` wants is installed, or `timeout` is over; says which.
    pub fn settle(&mut self, camera: &Camera, timeout: Duration) -> Result<bool, ClientError> {
        let start = Instant::now();
        loop {
            let before = self.streamer.stats().pages_fetched;
            self.request_pages(camera)?;
            if self.streamer.is_settled() {
                // Pages that came since the depths were drawn may show more.
                if self.renderer.is_current(&self.view(camera)) {
                    return Ok(true);
                }
                self.ask(camera, Work::Visbuffer)?;
                if self.streamer.is_settled() && self.renderer.is_current(&self.view(camera)) {
                    return Ok(true);
                }
            }
            if start.elapsed() > timeout {
                return Ok(false);
            }
            let stats = self.streamer.stats();
            if stats.pages_fetched == before && stats.pages_missing > 0 {
                self.streamer.wait(ARRIVAL_WAIT);
            }
        }
    }

    /// Draws a whole picture and waits for it.
    pub fn picture(&mut self, camera: &Camera) -> Result<(), ClientError> {
        loop {
            let view = self.view(camera);
            self.renderer.prepare(Work::Picture)?;
            let start = Instant::now();
            self.renderer.draw(&view, Work::Picture)?;
            let results = self.renderer.collect(true)?;
            let frame_ms = start.elapsed().as_secs_f64() * 1e3;
            self.frames += 1;
            let mut whole = true;
            for result in results {
                whole &= !self.grow(&result.counters)?;
                self.last_counters = Some(result.counters);
                self.keep_gpu_ms(result.gpu_ms);
            }
            if whole {
                keep(&mut self.frame_ms, frame_ms);
                return Ok(());
            }
        }
    }

    /// Counts the GPU's times of the frames that [`Session::take`] gets: all of them are pictures.
    pub fn time_frames(&mut self) {
        self.times_frames = true;
    }

    /// A warning for the report.
    pub fn warn(&mut self, line: String) {
        self.report.warnings.push(line);
    }

    /// Counts a frame that was drawn elsewhere: a window's.
    pub fn count_frame(&mut self, frame_ms: f64) {
        self.frames += 1;
        keep(&mut self.frame_ms, frame_ms);
    }

    /// What the last frame that came back drew.
    pub fn drawn(&self) -> Drawn {
        self.last_counters
            .as_ref()
            .map_or(Drawn::default(), Drawn::from)
    }

    /// The scene's name.
    pub fn scene_name(&self) -> &str {
        &self.scene_name
    }

    /// Bytes fetched so far: scene, textures and pages.
    pub fn bytes_fetched(&self) -> u64 {
        let stats = self.streamer.stats();
        stats.bytes_fetched + self.report.open_bytes + self.report.texture_bytes_fetched
    }

    fn keep_gpu_ms(&mut self, gpu_ms: Vec<(&'static str, f64)>) {
        for (pass, ms) in gpu_ms {
            keep(self.gpu_ms.entry(pass).or_default(), ms);
        }
    }

    /// What the session did so far.
    pub fn report(&self) -> Report {
        let stats = self.streamer.stats();
        let median = |values: &Vec<f64>| Percentiles::of(values).map_or(0.0, |values| values.p50);
        let limit = match self.streamer.pixel_error_limit() {
            PixelErrorLimit::Asked if self.rounding_px() > self.pixel_error() => Some(
                "the scene's position grid (ingest --position-step) shows more this near"
                    .to_owned(),
            ),
            PixelErrorLimit::Asked => self.report.pixel_error_limit.clone(),
            PixelErrorLimit::Pool {
                wanted_pages,
                slots,
            } => Some(format!(
                "{wanted_pages} pages wanted, {slots} slots in the pool"
            )),
        };
        Report {
            frames: self.frames,
            requests: stats.fetches,
            pages_fetched: stats.pages_fetched,
            bytes_fetched: self.bytes_fetched(),
            pages_resident: stats.pages_resident,
            pages_evicted: stats.pages_evicted,
            pool_bytes: self.renderer.pool().bytes(),
            drawn: self.last_counters.as_ref().map(Drawn::from),
            pixel_error_shown: self.pixel_error_shown() as f64,
            pixel_error_asked: stats.pixel_error_asked as f64,
            pixel_error_limit: limit,
            gpu_ms: self
                .gpu_ms
                .iter()
                .map(|(&pass, values)| (pass, median(values)))
                .collect(),
            frame_ms: Percentiles::of(&self.frame_ms),
            adapter: self.renderer.gpu.name.clone(),
            visbuffer: self.renderer.target().name(),
            passes_recorded: self.renderer.passes_recorded(),
            pipelines_built: self.renderer.pipelines_built(),
            ..self.report.clone()
        }
    }

    /// The error of a view that did not settle.
    pub fn not_settled(&self, timeout: Duration) -> ClientError {
        let stats = self.streamer.stats();
        let last = stats.last_failure.map_or(String::new(), |failure| {
            format!("; last failure: {failure}")
        });
        ClientError::NotSettled {
            scene: self.scene_name.clone(),
            timeout_secs: timeout.as_secs_f64(),
            found: format!(
                "{} of {} pages missing{last}",
                stats.pages_missing, stats.pages_wanted
            ),
        }
    }
}

/// Appends to the last [`MOST_TIMES`] values: a window may stay open for days.
fn keep(values: &mut Vec<f64>, value: f64) {
    if values.len() >= MOST_TIMES {
        values.drain(..MOST_TIMES / 2);
    }
    values.push(value);
}
