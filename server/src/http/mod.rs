//! HTTP over a library. Stateless but for caches: any number of servers may stand over one library.
//!
//! One file a route; `error` is the one table from errors to statuses; `serve` owns sockets and signals. The router works
//! without a socket too.

mod body;
mod buffers;
mod cors;
mod encoding;
mod error;
mod error_log;
mod etag;
mod fair;
mod front;
mod gather;
mod health;
mod http1;
pub mod limits;
#[cfg_attr(not(target_os = "linux"), path = "unmapped.rs")]
mod mapped;
mod memory;
mod metrics;
mod objects;
mod open;
mod openapi;
mod page_cache;
mod page_plan;
mod pages;
mod post_pages;
mod priority;
mod read_ahead;
pub mod requests;
mod resident;
mod scenes;
mod send;
pub mod serve;
mod slices;
mod socket;
mod tables;
pub mod tls;
pub mod tokens;
pub mod uploads;
mod viewers;
mod workers;

use axum::Router;
use axum::http::HeaderMap;
use axum::middleware;
use axum::routing::{MethodRouter, get, post};
use std::sync::Arc;
use tokio::sync::{Semaphore, watch};

use crate::library::Library;
use error::HttpError;
use limits::{ClientLimits, Limits};
use metrics::Metrics;
use page_cache::PageCache;
use tables::AssetTables;
use tokens::ReadTokens;
use uploads::{UploadOptions, Uploads};
use viewers::Viewers;

/// Default of `--cache-bytes`.
pub const DEFAULT_CACHE_BYTES: usize = 256 * 1024 * 1024;

/// What all requests share; clones are handles.
#[derive(Debug, Clone)]
pub struct AppState(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    library: Library,
    tables: AssetTables,
    pages: PageCache,
    viewers: Viewers,
    /// Bytes that posts may still send.
    posts: Semaphore,
    metrics: Metrics,
    limits: Arc<Limits>,
    uploads: Option<Uploads>,
    readers: Option<ReadTokens>,
    draining: watch::Sender<bool>,
}

/// Least room for page tables: those of some 5 GiB of packs.
const TABLES_BYTES: usize = 8 * 1024 * 1024;

impl AppState {
    /// State over `library` with at most about `cache_bytes` in memory: a quarter of it for page tables, or [`TABLES_BYTES`] if that is
    /// more, the rest for pages.
    pub fn new(library: Library, cache_bytes: usize) -> Self {
        Self::with_limits(library, cache_bytes, ClientLimits::default())
    }

    /// The same, with `limits` on every client.
    pub fn with_limits(library: Library, cache_bytes: usize, limits: ClientLimits) -> Self {
        Self(Arc::new(Shared {
            pages: PageCache::new(library.clone(), cache_bytes - cache_bytes / 4),
            library,
            tables: AssetTables::new(TABLES_BYTES.max(cache_bytes / 4)),
            viewers: Viewers::default(),
            posts: Semaphore::new(post_pages::POSTS_BYTES),
            metrics: Metrics::default(),
            limits: Arc::new(Limits::new(limits)),
            uploads: None,
            readers: None,
            draining: watch::Sender::new(false),
        }))
    }

    /// The same, taking models. Only before it is shared: clones keep what they have.
    pub fn taking_uploads(mut self, options: UploadOptions) -> Self {
        if let Some(shared) = Arc::get_mut(&mut self.0) {
            shared.uploads = Some(Uploads::new(options));
        }
        self
    }

    /// The same, with scenes that only holders of tokens read. Only before it is shared.
    pub fn read_by(mut self, readers: ReadTokens) -> Self {
        if let Some(shared) = Arc::get_mut(&mut self.0) {
            shared.readers = Some(readers);
        }
        self
    }

    /// Fails unless the request may read `scene`.
    fn may_read(&self, request: &HeaderMap, scene: &str) -> Result<(), HttpError> {
        let readers = self.0.readers.as_ref();
        readers.map_or(Ok(()), |readers| readers.check(request, scene))
    }

    /// From now on `/readyz` says no, so that balancers send new work elsewhere.
    pub fn drain(&self) {
        self.0.draining.send_replace(true);
    }

    /// Whether [`AppState::drain`] was called, and when it is.
    fn draining(&self) -> watch::Receiver<bool> {
        self.0.draining.subscribe()
    }

    fn is_draining(&self) -> bool {
        *self.0.draining.borrow()
    }
}

/// Every route under its path.
fn routes() -> [(&'static str, MethodRouter<AppState>); 10] {
    [
        ("/v1/scenes", get(scenes::list)),
        ("/v1/scenes/{scene}", get(scenes::show).put(uploads::upload)),
        ("/v1/scenes/{scene}/open", get(open::open)),
        ("/v1/objects/{hash}", get(objects::object)),
        (pages::PAGES_ROUTE, get(pages::pages)),
        ("/v1/pages", post(post_pages::post_pages)),
        ("/v1/openapi.json", get(openapi::openapi)),
        ("/healthz", get(health::healthz)),
        ("/readyz", get(health::readyz)),
        ("/metrics", get(metrics::metrics)),
    ]
}

/// All routes, and what every answer of theirs has.
pub fn router(state: AppState) -> Router {
    routes()
        .into_iter()
        .fold(Router::new(), |router, (path, methods)| {
            router.route(path, methods)
        })
        .fallback(error::no_route)
        .method_not_allowed_fallback(error::wrong_method)
        .layer(encoding::texts())
        .layer(middleware::map_response(encoding::weaken))
        .layer(middleware::from_fn(cors::cors))
        .layer(middleware::from_fn_with_state(
            state.clone(),
            requests::requests,
        ))
        .with_state(state)
}
