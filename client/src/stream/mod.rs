//! Streaming: from what culling asks for to pages in the pool. No GPU is needed here.
//!
//! ```text
//! source ── open ──> opened_scene ──> pool (layout), scene_pages (sizes, dependencies)
//!
//! requests ─> want (closure, admission) ─> order ─> streamer (get_transport | post_transport) ─> source
//!               │  governor (pixel error)    │ window (bytes in flight)                            │
//!               └──── page_state ────────────┴── install <── arrive <── page_check <────────────────┘
//!                                                  │ policy (who leaves)
//!                                                  └─> changes: evicted, uploads, installed
//! ```
//!
//! `residency` holds the state between these stages and knows neither clock nor network; `streamer` brings both.

mod arrive;
mod error;
mod fetch_timing;
mod folder_source;
mod get_transport;
mod governor;
mod http;
mod install;
mod limits;
mod open_parts;
mod opened_scene;
mod order;
mod page_check;
mod page_state;
mod policy;
mod pool;
mod post_transport;
mod residency;
mod scene_pages;
mod source;
mod stats;
mod streamer;
mod want;
mod window;

pub use error::{Retry, StreamError};
pub use fetch_timing::FetchTiming;
pub use governor::{PixelErrorControl, PixelErrorLimit};
pub use install::{Changes, Upload};
pub use limits::{DEFAULT_OPEN_MEMORY_BYTES, StreamLimits};
pub use open_parts::OpenParts;
pub use opened_scene::{OpenedAsset, OpenedScene};
pub use order::Fetch;
pub use page_check::{decode_page, split_frames};
pub use page_state::{IllegalTransition, PageEvent, PageState};
pub use policy::{Candidate, DecayedError, EvictionPolicy, LowestError, Lru, smallest};
pub use pool::{MIN_SLOTS, NOT_INSTALLED, PoolLayout};
pub use residency::{PageForm, Residency, ResidencyConfig};
pub use scene_pages::{PageFacts, ScenePages};
pub use source::{PageAnswer, Source};
pub use stats::StreamStats;
pub use streamer::{Streamer, Transport};
pub use want::StreamingRequest;
