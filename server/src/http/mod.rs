//! HTTP over a library. Stateless but for caches: any number of servers may stand over one library.
//!
//! One file a route; `error` is the one table from errors to statuses; `serve` owns sockets and signals. The router works
//! without a socket too.

mod body;
mod cors;
mod error;
mod etag;
mod front;
mod health;
mod metrics;
mod objects;
mod open;
mod page_cache;
mod page_plan;
mod pages;
mod post_pages;
mod scenes;
pub mod serve;
mod socket;
mod tables;
pub mod tls;
mod viewers;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use axum::Router;
use axum::middleware;
use axum::routing::{get, post};

use crate::library::Library;
use metrics::Metrics;
use page_cache::PageCache;
use tables::AssetTables;
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
    metrics: Metrics,
    draining: AtomicBool,
}

impl AppState {
    /// State over `library` with at most about `cache_bytes` in memory: a quarter of it for page tables, the rest for pages.
    pub fn new(library: Library, cache_bytes: usize) -> Self {
        Self(Arc::new(Shared {
            library,
            tables: AssetTables::new(cache_bytes / 4),
            pages: PageCache::new(cache_bytes - cache_bytes / 4),
            viewers: Viewers::default(),
            metrics: Metrics::default(),
            draining: AtomicBool::new(false),
        }))
    }

    /// From now on `/readyz` says no, so that balancers send new work elsewhere.
    pub fn drain(&self) {
        self.0.draining.store(true, Ordering::Relaxed);
    }
}

/// Every route.
pub fn router(state: AppState) -> Router {
    Router::new()
        .route("/v1/scenes", get(scenes::list))
        .route("/v1/scenes/{scene}", get(scenes::show))
        .route("/v1/scenes/{scene}/open", get(open::open))
        .route("/v1/objects/{hash}", get(objects::object))
        .route(pages::PAGES_ROUTE, get(pages::pages))
        .route("/v1/pages", post(post_pages::post_pages))
        .route("/healthz", get(health::healthz))
        .route("/readyz", get(health::readyz))
        .route("/metrics", get(metrics::metrics))
        .fallback(error::no_route)
        .method_not_allowed_fallback(error::wrong_method)
        .layer(middleware::from_fn(cors::cors))
        .layer(middleware::from_fn_with_state(
            state.clone(),
            metrics::measure,
        ))
        .with_state(state)
}
