//! One virtual viewer: open, stand, walk.

use std::sync::Arc;
use std::time::{Duration, Instant};

use lodestream_client::stream::{
    FetchTiming, OpenedScene, ResidencyConfig, Source, StreamError, Streamer, StreamingRequest,
};
use lodestream_shaders::cpu::Camera;
use tokio::runtime::Handle;

use super::Shared;
use crate::viewer::{Orbit, ViewedScene};

/// Wait before a scene that did not open is asked for again.
const OPEN_AGAIN: Duration = Duration::from_millis(500);
/// Most errors that a viewer keeps; it stops there, since a server that answers nothing is examined enough.
const MOST_ERRORS: usize = 10_000;

/// A scene in memory, once for all viewers of the process.
#[derive(Debug)]
pub(super) struct SharedScene {
    opened: Arc<OpenedScene>,
    viewed: Arc<ViewedScene>,
}

impl SharedScene {
    pub(super) fn new(opened: OpenedScene) -> Self {
        Self {
            viewed: Arc::new(ViewedScene::new(&opened)),
            opened: Arc::new(opened),
        }
    }

    /// Whether both were opened from the same manifest: else the scene was published anew meanwhile.
    fn is(&self, other: &OpenedScene) -> bool {
        let assets = |scene: &OpenedScene| {
            scene
                .assets
                .iter()
                .map(|asset| asset.hash)
                .collect::<Vec<_>>()
        };
        assets(&self.opened) == assets(other)
            && self.opened.scene.instances == other.scene.instances
    }
}

/// What a viewer came to.
#[derive(Debug, Default)]
pub(super) struct ViewerOutcome {
    pub(super) requests: u64,
    pub(super) pages: u64,
    pub(super) bytes: u64,
    pub(super) errors: Vec<StreamError>,
    /// From the planned time of the update that asked.
    pub(super) latencies_ms: Vec<f64>,
    /// From the time when it really asked.
    pub(super) service_ms: Vec<f64>,
    pub(super) open_secs: Option<f64>,
    pub(super) settled_secs: Option<f64>,
    pub(super) updates_planned: u64,
    pub(super) updates_on_time: u64,
    pub(super) pages_evicted: u64,
}

pub(super) struct Viewer {
    shared: Arc<Shared>,
    index: usize,
    source: Source,
    /// Planned; all times of this viewer count from here.
    start: Instant,
    outcome: ViewerOutcome,
}

/// The last requests, with what they were made for: a viewer that stands still asks for the same again.
type Culled = (Camera, f32, Arc<Vec<StreamingRequest>>);

impl Viewer {
    pub(super) fn new(shared: Arc<Shared>, index: usize, source: Source) -> Self {
        // Spread over one interval, so that updates do not come in bursts that no real audience makes.
        let share = index as f64 / shared.options.viewers as f64;
        let start = shared.started + Duration::from_secs_f64(share / shared.options.rate);
        Self {
            shared,
            index,
            source,
            start,
            outcome: ViewerOutcome::default(),
        }
    }

    /// Runs until the end of the test. Failures are counted.
    pub(super) async fn run(mut self) -> ViewerOutcome {
        tokio::time::sleep_until(self.start.into()).await;
        if let Some(scene) = self.open().await
            && let Err(error) = self.look(&scene).await
        {
            self.outcome.errors.push(error);
        }
        self.outcome
    }

    async fn open(&mut self) -> Option<Arc<SharedScene>> {
        let shared = self.shared.clone();
        let (name, known) = &shared.scenes[self.index % shared.scenes.len()];
        let end = tokio::time::Instant::from(shared.end());
        while tokio::time::Instant::now() < end && self.outcome.errors.len() < MOST_ERRORS {
            let Ok(opened) = tokio::time::timeout_at(end, self.source.open(name)).await else {
                break;
            };
            self.outcome.requests += 1;
            match opened {
                Ok(opened) => {
                    self.outcome.open_secs = Some(self.start.elapsed().as_secs_f64());
                    self.outcome.bytes += opened.open_bytes;
                    return Some(match known.is(&opened) {
                        true => known.clone(),
                        false => Arc::new(SharedScene::new(opened)),
                    });
                }
                Err(error) => {
                    self.outcome.errors.push(error);
                    tokio::time::sleep(OPEN_AGAIN).await;
                }
            }
        }
        None
    }

    async fn look(&mut self, scene: &SharedScene) -> Result<(), StreamError> {
        let options = &self.shared.options;
        let config = ResidencyConfig {
            pixel_error_px: options.pixel_error_px,
            // Requests are made for the very update that takes them.
            readback_updates: 1,
            ..ResidencyConfig::new(options.pool_bytes)
        };
        let (source, runtime) = (self.source.clone(), Handle::current());
        let mut streamer = Streamer::new(
            source,
            scene.opened.clone(),
            config,
            options.transport,
            runtime,
        )?;
        streamer.time_fetches();
        let interval = Duration::from_secs_f64(1.0 / options.rate);
        let stand_at_most = Duration::from_secs_f64(options.seconds / 2.0);
        let orbit = Orbit::new(&scene.viewed, options.seed.wrapping_add(self.index as u64));
        let (opened, end) = (Instant::now(), self.shared.end());
        let mut plan = Plan {
            next: opened,
            interval,
        };
        // Planned times of the updates, to count latencies from.
        let mut planned_at: Vec<Instant> = Vec::new();
        let (mut walk_began, mut last_change): (Option<Instant>, Instant) = (None, opened);
        let mut culled: Option<Culled> = None;
        while plan.next < end && self.outcome.errors.len() < MOST_ERRORS {
            tokio::time::sleep_until(plan.next.into()).await;
            let planned = plan.take(Instant::now(), &mut self.outcome);
            let walked_secs =
                walk_began.map_or(0.0, |began| (planned - began.min(planned)).as_secs_f64());
            let camera = orbit.camera(walked_secs);
            let requests = self
                .cull(scene, camera, streamer.pixel_error(), &mut culled)
                .await;
            planned_at.push(planned);
            self.outcome.updates_on_time += u64::from(Instant::now() <= planned + interval);
            let changes = streamer.tick(&requests);
            if !changes.is_empty() {
                last_change = Instant::now();
            }
            for timing in streamer.take_timings() {
                self.count(timing, &planned_at);
            }
            if walk_began.is_none() && streamer.is_settled() {
                self.outcome.settled_secs = Some((last_change - self.start).as_secs_f64());
            }
            if walk_began.is_none() && (streamer.is_settled() || opened.elapsed() > stand_at_most) {
                walk_began = Some(planned);
            }
        }
        self.outcome.pages_evicted = streamer.stats().pages_evicted;
        Ok(())
    }

    /// The pages that the camera wants, found on a thread of its own where they are not known yet.
    async fn cull(
        &self,
        scene: &SharedScene,
        camera: Camera,
        pixel_error_px: f32,
        culled: &mut Option<Culled>,
    ) -> Arc<Vec<StreamingRequest>> {
        if let Some((for_camera, for_px, requests)) = culled
            && (*for_camera, *for_px) == (camera, pixel_error_px)
        {
            return requests.clone();
        }
        // Never closed, so the permit always comes.
        let _permit = self.shared.cullers.acquire().await;
        let viewed = scene.viewed.clone();
        let requests =
            tokio::task::spawn_blocking(move || viewed.requests(&camera, pixel_error_px)).await;
        let requests = match requests {
            Ok(requests) => Arc::new(requests),
            Err(error) => std::panic::resume_unwind(error.into_panic()),
        };
        *culled = Some((camera, pixel_error_px, requests.clone()));
        requests
    }

    fn count(&mut self, timing: FetchTiming, planned_at: &[Instant]) {
        self.outcome.requests += 1;
        // Updates count from 1.
        let planned = planned_at
            .get((timing.update as usize).saturating_sub(1))
            .copied();
        let from = planned.unwrap_or(timing.issued).min(timing.issued);
        let ms_since = |from: Instant| (timing.ended - from).as_secs_f64() * 1e3;
        self.outcome.latencies_ms.push(ms_since(from));
        self.outcome.service_ms.push(ms_since(timing.issued));
        match timing.error {
            Some(error) => self.outcome.errors.push(error),
            None => {
                self.outcome.pages += timing.pages as u64;
                self.outcome.bytes += timing.bytes;
            }
        }
    }
}

/// When updates are due.
struct Plan {
    next: Instant,
    interval: Duration,
}

impl Plan {
    /// When the update to do now was due. Older ones that are overdue are left out: they count as planned all the same.
    fn take(&mut self, now: Instant, outcome: &mut ViewerOutcome) -> Instant {
        let mut planned = self.next;
        outcome.updates_planned += 1;
        while planned + self.interval <= now {
            planned += self.interval;
            outcome.updates_planned += 1;
        }
        self.next = planned + self.interval;
        planned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overdue_updates_are_left_out_and_counted() {
        let start = Instant::now();
        let interval = Duration::from_millis(100);
        let at = |ms| start + Duration::from_millis(ms);
        let mut plan = Plan {
            next: start,
            interval,
        };
        let mut outcome = ViewerOutcome::default();
        assert_eq!(plan.take(at(5), &mut outcome), start);
        assert_eq!(plan.take(at(190), &mut outcome), at(100));
        assert_eq!(outcome.updates_planned, 2);
        // Due at 200, done at 450: 200 and 300 are left out.
        assert_eq!(plan.take(at(450), &mut outcome), at(400));
        assert_eq!(outcome.updates_planned, 5);
        assert_eq!(plan.next, at(500));
    }
}
