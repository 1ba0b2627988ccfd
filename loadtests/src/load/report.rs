//! What all viewers together came to.

use lodestream_client::stream::{StreamError, Transport};
use serde::Serialize;

use super::LoadOptions;
use super::metrics::ServerFigures;
use super::viewer::ViewerOutcome;
use crate::percentiles::{Latencies, Sorted, Waits};
use crate::policies::LinkSpeed;

/// Figures of a load test. Latencies count from the time for which a request's update was planned to its last byte.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LoadReport {
    /// Viewers.
    pub viewers: usize,
    /// Seconds that it took.
    pub seconds: f64,
    /// Updates a second and viewer that were planned.
    pub rate: f64,
    /// How pages were asked for.
    pub transport: &'static str,
    /// Each viewer's link.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub link: Option<LinkSpeed>,
    /// Scenes opened and page ranges asked for, that ended.
    pub requests: u64,
    /// Those of them that failed.
    pub errors: u64,
    /// Those of the errors whose bytes came and were not what their hash or the format promises.
    pub damaged: u64,
    /// The first error in full.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_error: Option<String>,
    /// Pages that came and passed every check.
    pub pages: u64,
    /// Bytes of opened scenes and pages.
    pub bytes: u64,
    /// Requests a second.
    pub requests_per_second: f64,
    /// Bytes a second.
    pub bytes_per_second: f64,
    /// Milliseconds of a page range.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub latency_ms: Option<Latencies>,
    /// The same from the time when it was really asked for: without what this machine was late.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub service_ms: Option<Latencies>,
    /// Seconds that opening a scene took, parsing and checking included.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub open_secs: Option<Waits>,
    /// Seconds from a viewer's start until nothing was missing any more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settled_secs: Option<Waits>,
    /// Viewers that settled.
    pub settled_viewers: u64,
    /// Updates that were planned.
    pub updates_planned: u64,
    /// Share of them that began more than a whole interval late or not at all: above a few hundredths this machine, not the
    /// server, was the bottleneck.
    pub updates_late_share: f64,
    /// Pages evicted.
    pub pages_evicted: u64,
    /// What the server counted meanwhile.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub server: Option<ServerFigures>,
}

impl LoadReport {
    pub(super) fn of(
        options: &LoadOptions,
        seconds: f64,
        outcomes: Vec<ViewerOutcome>,
        server: Option<ServerFigures>,
    ) -> Self {
        let total = |figure: fn(&ViewerOutcome) -> u64| outcomes.iter().map(figure).sum::<u64>();
        let (requests, bytes) = (
            total(|outcome| outcome.requests),
            total(|outcome| outcome.bytes),
        );
        let planned = total(|outcome| outcome.updates_planned);
        let on_time = total(|outcome| outcome.updates_on_time);
        let errors: Vec<&StreamError> = outcomes
            .iter()
            .flat_map(|outcome| &outcome.errors)
            .collect();
        let damaged = |error: &&&StreamError| {
            matches!(error, StreamError::Hash { .. } | StreamError::Format { .. })
        };
        let latencies = |times: fn(&ViewerOutcome) -> &Vec<f64>| {
            let all = outcomes.iter().flat_map(times).copied();
            Latencies::of(&Sorted::new(all.collect()))
        };
        let settled = Sorted::new(
            outcomes
                .iter()
                .filter_map(|outcome| outcome.settled_secs)
                .collect(),
        );
        Self {
            viewers: options.viewers,
            seconds,
            rate: options.rate,
            transport: match options.transport {
                Transport::Get => "get",
                Transport::Post => "post",
            },
            link: options.link,
            requests,
            errors: errors.len() as u64,
            damaged: errors.iter().filter(damaged).count() as u64,
            first_error: errors.first().map(|error| error.to_string()),
            pages: total(|outcome| outcome.pages),
            bytes,
            requests_per_second: requests as f64 / seconds,
            bytes_per_second: bytes as f64 / seconds,
            latency_ms: latencies(|outcome| &outcome.latencies_ms),
            service_ms: latencies(|outcome| &outcome.service_ms),
            open_secs: Waits::of(&Sorted::new(
                outcomes
                    .iter()
                    .filter_map(|outcome| outcome.open_secs)
                    .collect(),
            )),
            settled_secs: Waits::of(&settled),
            settled_viewers: settled.count() as u64,
            updates_planned: planned,
            updates_late_share: (planned - on_time) as f64 / planned.max(1) as f64,
            pages_evicted: total(|outcome| outcome.pages_evicted),
            server,
        }
    }
}
