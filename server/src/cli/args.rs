//! Subcommands and options.

use std::path::PathBuf;

use clap::{ArgAction, Args, Parser, Subcommand};
use lodestream_format::frame::Codec;

use super::config;
use super::values::{self, Step};
use crate::build::Placement;
use crate::http::DEFAULT_CACHE_BYTES;
use crate::import::MAX_IMAGE_PIXELS;
use crate::library::Replaces;

/// Model files become scenes in a library, and HTTP serves them.
#[derive(Debug, Parser)]
#[command(version, about)]
pub(super) struct Cli {
    #[command(subcommand)]
    pub command: Command,
    /// Say more on standard error; twice for still more.
    #[arg(short, long, global = true, action = ArgAction::Count)]
    pub verbose: u8,
    /// Say nothing but errors and what was asked for.
    #[arg(short, long, global = true)]
    pub quiet: bool,
    /// Write the log as JSON, an object a line.
    #[arg(long, global = true, env = "LODESTREAM_LOG_JSON", num_args = 0..=1, default_missing_value = "true", default_value_t = false, action = ArgAction::Set)]
    pub log_json: bool,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Build a scene from model files and publish it; what the library holds already is not built again.
    #[command(after_help = JOBS_HELP)]
    Ingest(IngestArgs),
    /// Serve a library over HTTP/1.1 and HTTP/2 on one port, in cleartext or over TLS.
    #[command(args_override_self = true)]
    Serve(ServeArgs),
    /// List the scenes.
    List(ListArgs),
    /// Show what a scene holds.
    Show(ShowArgs),
    /// Take a scene's name away; its objects stay until gc.
    Remove(SceneArgs),
    /// Remove objects that no scene needs, and staged files of killed writers.
    Gc(GcArgs),
    /// Copy scenes to another library; sends only objects that are missing or damaged there.
    Copy(CopyArgs),
    /// Re-hash and re-parse everything; exit 1 on any fault.
    Verify(VerifyArgs),
    /// Write a crack-free cut of a scene as plain meshes.
    Export(ExportArgs),
}

/// How an ingest is spread over machines.
const JOBS_HELP: &str = "\
On many machines that share the library and the inputs:
  ingest INPUT... --library LIB --scene NAME --plan --jobs 8
  ingest --library LIB --scene NAME --job I      for each I of 0 to 7, in any order, at once, again after a failure
  ingest --library LIB --scene NAME --finish     publishes what a plain ingest would; needs no inputs
The second line as jobs:
  GNU parallel   parallel -q lodestream-server ingest --library LIB --scene NAME --job {} ::: $(seq 0 7)
  Slurm          sbatch --array=0-7 --wrap 'lodestream-server ingest --library LIB --scene NAME --job auto'
  Kubernetes     completionMode: Indexed, completions: 8, the same command with --job auto
The plan and what is built lie in the library. gc leaves them while the last job started within its grace period.";

/// Options of `ingest`.
#[derive(Debug, Args)]
pub(super) struct IngestArgs {
    /// .glb, .gltf, .obj, .ply or .stl files; several make one scene. With --job only where they lie elsewhere than the plan says, all of them in
    /// its order.
    #[arg(required_unless_present_any = ["job", "finish"], value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// Folder (made where there is none), or memory:// for a trial that keeps nothing.
    #[arg(long, value_name = "LIB")]
    pub library: String,
    /// Name to publish under: 1 to 200 of A-Z a-z 0-9 . _ -, a letter or digit first.
    #[arg(long, value_name = "NAME", value_parser = values::scene_name)]
    pub scene: String,
    /// Threads of the build; all cores by default. The result does not depend on it.
    #[arg(long, value_name = "N", value_parser = values::threads)]
    pub threads: Option<usize>,
    /// Stay below this much memory: large meshes are read in pieces and built through the disk. Bytes, or a number with KiB,
    /// MiB, GiB, kB, MB, GB. The result does not depend on it, but that a mesh read in pieces gets no normals where it has none.
    #[arg(long, value_name = "BYTES", value_parser = values::bytes)]
    pub memory_limit: Option<u64>,
    /// Folder for what does not fit memory; the system's folder for temporary files by default.
    #[arg(long, value_name = "DIR")]
    pub scratch: Option<PathBuf>,
    /// Step of the position grid, rounded down to a power of two.
    #[arg(long, value_name = "auto|METRES", default_value = "auto", value_parser = values::step, allow_negative_numbers = true)]
    pub position_step: Step,
    /// Where vertices of coarser levels lie: optimal (fewest triangles for an error) or subset (on source vertices).
    #[arg(long, value_name = "PLACEMENT", default_value = "optimal")]
    pub placement: Placement,
    /// Compression of the pages: zstd, lz4 or none.
    #[arg(long, value_name = "CODEC", default_value = "zstd", value_parser = values::codec)]
    pub codec: Codec,
    /// Build also the meshes that the library holds already, built with the same options.
    #[arg(long)]
    pub rebuild: bool,
    /// Reuse stored objects on their length alone. By default they are read and hashed, and
    /// damaged ones are built anew.
    #[arg(long, conflicts_with = "rebuild")]
    pub trust_lengths: bool,
    /// Only store a plan, under the scene's name, that deals the meshes to --jobs jobs; build and publish nothing.
    #[arg(long, requires = "jobs", conflicts_with_all = ["job", "finish", "rebuild"])]
    pub plan: bool,
    /// Jobs of the plan, at most 65536.
    #[arg(long, value_name = "K", requires = "plan", value_parser = clap::value_parser!(u32).range(1..=65536), allow_negative_numbers = true)]
    pub jobs: Option<u32>,
    /// Refuse inputs with more triangles, each mesh counted once.
    #[arg(long, value_name = "N", conflicts_with_all = ["job", "finish"])]
    pub max_triangles: Option<u64>,
    /// Publish a scene also where the inputs hold no triangle; refused by default, since the file
    /// may be the wrong one.
    #[arg(long, conflicts_with_all = ["job", "finish"])]
    pub allow_empty: bool,
    /// Open no file but the inputs: refuse geometry in other files, leave out their images and
    /// materials.
    #[arg(long, conflicts_with = "finish")]
    pub self_contained: bool,
    /// Leave out images of more pixels, width times height, than this; all images of an input may
    /// have 16 times as many.
    #[arg(long, value_name = "N", default_value_t = MAX_IMAGE_PIXELS, conflicts_with_all = ["job", "finish"])]
    pub max_image_pixels: u64,
    /// Publish only if the name still points at this scene (its hash, as show and PUT tell it), or at none; fails otherwise.
    #[arg(long, value_name = "SCENE|none", default_value = "anything", hide_default_value = true, value_parser = values::replaces, conflicts_with_all = ["plan", "job", "finish"])]
    pub replaces: Replaces,
    /// Tell progress as lines of JSON on standard output.
    #[arg(long)]
    pub progress_json: bool,
    /// Give up all rights before the input is opened: more private memory than BYTES, the network
    /// (but for a library on S3), other programs, and all files but the inputs' folders, the
    /// library, the scratch folder and the report. Linux only.
    #[arg(long, value_name = "BYTES", value_parser = values::bytes)]
    pub confine: Option<u64>,
    /// End when standard input ends: for a program that starts this one and may be killed.
    #[arg(long)]
    pub end_with_stdin: bool,
    /// Build the meshes of one job of the plan, from 0; auto takes SLURM_ARRAY_TASK_ID or JOB_COMPLETION_INDEX.
    #[arg(long, value_name = "I|auto", value_parser = values::job, allow_negative_numbers = true, conflicts_with_all = ["finish", "position_step", "placement", "codec"])]
    pub job: Option<u32>,
    /// Publish the planned scene once all its jobs are done; names those that are not.
    #[arg(long, conflicts_with_all = ["inputs", "rebuild", "threads", "memory_limit", "scratch", "position_step", "placement", "codec"])]
    pub finish: bool,
    /// Write what was done as JSON.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    #[command(flatten)]
    pub private: PrivateArgs,
}

/// File modes of the library.
#[derive(Debug, Args)]
pub(super) struct PrivateArgs {
    /// Let no other user of this machine read the library: new files and folders get modes 0600
    /// and 0700, its root folder 0700.
    #[arg(
        long,
        env = "LODESTREAM_PRIVATE",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "true",
        default_value_t = false,
        action = ArgAction::Set
    )]
    pub private: bool,
}

/// Options of `serve`.
#[derive(Debug, Args)]
pub(super) struct ServeArgs {
    /// Folder of the library.
    #[arg(long, env = "LODESTREAM_LIBRARY", value_name = "LIB")]
    pub library: String,
    /// Address and port; port 0 takes any free one.
    #[arg(
        long,
        env = "LODESTREAM_LISTEN",
        value_name = "ADDR",
        default_value = "127.0.0.1:7878"
    )]
    pub listen: String,
    /// Threads that answer; all cores by default.
    #[arg(long, env = "LODESTREAM_THREADS", value_name = "N", value_parser = values::threads)]
    pub threads: Option<usize>,
    /// Most bytes of pages and page tables kept in memory, of which tables may take 8MiB at least; units as in 256MiB.
    #[arg(long, env = "LODESTREAM_CACHE_BYTES", value_name = "BYTES", default_value_t = DEFAULT_CACHE_BYTES as u64, value_parser = values::bytes)]
    pub cache_bytes: u64,
    /// Most requests a second of one client (an address); more are answered with 429
    #[arg(long, env = "LODESTREAM_CLIENT_REQUESTS", value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub client_requests: Option<u32>,
    /// Most connections of one client at once; beyond them its longest idle one goes, or else the
    /// new one. By default three quarters of all connections, which are as many as the system has
    /// open files for (ulimit -Hn), 16384 at most.
    #[arg(long, env = "LODESTREAM_CLIENT_CONNECTIONS", value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub client_connections: Option<u32>,
    /// Web pages of these origins alone may show answers (https://viewer.example), several with
    /// commas between; those of all by default.
    #[arg(
        long = "cors-origin",
        env = "LODESTREAM_CORS_ORIGINS",
        value_name = "ORIGIN",
        value_delimiter = ','
    )]
    pub cors_origins: Vec<String>,
    /// Have /metrics on this address and port alone, with the names of all scenes, and not where
    /// the library is served.
    #[arg(long, env = "LODESTREAM_METRICS_LISTEN", value_name = "ADDR")]
    pub metrics_listen: Option<String>,
    /// Tokens of readers: lines of TOKEN SCENE..., where a scene may end with *. Scenes on no line
    /// are open to all. Read again when it changes, and on SIGHUP.
    #[arg(long, value_name = "FILE", env = "LODESTREAM_READ_TOKENS")]
    pub read_tokens: Option<PathBuf>,
    /// Log every request on standard error.
    #[arg(long, env = "LODESTREAM_ACCESS_LOG", num_args = 0..=1, default_missing_value = "true", default_value_t = false, action = ArgAction::Set)]
    pub access_log: bool,
    /// Options of this command as lines of TOML (`listen = "0.0.0.0:80"`); what the command line or the environment says counts instead.
    #[arg(long, value_name = "FILE", env = config::ENV)]
    pub config: Option<PathBuf>,
    /// Take models (PUT /v1/scenes/NAME) by the tokens of this file: lines as of --read-tokens. A
    /// token alone is for all scenes that --read-tokens does not name. Read again as that file is.
    #[arg(long, env = "LODESTREAM_UPLOAD_TOKENS", value_name = "FILE")]
    pub upload_tokens: Option<PathBuf>,
    /// Largest model that is taken.
    #[arg(long, env = "LODESTREAM_UPLOAD_BYTES", value_name = "BYTES", default_value = "4GiB", value_parser = values::bytes, requires = "upload_tokens")]
    pub upload_bytes: u64,
    /// Most triangles of a model.
    #[arg(
        long,
        env = "LODESTREAM_UPLOAD_TRIANGLES",
        value_name = "N",
        default_value_t = 200_000_000,
        requires = "upload_tokens"
    )]
    pub upload_triangles: u64,
    /// Most seconds that a model is built for.
    #[arg(
        long,
        env = "LODESTREAM_UPLOAD_SECS",
        value_name = "SECONDS",
        default_value_t = 3600,
        requires = "upload_tokens"
    )]
    pub upload_secs: u64,
    /// Most private memory that a build takes; the system stops a build that asks for more.
    #[arg(long, env = "LODESTREAM_UPLOAD_MEMORY", value_name = "BYTES", default_value = "1GiB", value_parser = values::bytes, requires = "upload_tokens")]
    pub upload_memory: u64,
    /// Build models without giving up rights to files, network and memory (ingest --confine), where
    /// the system cannot take them away.
    #[arg(long, env = "LODESTREAM_UPLOAD_UNCONFINED", num_args = 0..=1, default_missing_value = "true", default_value_t = false, action = ArgAction::Set, requires = "upload_tokens")]
    pub upload_unconfined: bool,
    /// Folder for models on their way; the system's folder for temporary files by default.
    #[arg(
        long,
        env = "LODESTREAM_UPLOAD_SCRATCH",
        value_name = "DIR",
        requires = "upload_tokens"
    )]
    pub upload_scratch: Option<PathBuf>,
    /// Speak TLS with this certificate chain (PEM); read again when it changes.
    #[arg(
        long,
        env = "LODESTREAM_TLS_CERT",
        value_name = "FILE.pem",
        requires = "tls_key"
    )]
    pub tls_cert: Option<PathBuf>,
    /// The chain's private key (PEM).
    #[arg(
        long,
        env = "LODESTREAM_TLS_KEY",
        value_name = "FILE.pem",
        requires = "tls_cert"
    )]
    pub tls_key: Option<PathBuf>,
    #[command(flatten)]
    pub private: PrivateArgs,
}

/// A library and nothing else.
#[derive(Debug, Args)]
pub(super) struct LibraryArgs {
    /// Folder of the library.
    #[arg(long, value_name = "LIB")]
    pub library: String,
    /// Write the answer as JSON.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
}

/// Options of `list`.
#[derive(Debug, Args)]
pub(super) struct ListArgs {
    #[command(flatten)]
    pub library: LibraryArgs,
    /// Also read the scenes: assets, those that other scenes use too, their packs' bytes and the shared part of these.
    #[arg(long)]
    pub assets: bool,
}

/// Options of `show`.
#[derive(Debug, Args)]
pub(super) struct ShowArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Also a line an asset: instances in this scene, other scenes that use it, source triangles, pack bytes, name.
    #[arg(long)]
    pub assets: bool,
}

/// A scene of a library.
#[derive(Debug, Args)]
pub(super) struct SceneArgs {
    /// The scene.
    #[arg(value_name = "SCENE", value_parser = values::scene_name)]
    pub scene: String,
    #[command(flatten)]
    pub library: LibraryArgs,
}

/// Options of `gc`.
#[derive(Debug, Args)]
pub(super) struct GcArgs {
    #[command(flatten)]
    pub library: LibraryArgs,
    /// Leave objects younger than this, so that an ingest that runs meanwhile is safe.
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 86_400,
        allow_negative_numbers = true
    )]
    pub grace_secs: u64,
    /// Only say what would go.
    #[arg(long)]
    pub dry_run: bool,
    #[command(flatten)]
    pub private: PrivateArgs,
}

/// Options of `copy`.
#[derive(Debug, Args)]
pub(super) struct CopyArgs {
    /// The library to read.
    #[arg(value_name = "FROM")]
    pub from: String,
    /// The library to write; made where there is none.
    #[arg(value_name = "TO")]
    pub to: String,
    /// Only this scene; may be given several times.
    #[arg(long = "scene", value_name = "SCENE", value_parser = values::scene_name)]
    pub scenes: Vec<String>,
    /// Read and hash the objects of TO, and send damaged ones again; exit 1 if FROM lacks one.
    /// By default an object of the right length counts as whole.
    #[arg(long)]
    pub verify: bool,
    /// Remove scenes from TO that FROM no longer has; gc then removes their objects.
    #[arg(long, conflicts_with = "scenes")]
    pub delete: bool,
    /// Accept a FROM without scenes; with --delete this empties TO.
    #[arg(long, conflicts_with = "scenes")]
    pub allow_empty: bool,
    /// Write what was done as JSON.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    #[command(flatten)]
    pub private: PrivateArgs,
}

/// Options of `verify`.
#[derive(Debug, Args)]
pub(super) struct VerifyArgs {
    /// Only this scene; the whole library by default.
    #[arg(value_name = "SCENE", value_parser = values::scene_name)]
    pub scene: Option<String>,
    #[command(flatten)]
    pub library: LibraryArgs,
}

/// Options of `export`.
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("detail").required(true)))]
pub(super) struct ExportArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Coarsest cut within this error, metres in the world.
    #[arg(long, value_name = "METRES", group = "detail", value_parser = values::error_metres, allow_negative_numbers = true)]
    pub error: Option<f64>,
    /// Finest cut of at most so many triangles, every instance counted.
    #[arg(long, value_name = "N", group = "detail")]
    pub triangles: Option<u64>,
    /// The source triangles.
    #[arg(long, group = "detail")]
    pub source: bool,
    /// .glb: a mesh an asset, instances as nodes, materials and textures. .ply: world-space triangles.
    #[arg(long, value_name = "FILE", value_parser = values::export_file)]
    pub out: PathBuf,
}
