//! Every policy at every pool size, and what came of it.

use lodestream_client::stream::StreamError;
use lodestream_client::trace::Trace;
use rayon::prelude::*;
use serde::Serialize;

use super::PolicyName;
use super::clairvoyant::{Future, Recorder};
use super::link::LinkSpeed;
use super::replay::{Order, Outcome, ReplayOptions, replay};
use crate::percentiles::{Sorted, Waits};

/// What to run.
#[derive(Debug, Clone, PartialEq)]
pub struct StudyOptions {
    /// Policies, in the order of the report.
    pub policies: Vec<PolicyName>,
    /// Pool sizes, bytes.
    pub pools_bytes: Vec<u64>,
    /// Viewers, each with a pool and a link of its own; they walk the trace from evenly spaced frames on, round its end, and
    /// their figures are added up.
    pub viewers: usize,
    /// The pixel error that they ask for.
    pub pixel_error_px: f32,
    /// Their links.
    pub link: LinkSpeed,
    /// By what they put pages in order.
    pub order: Order,
}

/// Figures of one policy at one pool size.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Run {
    /// The policy's name.
    pub policy: String,
    /// Bytes of a viewer's pool.
    pub pool_bytes: u64,
    /// Wanted pages summed over updates, root pages left out.
    pub requests: u64,
    /// Times that a page was not there when it began to be wanted.
    pub faults: u64,
    /// Faults a request.
    pub fault_rate: f64,
    /// Bytes of the pages that came.
    pub bytes_fetched: u64,
    /// Pages evicted.
    pub evictions: u64,
    /// Integral over time of the shown error beyond the one asked for, pixel seconds.
    pub error_seconds: f64,
    /// Integral over time of the error that missing pages would remove, summed over all groups of
    /// all instances, pixel seconds.
    pub total_error_seconds: f64,
    /// Seconds from a page's want to its being there, of pages that were missing and came.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_to_detail_secs: Option<Waits>,
    /// The same, where each page counts as the error that it removed over all instances: when half
    /// of the error was gone from the screen, and when all but a twentieth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_to_detail_by_error_secs: Option<Waits>,
    /// Pages that were missing and no longer wanted before they came.
    pub given_up: u64,
}

/// What was replayed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TraceFigures {
    /// Name of the scene.
    pub scene: String,
    /// Frames.
    pub frames: usize,
    /// Frames a second.
    pub fps: u32,
    /// Pages of the scene.
    pub pages: usize,
    /// Those of them that are always resident.
    pub root_pages: usize,
    /// Pages that some frame wants, root pages left out.
    pub distinct_pages_wanted: usize,
    /// The most that one frame wants, root pages left out.
    pub most_pages_wanted_at_once: usize,
}

/// A whole study.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Study {
    /// What was replayed.
    pub trace: TraceFigures,
    /// Viewers.
    pub viewers: usize,
    /// Their links.
    pub link: LinkSpeed,
    /// By what they put pages in order.
    pub order: Order,
    /// The pixel error that they asked for.
    pub pixel_error_asked: f32,
    /// One a policy and pool: policies in the order asked for, pools in theirs.
    pub runs: Vec<Run>,
}

/// Replays `trace` for every policy and pool.
///
/// # Errors
/// [`StreamError`] where a pool is too small or the pixel error no positive number.
pub fn study(trace: &Trace, options: &StudyOptions) -> Result<Study, StreamError> {
    let cells: Vec<(PolicyName, u64)> = options
        .policies
        .iter()
        .flat_map(|&policy| {
            options
                .pools_bytes
                .iter()
                .map(move |&pool_bytes| (policy, pool_bytes))
        })
        .collect();
    let runs = cells
        .into_par_iter()
        .map(|(policy, pool_bytes)| run(trace, options, policy, pool_bytes));
    Ok(Study {
        trace: TraceFigures::of(trace),
        viewers: options.viewers,
        link: options.link,
        order: options.order,
        pixel_error_asked: options.pixel_error_px,
        runs: runs.collect::<Result<_, _>>()?,
    })
}

fn run(
    trace: &Trace,
    options: &StudyOptions,
    policy: PolicyName,
    pool_bytes: u64,
) -> Result<Run, StreamError> {
    let outcomes = (0..options.viewers).into_par_iter().map(|viewer| {
        let replay_options = ReplayOptions {
            pool_bytes,
            pixel_error_px: options.pixel_error_px,
            link: options.link,
            order: options.order,
            first_frame: viewer * trace.frames.len() / options.viewers,
        };
        let future = match policy {
            PolicyName::Clairvoyant => {
                let recorder = Recorder::new(trace.header.pages.len());
                replay(trace, Box::new(recorder.clone()), replay_options)?;
                recorder.future()
            }
            _ => Future::default(),
        };
        let policy = policy.build(&future);
        let name = policy.name();
        Ok((name, replay(trace, policy, replay_options)?))
    });
    let outcomes: Vec<(&str, Outcome)> = outcomes.collect::<Result<_, StreamError>>()?;
    let name = outcomes.first().map_or("", |(name, _)| name).to_owned();
    Ok(sum(
        name,
        pool_bytes,
        outcomes.iter().map(|(_, outcome)| outcome),
    ))
}

fn sum<'a>(
    policy: String,
    pool_bytes: u64,
    outcomes: impl Iterator<Item = &'a Outcome> + Clone,
) -> Run {
    let total = |figure: fn(&Outcome) -> u64| outcomes.clone().map(figure).sum::<u64>();
    let (requests, faults) = (
        total(|outcome| outcome.requests),
        total(|outcome| outcome.faults),
    );
    let waits = outcomes
        .clone()
        .flat_map(|outcome| outcome.waits_secs.iter().copied());
    let by_error = outcomes.clone().flat_map(|outcome| {
        let waits = outcome.waits_secs.iter().copied();
        waits.zip(outcome.removed_px.iter().copied())
    });
    Run {
        policy,
        pool_bytes,
        requests,
        faults,
        fault_rate: faults as f64 / requests.max(1) as f64,
        bytes_fetched: total(|outcome| outcome.bytes_fetched),
        evictions: total(|outcome| outcome.evictions),
        error_seconds: outcomes.clone().map(|outcome| outcome.error_seconds).sum(),
        total_error_seconds: outcomes
            .clone()
            .map(|outcome| outcome.total_error_seconds)
            .sum(),
        time_to_detail_secs: Waits::of(&Sorted::new(waits.collect())),
        time_to_detail_by_error_secs: Waits::weighted(by_error.collect()),
        given_up: total(|outcome| outcome.given_up),
    }
}

impl TraceFigures {
    /// Counts the trace's pages and wants.
    pub fn of(trace: &Trace) -> Self {
        let is_root = |page: u32| trace.header.pages[page as usize].root;
        let mut wanted = vec![false; trace.header.pages.len()];
        let mut most = 0;
        for frame in &trace.frames {
            let pages = frame
                .requests
                .iter()
                .map(|&(page, ..)| page)
                .filter(|&page| !is_root(page));
            most = most.max(pages.map(|page| wanted[page as usize] = true).count());
        }
        Self {
            scene: trace.header.scene.clone(),
            frames: trace.frames.len(),
            fps: trace.header.fps,
            pages: trace.header.pages.len(),
            root_pages: trace.header.pages.iter().filter(|page| page.root).count(),
            distinct_pages_wanted: wanted.iter().filter(|&&wanted| wanted).count(),
            most_pages_wanted_at_once: most,
        }
    }
}
