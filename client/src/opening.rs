//! A scene opened from a library: what a session and a reference begin with.

use std::sync::Arc;
use std::time::Instant;

use futures_util::StreamExt;
use lodestream_format::limits::PAGE_BYTES;
use lodestream_shaders::types::{NO_TEXTURE, ShadeMode, material_flag};
use lodestream_shaders::{SceneArrays, VisbufferTarget};

use crate::error::ClientError;
use crate::gpu::{self, Gpu, Renderer, TextureUpload};
use crate::images::{self, DEFAULT_TEXTURE_MEMORY_BYTES};
use crate::report::Report;
use crate::stream::{MIN_SLOTS, OpenedScene, Source, StreamError, StreamLimits, Transport};
use crate::subject::Subject;

/// Bytes of the page pool unless asked otherwise.
pub const DEFAULT_POOL_BYTES: u64 = 256 << 20;
/// Texture objects fetched at a time.
const TEXTURE_FETCHES: usize = 8;

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
    /// Whether hidden geometry is culled.
    pub occlusion: bool,
    /// Whether small clusters go to the compute rasterizer, or all to the hardware.
    pub compute_raster: bool,
    /// Way from the rasterizers to the visbuffer; without it the best that the adapter has.
    pub visbuffer: Option<VisbufferTarget>,
    /// Whether hidden pages are fetched, after all visible ones: for cameras that move.
    pub fetches_hidden: bool,
    /// Part of the name of the adapter to use.
    pub adapter: Option<String>,
    /// How pages are asked for.
    pub transport: Transport,
    /// Bounds on what the library may cost.
    pub limits: StreamLimits,
    /// Most bytes of all textures.
    pub texture_memory_bytes: u64,
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
            occlusion: true,
            compute_raster: true,
            visbuffer: None,
            fetches_hidden: false,
            adapter: None,
            transport: Transport::default(),
            limits: StreamLimits::default(),
            texture_memory_bytes: DEFAULT_TEXTURE_MEMORY_BYTES,
            readback_updates: 2,
        }
    }
}

/// A scene opened from a library: what a session and a reference begin with.
pub struct Opening {
    /// Where pages and textures come from.
    pub source: Source,
    /// The scene.
    pub scene: Arc<OpenedScene>,
    /// Its arrays.
    pub arrays: Arc<SceneArrays>,
    /// The part of it that is framed unless another camera is asked for.
    pub subject: Arc<Subject>,
    /// Where fetches run.
    pub runtime: tokio::runtime::Runtime,
    /// Seconds that it took.
    pub secs: f64,
}

impl Opening {
    /// Connects and opens.
    pub fn new(options: &SessionOptions) -> Result<Self, ClientError> {
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
        let source = Source::connect_within(&options.location, &options.limits)?;
        let opened = runtime.block_on(source.open(&options.scene))?;
        let assets = opened
            .assets
            .iter()
            .map(|used| (&used.asset, &used.hierarchy));
        let arrays = SceneArrays::new(&opened.scene, assets);
        Ok(Self {
            source,
            scene: Arc::new(opened),
            subject: Arc::new(Subject::new(&arrays)),
            arrays: Arc::new(arrays),
            runtime,
            secs: start.elapsed().as_secs_f64(),
        })
    }

    /// Fetches and uploads the textures that pictures of the mode look at; the rest stays away.
    /// Says so in `report`.
    pub fn load_textures(
        &self,
        renderer: &mut Renderer,
        options: &SessionOptions,
        report: &mut Report,
    ) -> Result<(), ClientError> {
        let materials = &self.arrays.materials;
        let looked_at = |masked_only: bool| {
            materials.iter().any(|material| {
                material.texture != NO_TEXTURE
                    && (!masked_only || material.flags & material_flag::MASK != 0)
            })
        };
        if !looked_at(options.mode != ShadeMode::Shaded) {
            return Ok(());
        }
        let textures = &self.scene.scene.textures;
        let admitted = images::admitted(textures.iter(), options.limits.open_memory_bytes);
        let memory_bytes = options.texture_memory_bytes;
        let mut upload =
            TextureUpload::new(&renderer.gpu, textures, &admitted, materials, memory_bytes)?;
        let shown = admitted.iter().enumerate().filter(|(_, it)| it.is_ok());
        let fetches = shown.map(|(index, _)| {
            let (source, texture) = (self.source.clone(), textures[index].clone());
            // A task of its own goes on while others are decoded.
            let fetch = async move { source.object(&texture.object, texture.bytes).await };
            let task = self.runtime.spawn(fetch);
            async move { (index, task.await) }
        });
        let mut files = futures_util::stream::iter(fetches).buffered(TEXTURE_FETCHES);
        while let Some((index, file)) = self.runtime.block_on(files.next()) {
            let file = file.map_err(|error| StreamError::Setting {
                setting: "fetch of a texture",
                expected: "an end".to_owned(),
                found: error.to_string(),
            })??;
            report.texture_bytes_fetched += file.len() as u64;
            upload.put(index, &file)?;
        }
        let layout = upload.finish(renderer)?;
        report.texture_bytes = layout.words as u64 * 4;
        report.texture_mips_left_out = layout.dropped_mips.iter().sum();
        report.warnings.extend(layout.notes);
        Ok(())
    }
}

/// Bytes of the pool: what was asked for as it is; else the default, or fewer where the adapter or the scene has less.
pub(crate) fn pool_bytes(
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
