//! Many virtual viewers against one server, over real HTTP: each opens a scene, stands until it has settled, then walks,
//! and fetches what it wants through the client's own streaming half, every hash checked.
//!
//! The load is open: updates are planned at a fixed rate, and a request's latency counts from the time for which its update
//! was planned, so that a slow server cannot slow its own examination down. Culling runs on the CPU; where that is the
//! bottleneck, updates are late, and the report says which share.
//!
//! ```text
//! run ── viewer (one task each) ── shaper (a proxy, where a link is asked for) ── server
//!  └──── metrics (before and after)
//! ```

mod metrics;
mod report;
mod shaper;
mod viewer;

use std::sync::Arc;
use std::time::{Duration, Instant};

use lodestream_client::stream::{Source, StreamError, Transport};
use tokio::sync::Semaphore;
use tokio::task::JoinSet;

pub use metrics::{MetricsError, ServerFigures};
pub use report::LoadReport;
pub use shaper::ShaperError;

use crate::policies::LinkSpeed;
use metrics::Snapshot;
use shaper::Shaper;
use viewer::{SharedScene, Viewer, ViewerOutcome};

/// What to run.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadOptions {
    /// The server, or a library folder.
    pub url: String,
    /// The scene of all viewers; without one they take turns over all scenes.
    pub scene: Option<String>,
    /// Viewers.
    pub viewers: usize,
    /// How long.
    pub seconds: f64,
    /// Updates a second and viewer.
    pub rate: f64,
    /// Each viewer's link; without one the network's own.
    pub link: Option<LinkSpeed>,
    /// How pages are asked for.
    pub transport: Transport,
    /// Bytes of each viewer's page pool. No memory is taken: a virtual viewer keeps books only.
    pub pool_bytes: u64,
    /// The pixel error that they ask for.
    pub pixel_error_px: f32,
    /// Another number, other walks.
    pub seed: u64,
}

/// Why a load test could not run. What goes wrong for a viewer on its way is counted instead.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The first look at the library.
    #[error(transparent)]
    Stream(#[from] StreamError),
    /// The links.
    #[error(transparent)]
    Shaper(#[from] ShaperError),
    /// The server's counters.
    #[error(transparent)]
    Metrics(#[from] MetricsError),
    /// Nothing to look at.
    #[error("{0}: expected at least one scene, found none")]
    NoScene(String),
    /// A fault in this program.
    #[error("viewer task: expected it to end by itself, found {0}")]
    Task(#[from] tokio::task::JoinError),
}

/// What all viewers share.
struct Shared {
    options: LoadOptions,
    started: Instant,
    /// Bounds the threads that cull, so that tokio's own stay free.
    cullers: Semaphore,
    /// Every viewer opens for itself; memory holds each scene once.
    scenes: Vec<(String, Arc<SharedScene>)>,
}

/// Runs the load.
///
/// # Errors
/// See [`LoadError`].
pub async fn run(options: LoadOptions) -> Result<LoadReport, LoadError> {
    let source = Source::connect(&options.url)?;
    let names = match &options.scene {
        Some(name) => vec![name.clone()],
        None => source
            .scenes()
            .await?
            .into_iter()
            .map(|entry| entry.name)
            .collect(),
    };
    if names.is_empty() {
        return Err(LoadError::NoScene(options.url));
    }
    // Fails early where a name is wrong or the server away.
    let mut scenes = Vec::new();
    for name in names {
        let scene = SharedScene::new(source.open(&name).await?);
        scenes.push((name, Arc::new(scene)));
    }
    let before = Snapshot::read(&options.url).await?;
    let cores = std::thread::available_parallelism().map_or(2, |cores| cores.get());
    let shared = Arc::new(Shared {
        options,
        started: Instant::now(),
        cullers: Semaphore::new(cores),
        scenes,
    });
    let mut tasks = JoinSet::new();
    let mut shapers = Vec::new();
    for index in 0..shared.options.viewers {
        let shaper = match shared.options.link {
            Some(speed) => Some(Shaper::start(&shared.options.url, speed).await?),
            None => None,
        };
        let url = shaper
            .as_ref()
            .map_or(shared.options.url.clone(), Shaper::url);
        let viewer = Viewer::new(shared.clone(), index, Source::connect(&url)?);
        shapers.push(shaper);
        tasks.spawn(viewer.run());
    }
    let mut outcomes: Vec<ViewerOutcome> = Vec::new();
    while let Some(outcome) = tasks.join_next().await {
        outcomes.push(outcome?);
    }
    let secs = shared.started.elapsed().as_secs_f64();
    let server = match (before, Snapshot::read(&shared.options.url).await?) {
        (Some(before), Some(after)) => Some(after.since(&before)),
        _ => None,
    };
    Ok(LoadReport::of(&shared.options, secs, outcomes, server))
}

impl Shared {
    fn end(&self) -> Instant {
        self.started + Duration::from_secs_f64(self.options.seconds)
    }
}
