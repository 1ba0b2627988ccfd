//! A viewer without a window: a scene opened from a library, its streamer and its renderer, frame by frame.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use futures_util::StreamExt;
use lodestream_format::limits::PAGE_BYTES;
use lodestream_shaders::SceneArrays;
use lodestream_shaders::cpu::Camera;
use lodestream_shaders::types::{Counters, NO_TEXTURE, ShadeMode, View, material_flag};

use crate::camera::near_metres;
use crate::error::ClientError;
use crate::gpu::{self, FrameResult, Gpu, GpuError, PageUpload, Renderer, TextureBytes, Work};
use crate::report::{Drawn, Percentiles, Report};
use crate::stream::{
    Changes, MIN_SLOTS, OpenedScene, PixelErrorLimit, ResidencyConfig, Source, Streamer,
    StreamingRequest, Transport,
};

/// Bytes of the page pool unless asked otherwise.
pub const DEFAULT_POOL_BYTES: u64 = 256 << 20;
/// Texture objects fetched at a time.
const TEXTURE_FETCHES: usize = 8;
/// Longest sleep for an arrival before the view is looked at again.
const ARRIVAL_WAIT: Duration = Duration::from_millis(20);
/// Most frame times kept.
const MOST_TIMES: usize = 1 << 14;
/// Step by which the pixel error rises when the adapter cannot hold a frame's queues.
const QUEUE_RAISE: f32 = 1.25;
/// Pixel error past which a scene whose queues still do not fit is given up: it is coarser than any picture is large.
const MOST_PIXEL_ERROR: f32 = 1e6;

/// What a session is opened with.
#[derive(Debug, Clone)]
pub struct SessionOptions {
    /// `http(s)://…` or a library folder.
    pub location: String,
    /// The scene's name.
    pub scene: String,
    /// Width and height of the picture, pixels.
    pub size_px: [u32; 2],
    /// Pixel error asked for.
    pub pixel_error_px: f32,
    /// Bytes of the page pool; without it as many as are usual, or fewer where the adapter or the scene has less.
    pub pool_bytes: Option<u64>,
    /// What the picture shows.
    pub mode: ShadeMode,
    /// Part of the name of the adapter to use.
    pub adapter: Option<String>,
    /// How pages are asked for.
    pub transport: Transport,
    /// Updates between a request's frame and its readback, at least: more for frames that are not waited for.
    pub readback_updates: u32,
}

impl SessionOptions {
    /// Defaults for a scene of a library.
    pub fn new(location: &str, scene: &str) -> Self {
        Self {
            location: location.to_owned(),
            scene: scene.to_owned(),
            size_px: [960, 540],
            pixel_error_px: 1.0,
            pool_bytes: None,
            mode: ShadeMode::Shaded,
            adapter: None,
            transport: Transport::default(),
            readback_updates: 2,
        }
    }
}

/// See the module.
pub struct Session {
    /// The renderer.
    pub renderer: Renderer,
    /// The streamer.
    pub streamer: Streamer,
    scene_name: String,
    mode: ShadeMode,
    near_metres: f32,
    /// Least pixel error that the adapter's queues can hold.
    queue_pixel_error: f32,
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

/// A scene opened from a library: what a session and a reference begin with.
pub struct Opening {
    /// Where pages and textures come from.
    pub source: Source,
    /// The scene.
    pub scene: Arc<OpenedScene>,
    /// Its arrays.
    pub arrays: Arc<SceneArrays>,
    /// Where fetches run.
    pub runtime: tokio::runtime::Runtime,
    /// Seconds that it took.
    pub secs: f64,
}

impl Opening {
    /// Connects and opens.
    pub fn new(location: &str, scene: &str) -> Result<Self, ClientError> {
        let start = Instant::now();
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .enable_all()
            .build()
            .map_err(|error| ClientError::Setting {
                at: "threads".to_owned(),
                expected: "two worker threads".to_owned(),
                found: error.to_string(),
            })?;
        let source = Source::connect(location)?;
        let opened = runtime.block_on(source.open(scene))?;
        let assets = opened
            .assets
            .iter()
            .map(|used| (&used.asset, &used.hierarchy));
        let arrays = SceneArrays::new(&opened.scene, assets);
        Ok(Self {
            source,
            scene: Arc::new(opened),
            arrays: Arc::new(arrays),
            runtime,
            secs: start.elapsed().as_secs_f64(),
        })
    }

    /// Fetches and uploads the textures that pictures of `mode` look at; the rest stays away. Says so in `report`.
    pub fn load_textures(
        &self,
        renderer: &mut Renderer,
        mode: ShadeMode,
        report: &mut Report,
    ) -> Result<(), ClientError> {
        let materials = &self.arrays.materials;
        let looked_at = |masked_only: bool| {
            materials.iter().any(|material| {
                material.texture != NO_TEXTURE
                    && (!masked_only || material.flags & material_flag::MASK != 0)
            })
        };
        if !looked_at(mode != ShadeMode::Shaded) {
            return Ok(());
        }
        let textures = &self.scene.scene.textures;
        let fetches = textures
            .iter()
            .map(|texture| self.source.object(&texture.object));
        let fetches = futures_util::stream::iter(fetches).buffered(TEXTURE_FETCHES);
        let bytes: Vec<Result<Bytes, _>> = self.runtime.block_on(fetches.collect());
        let bytes = bytes.into_iter().collect::<Result<Vec<_>, _>>()?;
        report.texture_bytes_fetched = bytes.iter().map(|bytes| bytes.len() as u64).sum();
        let pairs: Vec<_> = textures
            .iter()
            .zip(&bytes)
            .map(|(texture, bytes)| TextureBytes { texture, bytes })
            .collect();
        let layout = renderer.upload_textures(&pairs)?;
        report.texture_bytes = layout.words as u64 * 4;
        report.texture_mips_left_out = layout.dropped_mips.iter().sum();
        report.warnings.extend(layout.notes);
        Ok(())
    }
}

impl Session {
    /// Opens the scene on the best adapter.
    pub fn open(options: &SessionOptions) -> Result<Self, ClientError> {
        let (gpu, _) = Gpu::open(&gpu::instance(), options.adapter.as_deref(), None)?;
        Self::on(&gpu, options)
    }

    /// Opens the scene on a device that exists.
    pub fn on(gpu: &Gpu, options: &SessionOptions) -> Result<Self, ClientError> {
        let opening = Opening::new(&options.location, &options.scene)?;
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
        opening.load_textures(&mut renderer, options.mode, &mut report)?;
        let mut session = Self {
            near_metres: near_metres(&opening.arrays),
            renderer,
            streamer,
            scene_name: options.scene.clone(),
            mode: options.mode,
            queue_pixel_error: 0.0,
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
            let requests: Vec<_> = result
                .requests
                .iter()
                .map(|request| StreamingRequest {
                    page: request.page,
                    priority_px: request.priority_px,
                })
                .collect();
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

    /// One frame that only asks for pages, waited for. Returns its requests, once it is whole.
    pub fn request_pages(&mut self, camera: &Camera) -> Result<Vec<StreamingRequest>, ClientError> {
        loop {
            let view = self.view(camera);
            self.renderer.draw(&view, Work::Requests)?;
            self.frames += 1;
            let results = self.renderer.collect(true)?;
            let requests = results.last().map_or(Vec::new(), |last| {
                let of = |request: &lodestream_shaders::types::RequestRecord| StreamingRequest {
                    page: request.page,
                    priority_px: request.priority_px,
                };
                last.requests.iter().map(of).collect()
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
                return Ok(true);
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
            pixel_error_shown: self.pixel_error() as f64,
            pixel_error_asked: stats.pixel_error_asked as f64,
            pixel_error_limit: limit,
            gpu_ms: self
                .gpu_ms
                .iter()
                .map(|(&pass, values)| (pass, median(values)))
                .collect(),
            frame_ms: Percentiles::of(&self.frame_ms),
            adapter: self.renderer.gpu.name.clone(),
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

/// Bytes of the pool: what was asked for as it is; else the default, or fewer where the adapter or the scene has less.
fn pool_bytes(
    gpu: &Gpu,
    scene: &OpenedScene,
    asked: Option<u64>,
    warnings: &mut Vec<String>,
) -> u64 {
    let entries = scene.assets.iter().flat_map(|used| &used.asset.pages);
    // Every page in a slot of its own, roots counted too: more than that is never filled.
    let whole = (entries.count() as u64 + MIN_SLOTS as u64) * PAGE_BYTES as u64;
    let wanted = asked.unwrap_or_else(|| {
        let most = gpu::max_bytes(gpu);
        if most < DEFAULT_POOL_BYTES {
            warnings.push(format!(
                "page pool of {most} bytes instead of {DEFAULT_POOL_BYTES}: {} binds no more",
                gpu.name
            ));
        }
        DEFAULT_POOL_BYTES.min(most)
    });
    wanted.min(whole)
}
