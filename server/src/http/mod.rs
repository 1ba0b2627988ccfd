//! HTTP over a library. Stateless but for caches: any number of servers may stand over one library.
//!
//! One file a route; `error` is the one table from errors to statuses; `serve` owns sockets and signals. The router works
//! without a socket too.

mod access;
mod activity;
mod body;
mod budget;
mod buffers;
mod connection;
mod connections;
pub mod cors;
pub(crate) mod descriptors;
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
mod listing;
mod lookups;
#[cfg_attr(not(target_os = "linux"), path = "unmapped.rs")]
mod mapped;
mod memory;
mod metrics;
mod objects;
mod open;
mod openapi;
mod pace;
mod page_cache;
mod page_plan;
mod pages;
mod post_body;
mod post_pages;
mod priority;
mod read_ahead;
pub mod reload;
pub mod requests;
mod resident;
mod scene_words;
mod scenes;
mod send;
pub mod serve;
mod slices;
mod socket;
mod tables;
pub mod tls;
mod token_lines;
pub mod tokens;
pub mod uploads;
mod viewers;
mod workers;

use axum::Router;
use axum::middleware;
use axum::routing::{MethodRouter, get, post};
use lodestream_format::library::{SceneReference, scene_path};
use lodestream_format::{Asset, ContentHash};
use std::sync::Arc;
use tokio::sync::watch;

use crate::library::{Library, LibraryError};
use cors::Cors;
use health::Readiness;
use limits::{ClientAddress, ClientLimits, Limits};
use listing::Listing;
use lookups::{Lookups, Name};
use metrics::Metrics;
use page_cache::PageCache;
use post_body::PostBodies;
use tables::AssetTables;
use tokens::Tokens;
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
    listing: Arc<Listing>,
    lookups: Lookups,
    posts: PostBodies,
    metrics: Metrics,
    limits: Arc<Limits>,
    uploads: Option<Uploads>,
    readers: Option<Tokens>,
    readiness: Readiness,
    draining: watch::Sender<bool>,
}

/// Least room for page tables: those of some 5 GiB of packs.
const TABLES_BYTES: usize = 8 * 1024 * 1024;

/// How a server is set up: given once, before anything shares the state.
#[derive(Debug)]
pub struct StateOptions {
    /// About the most bytes in memory: a quarter for page tables, or 8 MiB if that is more, the
    /// rest for pages.
    pub cache_bytes: usize,
    /// Limits of every client.
    pub limits: ClientLimits,
    /// Uploads, where the server takes any.
    pub uploads: Option<UploadOptions>,
    /// Readers of scenes; all scenes are open where there are none.
    pub readers: Option<Tokens>,
}

impl Default for StateOptions {
    fn default() -> Self {
        Self {
            cache_bytes: DEFAULT_CACHE_BYTES,
            limits: ClientLimits::default(),
            uploads: None,
            readers: None,
        }
    }
}

impl AppState {
    /// State over `library` with about `cache_bytes` in memory and nothing else of
    /// [`StateOptions`].
    pub fn new(library: Library, cache_bytes: usize) -> Self {
        Self::with_options(
            library,
            StateOptions {
                cache_bytes,
                ..StateOptions::default()
            },
        )
    }

    /// State over `library`.
    pub fn with_options(library: Library, options: StateOptions) -> Self {
        let cache_bytes = options.cache_bytes;
        Self(Arc::new(Shared {
            pages: PageCache::new(library.clone(), cache_bytes - cache_bytes / 4),
            listing: Listing::new(library.clone()),
            library,
            tables: AssetTables::new(TABLES_BYTES.max(cache_bytes / 4)),
            viewers: Viewers::default(),
            lookups: Lookups::default(),
            posts: PostBodies::default(),
            metrics: Metrics::default(),
            limits: Arc::new(Limits::new(options.limits)),
            uploads: options.uploads.map(Uploads::new),
            readers: options.readers,
            readiness: Readiness::default(),
            draining: watch::Sender::new(false),
        }))
    }

    /// The asset that a client names.
    async fn asset(
        &self,
        client: ClientAddress,
        hash: &ContentHash,
    ) -> Result<Arc<Asset>, LibraryError> {
        let Shared {
            library,
            tables,
            lookups,
            ..
        } = &*self.0;
        if let Some(asset) = tables.held(hash) {
            return Ok(asset);
        }
        let missing = || lookups::no_object(library, hash);
        let look = tables.asset(library, hash);
        lookups
            .find(client, Name::Object(*hash), missing, look)
            .await
    }

    /// The reference of the scene that a client names.
    async fn reference(
        &self,
        client: ClientAddress,
        scene: &str,
    ) -> Result<SceneReference, LibraryError> {
        let Shared {
            library, lookups, ..
        } = &*self.0;
        // A bad name is another error than a missing scene.
        scene_path(scene).map_err(LibraryError::Name)?;
        let name = Name::Scene(ContentHash::of(scene.as_bytes()));
        let missing = || lookups::no_scene(library, scene);
        lookups
            .find(client, name, missing, library.reference(scene))
            .await
    }

    /// From now on `/readyz` says no, so that balancers send new work elsewhere.
    pub fn drain(&self) {
        self.0.draining.send_replace(true);
    }

    /// Whether [`AppState::drain`] was called, and when it is.
    fn draining(&self) -> watch::Receiver<bool> {
        self.0.draining.subscribe()
    }

    /// Ends when [`AppState::drain`] was called.
    pub fn drained(&self) -> impl Future<Output = ()> + use<> {
        let mut draining = self.draining();
        async move {
            // A state that is gone drains too.
            let _ = draining.wait_for(|&draining| draining).await;
        }
    }

    fn is_draining(&self) -> bool {
        *self.0.draining.borrow()
    }
}

/// Which routes a server has.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Serves {
    /// All of them. `/metrics` names no scene that only holders of tokens read.
    #[default]
    All,
    /// All but `/metrics`, which is elsewhere.
    Library,
    /// `/metrics`, with the names of all scenes, and whether the server is well.
    Metrics,
}

/// Every route under its path.
fn routes(serves: Serves) -> Vec<(&'static str, MethodRouter<AppState>)> {
    let mut routes = vec![
        ("/healthz", get(health::healthz)),
        ("/readyz", get(health::readyz)),
    ];
    match serves {
        Serves::All => routes.push(("/metrics", get(metrics::metrics))),
        Serves::Library => {}
        Serves::Metrics => {
            routes.push(("/metrics", get(metrics::metrics_of_all)));
            return routes;
        }
    }
    routes.extend([
        ("/v1/scenes", get(scenes::list)),
        ("/v1/scenes/{scene}", get(scenes::show).put(uploads::upload)),
        ("/v1/scenes/{scene}/open", get(open::open)),
        ("/v1/objects/{hash}", get(objects::object)),
        (pages::PAGES_ROUTE, get(pages::pages)),
        ("/v1/pages", post(post_pages::post_pages)),
        ("/v1/openapi.json", get(openapi::openapi)),
    ]);
    routes
}

/// All routes, and what every answer of theirs has.
pub fn router(state: AppState) -> Router {
    router_of(state, Serves::default(), Arc::default())
}

fn router_of(state: AppState, serves: Serves, cors: Arc<Cors>) -> Router {
    routes(serves)
        .into_iter()
        .fold(Router::new(), |router, (path, methods)| {
            router.route(path, methods)
        })
        .fallback(error::no_route)
        .method_not_allowed_fallback(error::wrong_method)
        .layer(middleware::from_fn_with_state(
            state.clone(),
            encoding::texts,
        ))
        .layer(middleware::from_fn_with_state(cors, cors::cors))
        .layer(middleware::from_fn_with_state(
            state.clone(),
            requests::requests,
        ))
        .with_state(state)
}
