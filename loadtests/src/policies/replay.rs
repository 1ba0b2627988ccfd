//! One replay: a trace through the real residency, in simulated time over a simulated link. No byte of a page is needed.

use lodestream_client::stream::{
    EvictionPolicy, Fetch, PageFacts, PageForm, PageState, Residency, ResidencyConfig, StreamError,
    StreamingRequest,
};
use lodestream_client::trace::{Trace, TraceHeader};

use super::link::{Link, LinkSpeed};

/// Projected errors count up to this many pixels: a surface that is wrong by more than a picture's height is just wrong.
pub const MOST_ERROR_PX: f32 = 1024.0;

/// What a replay is run with, beside the trace and the policy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReplayOptions {
    /// Bytes of the page pool.
    pub pool_bytes: u64,
    /// The pixel error that the viewer asks for.
    pub pixel_error_px: f32,
    /// The link.
    pub link: LinkSpeed,
    /// Frame of the trace that this viewer begins with; the trace goes round.
    pub first_frame: usize,
}

/// What one viewer's replay came to.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Outcome {
    /// Wanted pages summed over updates, root pages left out.
    pub requests: u64,
    /// Times that a page was not there when it began to be wanted.
    pub faults: u64,
    /// Bytes of the pages that came.
    pub bytes_fetched: u64,
    /// Pages evicted.
    pub evictions: u64,
    /// Integral over time of the shown error beyond the one asked for, pixel seconds.
    pub error_seconds: f64,
    /// For each page that was wanted, missing, and then came: seconds from the one to the other.
    pub waits_secs: Vec<f64>,
    /// Pages that were wanted and missing, and no longer wanted before they came.
    pub given_up: u64,
}

/// A page that came: its number in its asset stands for its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SimulatedPage(pub u32);

impl PageForm for SimulatedPage {
    fn page(&self) -> u32 {
        self.0
    }

    fn parents(&self) -> &[[u32; 2]] {
        &[]
    }
}

/// The pages of a trace as residency wants them.
fn page_facts(header: &TraceHeader) -> Vec<PageFacts> {
    let facts = header.pages.iter().map(|page| PageFacts {
        frame_bytes: page.bytes,
        memory_words: page.memory_words,
        is_root: page.root,
        dependencies: page.dependencies.clone(),
    });
    facts.collect()
}

/// A viewer in the middle of a replay.
struct Replay<'a> {
    trace: &'a Trace,
    options: ReplayOptions,
    residency: Residency<SimulatedPage>,
    link: Link,
    /// When each page began to be wanted and missing.
    missing_since_secs: Vec<Option<f64>>,
    outcome: Outcome,
}

/// Replays `trace` once round.
///
/// # Errors
/// [`StreamError`] where the pool is too small or the pixel error no positive number.
pub fn replay(
    trace: &Trace,
    policy: Box<dyn EvictionPolicy>,
    options: ReplayOptions,
) -> Result<Outcome, StreamError> {
    let config = ResidencyConfig {
        policy,
        pixel_error_px: options.pixel_error_px,
        // The replay answers with the next update what the GPU would read back some frames later.
        readback_updates: 1,
        ..ResidencyConfig::new(options.pool_bytes)
    };
    let mut replay = Replay {
        trace,
        options,
        residency: Residency::over(&page_facts(&trace.header), SimulatedPage, config)?,
        link: Link::new(options.link),
        missing_since_secs: vec![None; trace.header.pages.len()],
        outcome: Outcome::default(),
    };
    let _ = replay.residency.take_changes();
    for update in 0..trace.frames.len() {
        replay.update(update);
    }
    Ok(replay.finish())
}

impl Replay<'_> {
    fn update(&mut self, update: usize) {
        let frame_secs = 1.0 / self.trace.header.fps.max(1) as f64;
        let now_secs = update as f64 * frame_secs;
        for page in self.link.arrived(now_secs) {
            let form = SimulatedPage(self.residency.pages().number_in_asset(page));
            self.residency.arrived(page, Ok(form), now_secs);
        }
        let wanted = &self.trace.frames
            [(update + self.options.first_frame) % self.trace.frames.len()]
        .requests;
        // Culling asks for what exceeds the pixel error that residency let it show.
        let shown_px = self.residency.pixel_error();
        let requests: Vec<StreamingRequest> = wanted
            .iter()
            .filter(|(_, priority_px)| *priority_px > shown_px)
            .map(|&(page, priority_px)| StreamingRequest { page, priority_px })
            .collect();
        self.residency.update(now_secs, &requests);
        for fetch in self.residency.cancelled() {
            self.link.cancel(fetch, now_secs);
        }
        for fetch in self.residency.next_fetches(now_secs) {
            self.send(&fetch, now_secs);
        }
        let _ = self.residency.take_changes();
        self.note_waits(&requests, now_secs);
        let excess_px = self.shown_error_px(wanted, shown_px) - self.options.pixel_error_px;
        self.outcome.error_seconds += f64::from(excess_px.max(0.0)) * frame_secs;
    }

    fn send(&mut self, fetch: &Fetch, now_secs: f64) {
        let pages = self.residency.pages();
        for page in pages.fetched(fetch) {
            self.link
                .send(fetch.id, page, pages.frame_bytes(page), now_secs);
        }
    }

    /// The largest projected error of anything drawn: what would be refined were its page installed, or were the pixel error
    /// not raised.
    fn shown_error_px(&self, wanted: &[(u32, f32)], shown_px: f32) -> f32 {
        let drawn_coarser = |&&(page, priority_px): &&(u32, f32)| {
            priority_px <= shown_px || self.residency.page_state(page) != PageState::Installed
        };
        let errors = wanted
            .iter()
            .filter(|(_, priority_px)| *priority_px > self.options.pixel_error_px);
        let largest = errors
            .filter(drawn_coarser)
            .map(|&(_, priority_px)| priority_px)
            .fold(0.0, f32::max);
        largest.min(MOST_ERROR_PX)
    }

    fn note_waits(&mut self, requests: &[StreamingRequest], now_secs: f64) {
        let mut still_missing = vec![None; self.missing_since_secs.len()];
        for request in requests {
            let page = request.page as usize;
            let since_secs = self.missing_since_secs[page].take();
            if self.residency.page_state(request.page) == PageState::Installed {
                self.outcome
                    .waits_secs
                    .extend(since_secs.map(|since_secs| now_secs - since_secs));
            } else {
                still_missing[page] = since_secs.or(Some(now_secs));
            }
        }
        self.outcome.given_up += self.missing_since_secs.iter().flatten().count() as u64;
        self.missing_since_secs = still_missing;
    }

    fn finish(self) -> Outcome {
        let stats = self.residency.stats();
        Outcome {
            requests: stats.requests,
            faults: stats.faults,
            bytes_fetched: stats.bytes_fetched,
            evictions: stats.pages_evicted,
            ..self.outcome
        }
    }
}
