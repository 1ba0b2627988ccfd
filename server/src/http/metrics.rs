//! `GET /metrics`: counters in Prometheus' text format.
//!
//! A request lasts until its body is sent or given up, so streamed answers are measured whole.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use axum::extract::State;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};

use super::AppState;
use super::page_cache::CacheCounts;

/// Upper bounds of the latency histogram, seconds.
const BUCKETS_SECS: [f64; 14] = [
    0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0,
];

/// Most scenes that are told apart; the others are counted under no name.
const MAX_SCENES: usize = 1000;

/// Counters since the start.
#[derive(Debug, Default)]
pub(super) struct Metrics {
    routes: Mutex<BTreeMap<String, RouteCounters>>,
    scenes: Mutex<BTreeMap<String, u64>>,
    pages: AtomicU64,
    in_flight: AtomicI64,
}

#[derive(Debug, Default, Clone)]
struct RouteCounters {
    statuses: BTreeMap<u16, u64>,
    bytes: u64,
    /// Requests a bucket, not summed up; the last one is for all slower ones.
    buckets: [u64; BUCKETS_SECS.len() + 1],
    seconds: f64,
}

impl Metrics {
    /// Counts pages that went into an answer.
    pub(super) fn pages_sent(&self, pages: u64) {
        self.pages.fetch_add(pages, Ordering::Relaxed);
    }

    /// Counts that a scene was opened.
    pub(super) fn opened(&self, scene: &str) {
        let mut scenes = self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
        let told = scenes.contains_key(scene) || scenes.len() < MAX_SCENES;
        let name = if told { scene } else { "" };
        *scenes.entry(name.to_owned()).or_default() += 1;
    }

    /// Counts a request that is not finished.
    pub(super) fn began(&self) {
        self.in_flight.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a request that began.
    pub(super) fn finished(&self, route: &str, status: u16, bytes: u64, seconds: f64) {
        self.in_flight.fetch_sub(1, Ordering::Relaxed);
        let mut routes = self.routes.lock().unwrap_or_else(PoisonError::into_inner);
        if !routes.contains_key(route) {
            routes.insert(route.to_owned(), RouteCounters::default());
        }
        if let Some(counters) = routes.get_mut(route) {
            *counters.statuses.entry(status).or_default() += 1;
            counters.bytes += bytes;
            counters.seconds += seconds;
            let bucket = BUCKETS_SECS.partition_point(|&bound| bound < seconds);
            counters.buckets[bucket] += 1;
        }
    }

    /// The counters; scenes that are hidden have no name.
    fn text(&self, viewers: usize, cache: CacheCounts, hides: impl Fn(&str) -> bool) -> String {
        let routes = self
            .routes
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone();
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut text, &routes, viewers, cache, hides);
        text
    }

    fn write(
        &self,
        text: &mut String,
        routes: &BTreeMap<String, RouteCounters>,
        viewers: usize,
        cache: CacheCounts,
        hides: impl Fn(&str) -> bool,
    ) -> std::fmt::Result {
        family(text, "requests_total", "counter", "Requests finished.")?;
        for (route, counters) in routes {
            for (status, count) in &counters.statuses {
                writeln!(
                    text,
                    "lodestream_requests_total{{route=\"{route}\",status=\"{status}\"}} {count}"
                )?;
            }
        }
        family(text, "response_bytes_total", "counter", "Bytes of bodies.")?;
        for (route, counters) in routes {
            let bytes = counters.bytes;
            writeln!(
                text,
                "lodestream_response_bytes_total{{route=\"{route}\"}} {bytes}"
            )?;
        }
        let help = "From the request's head to the end of the answer's body.";
        family(text, "request_seconds", "histogram", help)?;
        for (route, counters) in routes {
            let name = "lodestream_request_seconds";
            let mut sum = 0;
            for (bound, count) in BUCKETS_SECS.iter().zip(counters.buckets) {
                sum += count;
                writeln!(
                    text,
                    "{name}_bucket{{route=\"{route}\",le=\"{bound}\"}} {sum}"
                )?;
            }
            let count: u64 = counters.buckets.iter().sum();
            writeln!(
                text,
                "{name}_bucket{{route=\"{route}\",le=\"+Inf\"}} {count}"
            )?;
            writeln!(text, "{name}_sum{{route=\"{route}\"}} {}", counters.seconds)?;
            writeln!(text, "{name}_count{{route=\"{route}\"}} {count}")?;
        }
        let mut scenes = BTreeMap::new();
        for (scene, count) in &*self.scenes.lock().unwrap_or_else(PoisonError::into_inner) {
            let name = if hides(scene) { "" } else { scene };
            *scenes.entry(name.to_owned()).or_insert(0) += count;
        }
        let help = "Openings of a scene; under no name those of protected scenes and of all beyond a thousand.";
        family(text, "scene_opens_total", "counter", help)?;
        for (scene, count) in scenes {
            writeln!(
                text,
                "lodestream_scene_opens_total{{scene=\"{scene}\"}} {count}"
            )?;
        }
        family(
            text,
            "pages_sent_total",
            "counter",
            "Pages put into answers.",
        )?;
        let pages = self.pages.load(Ordering::Relaxed);
        writeln!(text, "lodestream_pages_sent_total {pages}")?;
        family(
            text,
            "requests_in_flight",
            "gauge",
            "Requests not finished.",
        )?;
        let in_flight = self.in_flight.load(Ordering::Relaxed);
        writeln!(text, "lodestream_requests_in_flight {in_flight}")?;
        family(
            text,
            "viewers",
            "gauge",
            "Viewers whose posts are remembered.",
        )?;
        writeln!(text, "lodestream_viewers {viewers}")?;
        let help = "Pieces of packs that were in memory, had to be read, or were read before anybody asked.";
        family(text, "page_cache_reads_total", "counter", help)?;
        for (result, count) in [
            ("hit", cache.hits),
            ("miss", cache.misses),
            ("ahead", cache.ahead),
            ("resident", cache.resident),
            ("mapped", cache.mapped),
        ] {
            writeln!(
                text,
                "lodestream_page_cache_reads_total{{result=\"{result}\"}} {count}"
            )?;
        }
        family(text, "page_cache_bytes", "gauge", "Bytes of packs held.")?;
        writeln!(text, "lodestream_page_cache_bytes {}", cache.bytes)
    }
}

fn family(text: &mut String, name: &str, kind: &str, help: &str) -> std::fmt::Result {
    writeln!(text, "# HELP lodestream_{name} {help}")?;
    writeln!(text, "# TYPE lodestream_{name} {kind}")
}

/// `GET /metrics`, for all who ask.
pub(super) async fn metrics(State(state): State<AppState>) -> Response {
    answer(&state, |scene| state.is_protected(scene))
}

/// `GET /metrics` where only those ask who run the server.
pub(super) async fn metrics_of_all(State(state): State<AppState>) -> Response {
    answer(&state, |_| false)
}

fn answer(state: &AppState, hides: impl Fn(&str) -> bool) -> Response {
    let (viewers, cache) = (state.0.viewers.count(), state.0.pages.counts());
    let text = state.0.metrics.text(viewers, cache, hides);
    let kind = "text/plain; version=0.0.4; charset=utf-8";
    ([(CONTENT_TYPE, kind)], text).into_response()
}
