//! One replay: a trace through the real residency, in simulated time over a simulated link. No byte of a page is needed.

use lodestream_client::stream::{
    EvictionPolicy, Fetch, PageFacts, PageForm, PageState, Residency, ResidencyConfig, StreamError,
    StreamingRequest,
};
use lodestream_client::trace::{Trace, TraceHeader};

use super::link::{Link, LinkSpeed};

/// Projected errors count up to this many pixels: a surface that is wrong by more than a picture's height is just wrong.
pub const MOST_ERROR_PX: f32 = 1024.0;

/// By what wanted pages are put in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Order {
    /// The error that a page removes, summed over all instances: what viewers do.
    #[default]
    Total,
    /// The largest error that it removes on any one instance, to compare with.
    Largest,
}

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
    /// By what pages are put in order.
    pub order: Order,
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
    /// Integral over time of the error that missing pages would remove, summed over all groups of
    /// all instances, pixel seconds.
    pub total_error_seconds: f64,
    /// For each page that was wanted, missing, and then came: seconds from the one to the other.
    pub waits_secs: Vec<f64>,
    /// The error that each of these pages removed when it came, summed over groups and instances,
    /// pixels.
    pub removed_px: Vec<f64>,
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
        let asked: Vec<(u32, f32, f32)> = wanted
            .iter()
            .copied()
            .filter(|(_, error_px, _)| *error_px > shown_px)
            .collect();
        let requests: Vec<StreamingRequest> = asked
            .iter()
            .map(|&(page, error_px, total_px)| StreamingRequest {
                page,
                error_px,
                priority_px: match self.options.order {
                    Order::Total => total_px,
                    Order::Largest => error_px,
                },
            })
            .collect();
        self.residency.update(now_secs, &requests);
        for fetch in self.residency.cancelled() {
            self.link.cancel(fetch, now_secs);
        }
        for fetch in self.residency.next_fetches(now_secs) {
            self.send(&fetch, now_secs);
        }
        let _ = self.residency.take_changes();
        self.note_waits(&asked, now_secs);
        let (largest_px, total_px) = self.errors_left_px(wanted, shown_px);
        let excess_px = (largest_px - self.options.pixel_error_px).max(0.0);
        self.outcome.error_seconds += f64::from(excess_px) * frame_secs;
        self.outcome.total_error_seconds += total_px * frame_secs;
    }

    fn send(&mut self, fetch: &Fetch, now_secs: f64) {
        let pages = self.residency.pages();
        for page in pages.fetched(fetch) {
            self.link
                .send(fetch.id, page, pages.frame_bytes(page), now_secs);
        }
    }

    /// The largest projected error of anything drawn: what would be refined were its page
    /// installed, or were the pixel error not raised. And the sum of these errors over all that is
    /// drawn.
    fn errors_left_px(&self, wanted: &[(u32, f32, f32)], shown_px: f32) -> (f32, f64) {
        let (mut largest_px, mut total_px) = (0.0f32, 0.0);
        for &(page, error_px, page_px) in wanted {
            let is_drawn_coarser =
                error_px <= shown_px || self.residency.page_state(page) != PageState::Installed;
            if error_px > self.options.pixel_error_px && is_drawn_coarser {
                largest_px = largest_px.max(error_px);
                total_px += f64::from(page_px);
            }
        }
        (largest_px.min(MOST_ERROR_PX), total_px)
    }

    fn note_waits(&mut self, asked: &[(u32, f32, f32)], now_secs: f64) {
        let mut still_missing = vec![None; self.missing_since_secs.len()];
        for &(page, _, total_px) in asked {
            let since_secs = self.missing_since_secs[page as usize].take();
            if self.residency.page_state(page) != PageState::Installed {
                still_missing[page as usize] = since_secs.or(Some(now_secs));
            } else if let Some(since_secs) = since_secs {
                self.outcome.waits_secs.push(now_secs - since_secs);
                self.outcome.removed_px.push(f64::from(total_px));
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
