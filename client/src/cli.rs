//! The command line. Exit 0 on success, 1 on a failed operation with one line on standard error, 2 on wrong usage.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::{Args, Parser, Subcommand, ValueEnum};
use lodestream_client::camera::Pose;
use lodestream_client::error::ClientError;
use lodestream_client::opening::SessionOptions;
use lodestream_client::play::{PlayOptions, play};
use lodestream_client::render::{RenderOptions, render};
use lodestream_client::report::Report;
use lodestream_client::stream::{StreamLimits, Transport};
use lodestream_client::view::{ViewOptions, view};
use lodestream_shaders::VisbufferTarget;
use lodestream_shaders::types::ShadeMode;

/// Streams scenes of a Lodestream library and draws them.
#[derive(Debug, Parser)]
#[command(name = "lodestream-client", version, about)]
struct Cli {
    /// Print nothing but errors.
    #[arg(long, global = true)]
    quiet: bool,
    /// Tell more; twice tells everything.
    #[arg(short, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Wait until the view is settled, then write the picture.
    Render(RenderArgs),
    /// Play a camera path at fixed steps.
    Play(PlayArgs),
    /// Open a window.
    View(ViewArgs),
}

#[derive(Debug, Args)]
struct SceneArgs {
    /// http(s)://… or a library folder.
    url: String,
    /// Pixels by which the picture may differ from full detail.
    #[arg(long, value_name = "PX", default_value_t = 1.0, value_parser = positive)]
    pixel_error: f32,
    /// MiB of the page pool [default: 256, or what the adapter or the scene has].
    #[arg(long, value_name = "MiB", value_parser = positive)]
    pool: Option<f32>,
    /// MiB of memory that opening the scene may take.
    #[arg(long, value_name = "MiB", default_value_t = 4096.0, value_parser = positive)]
    open_memory: f32,
    /// MiB that all textures may take; beyond it they are shown coarser.
    #[arg(long, value_name = "MiB", default_value_t = 1024.0, value_parser = positive)]
    texture_memory: f32,
    /// What the picture shows.
    #[arg(long, value_enum, default_value_t = Mode::Shaded)]
    mode: Mode,
    /// Rasterizer of small clusters: auto and compute take compute, hardware draws all by hardware
    /// (key R in the window).
    #[arg(long, value_enum, default_value_t = Rasterizer::Auto)]
    raster: Rasterizer,
    /// Way to the visibility buffer: 64-bit atomics, two rounds of 32-bit ones, or attachments of
    /// the hardware rasterizer; auto takes u64 where the adapter has it, else two-round.
    #[arg(long, value_enum, default_value_t = Visbuffer::Auto)]
    visbuffer: Visbuffer,
    /// Draw hidden geometry too (key O in the window).
    #[arg(long)]
    no_occlusion: bool,
    /// Part of the name of the graphics adapter to use.
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// How pages are asked for.
    #[arg(long, value_enum, default_value_t = By::Get)]
    transport: By,
    /// Write a JSON report.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct RenderArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// The scene's name.
    #[arg(long = "scene", value_name = "NAME")]
    name: String,
    /// eye=x,y,z;target=x,y,z;up=x,y,z;fov=DEG [default: frames the whole scene].
    #[arg(long)]
    camera: Option<Pose>,
    /// Size of the picture, pixels.
    #[arg(long, value_name = "WxH", default_value = "960x540", value_parser = size)]
    size: [u32; 2],
    /// Full detail: no culling, no level of detail.
    #[arg(long)]
    reference: bool,
    /// The picture.
    #[arg(long, value_name = "FILE.png")]
    out: PathBuf,
    /// Write the view-space depth, metres, 0 where nothing was hit.
    #[arg(long, value_name = "FILE.pfm")]
    depth: Option<PathBuf>,
    /// Write the triangles of the chosen cut, in world space.
    #[arg(long, value_name = "FILE.ply", conflicts_with = "reference")]
    cut: Option<PathBuf>,
    /// Longest wait for pages.
    #[arg(long, value_name = "SECS", default_value_t = 300.0, value_parser = seconds)]
    timeout_secs: f64,
    /// Pictures drawn; more than one for timing.
    #[arg(long, value_name = "N", default_value_t = 1)]
    repeat: u32,
}

#[derive(Debug, Args)]
struct PlayArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// The scene's name.
    #[arg(long = "scene", value_name = "NAME")]
    name: String,
    /// The camera path.
    #[arg(long, value_name = "FILE.json")]
    path: PathBuf,
    /// Write every frame's picture into this folder.
    #[arg(long, value_name = "DIR")]
    frames: Option<PathBuf>,
    /// Write every frame's streaming requests, a JSON object a line.
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Keep pace with the clock instead of waiting for each frame's pages.
    #[arg(long)]
    realtime: bool,
    /// Longest wait for one frame's pages.
    #[arg(long, value_name = "SECS", default_value_t = 30.0, value_parser = seconds)]
    settle_secs_per_frame: f64,
}

#[derive(Debug, Args)]
struct ViewArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// The scene's name [default: the library's first].
    #[arg(long = "scene", value_name = "NAME")]
    name: Option<String>,
    /// eye=x,y,z;target=x,y,z;up=x,y,z;fov=DEG [default: frames the whole scene].
    #[arg(long)]
    camera: Option<Pose>,
    /// Size of the window, pixels.
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    size: [u32; 2],
    /// Close after so many frames.
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
    /// Write the last frame before closing.
    #[arg(long, value_name = "FILE.png")]
    screenshot: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Mode {
    Shaded,
    Triangles,
    Clusters,
    Groups,
    Levels,
    Pages,
    Depth,
    Normals,
    Overdraw,
    Raster,
    Materials,
    Instances,
}

impl From<Mode> for ShadeMode {
    fn from(mode: Mode) -> Self {
        match mode {
            Mode::Shaded => Self::Shaded,
            Mode::Triangles => Self::Triangles,
            Mode::Clusters => Self::Clusters,
            Mode::Groups => Self::Groups,
            Mode::Levels => Self::Levels,
            Mode::Pages => Self::Pages,
            Mode::Depth => Self::Depth,
            Mode::Normals => Self::Normals,
            Mode::Overdraw => Self::Overdraw,
            Mode::Raster => Self::Raster,
            Mode::Materials => Self::Materials,
            Mode::Instances => Self::Instances,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Rasterizer {
    Auto,
    Hardware,
    Compute,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Visbuffer {
    Auto,
    U64,
    TwoRound,
    Attachment,
}

impl From<Visbuffer> for Option<VisbufferTarget> {
    fn from(visbuffer: Visbuffer) -> Self {
        match visbuffer {
            Visbuffer::Auto => None,
            Visbuffer::U64 => Some(VisbufferTarget::U64),
            Visbuffer::TwoRound => Some(VisbufferTarget::TwoRound),
            Visbuffer::Attachment => Some(VisbufferTarget::Attachment),
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum By {
    Get,
    Post,
}

fn positive(text: &str) -> Result<f32, String> {
    let value: f32 = text.parse().map_err(|_| "expected a number".to_owned())?;
    match value > 0.0 && value.is_finite() {
        true => Ok(value),
        false => Err("expected a number above 0".to_owned()),
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "expected a number".to_owned())?;
    match (0.0..=1e9).contains(&value) {
        true => Ok(value),
        false => Err("expected 0 to 1e9 seconds".to_owned()),
    }
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let wrong = || "expected WIDTHxHEIGHT, each 1 to 16384".to_owned();
    let (width, height) = text.split_once('x').ok_or_else(wrong)?;
    let axis = |text: &str| {
        let value: u32 = text.parse().ok()?;
        (1..=16_384).contains(&value).then_some(value)
    };
    Ok([
        axis(width).ok_or_else(wrong)?,
        axis(height).ok_or_else(wrong)?,
    ])
}

fn bytes(mib: f32) -> u64 {
    (mib as f64 * (1u64 << 20) as f64) as u64
}

impl SceneArgs {
    fn options(&self, scene: &str, size_px: [u32; 2]) -> SessionOptions {
        SessionOptions {
            size_px,
            pixel_error_px: self.pixel_error,
            pool_bytes: self.pool.map(bytes),
            limits: StreamLimits {
                open_memory_bytes: bytes(self.open_memory),
                ..StreamLimits::default()
            },
            texture_memory_bytes: bytes(self.texture_memory),
            mode: self.mode.into(),
            occlusion: !self.no_occlusion,
            compute_raster: !matches!(self.raster, Rasterizer::Hardware),
            visbuffer: self.visbuffer.into(),
            adapter: self.adapter.clone(),
            transport: match self.transport {
                By::Get => Transport::Get,
                By::Post => Transport::Post,
            },
            ..SessionOptions::new(&self.url, scene)
        }
    }
}

/// Parses the arguments, runs the command, tells how it went.
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    log(cli.quiet, cli.verbose);
    let outcome = match &cli.command {
        Command::Render(args) => run_render(args),
        Command::Play(args) => run_play(args),
        Command::View(args) => run_view(args),
    };
    match outcome {
        Ok(report) => {
            if !cli.quiet {
                summarize(&report);
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("lodestream-client: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run_render(args: &RenderArgs) -> Result<Report, ClientError> {
    render(&RenderOptions {
        session: args.scene.options(&args.name, args.size),
        camera: args.camera,
        reference: args.reference,
        timeout: Duration::from_secs_f64(args.timeout_secs),
        repeat: args.repeat,
        out: args.out.clone(),
        depth: args.depth.clone(),
        cut: args.cut.clone(),
        report: args.scene.report.clone(),
    })
}

fn run_play(args: &PlayArgs) -> Result<Report, ClientError> {
    play(&PlayOptions {
        session: args.scene.options(&args.name, [1, 1]),
        path: args.path.clone(),
        frames: args.frames.clone(),
        trace: args.trace.clone(),
        report: args.scene.report.clone(),
        realtime: args.realtime,
        settle: Duration::from_secs_f64(args.settle_secs_per_frame),
    })
}

fn run_view(args: &ViewArgs) -> Result<Report, ClientError> {
    view(ViewOptions {
        session: args
            .scene
            .options(args.name.as_deref().unwrap_or(""), args.size),
        camera: args.camera,
        frames: args.frames,
        screenshot: args.screenshot.clone(),
        report: args.scene.report.clone(),
    })
}

/// Warnings of the libraries by default, nothing with `--quiet`; `RUST_LOG` overrides both.
fn log(quiet: bool, verbose: u8) {
    let default = match (quiet, verbose) {
        (true, _) => "off",
        (_, 0) => "warn,wgpu_hal=error,wgpu_core=error",
        (_, 1) => "info,wgpu_hal=warn,wgpu_core=warn",
        _ => "debug,wgpu_hal=info,wgpu_core=info,naga=info",
    };
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new(default));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .without_time()
        .init();
}

fn summarize(report: &Report) {
    for warning in &report.warnings {
        tracing::info!("{warning}");
    }
    if !report.warnings.is_empty() {
        eprintln!(
            "{} warnings; -v and --report tell them",
            report.warnings.len()
        );
    }
    let drawn = report.drawn.unwrap_or_default();
    println!(
        "{}: {} triangles in {} clusters of {} instances at {:.2} px; {} pages, {} bytes fetched; {}",
        report.scene,
        drawn.triangles,
        drawn.clusters,
        drawn.instances,
        report.pixel_error_shown,
        report.pages_fetched,
        report.bytes_fetched,
        report.adapter
    );
}
