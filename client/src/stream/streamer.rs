//! A residency with a source, on a tokio runtime: what a viewer calls once a frame, and what never makes it wait.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use lodestream_format::disk_form::DiskForm;
use tokio::runtime::Handle;
use tokio::sync::Semaphore;

use super::error::StreamError;
use super::fetch_timing::{FetchTiming, FetchTimings};
use super::get_transport::GetTransport;
use super::governor::PixelErrorLimit;
use super::install::Changes;
use super::opened_scene::OpenedScene;
use super::post_transport::PostTransport;
use super::residency::{Residency, ResidencyConfig};
use super::source::{Source, posts_need_http};
use super::stats::StreamStats;
use super::want::StreamingRequest;

/// How pages are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Transport {
    /// A GET a page range: every cache on the way can answer. The order is kept by having no more in flight than the link
    /// needs.
    #[default]
    Get,
    /// Posts that name everything in flight; the server sends the most urgent first, and a later post replaces the rest.
    Post,
}

/// What a task tells the frame thread.
pub(crate) enum Message {
    /// A page came or failed.
    Page {
        page: u32,
        /// When its bytes were there, before they were decompressed.
        came: Instant,
        result: Box<Result<DiskForm, StreamError>>,
    },
    /// A GET ended, and all its pages have been told of.
    GetEnded { fetch: u64 },
    /// The answer to a post ended, and all its pages have been told of.
    PostEnded {
        sequence: u64,
        error: Option<StreamError>,
    },
}

/// What a task needs.
#[derive(Clone)]
pub(crate) struct Shared {
    pub(crate) source: Source,
    pub(crate) scene: Arc<OpenedScene>,
    pub(crate) messages: Sender<Message>,
    /// Bounds the threads that decompress, so that the frame thread keeps its core.
    pub(crate) decoders: Arc<Semaphore>,
    pub(crate) runtime: Handle,
}

impl Shared {
    /// Tells of a page of the scene. The receiver is gone when the streamer is: then nobody needs to know.
    pub(crate) fn tell(&self, page: u32, came: Instant, result: Result<DiskForm, StreamError>) {
        let result = Box::new(result);
        let _ = self.messages.send(Message::Page { page, came, result });
    }
}

enum Sending {
    Get(GetTransport),
    Post(PostTransport),
}

/// See the module. Dropping it calls off all fetches.
pub struct Streamer {
    residency: Residency,
    shared: Shared,
    sending: Sending,
    arrivals: Receiver<Message>,
    started: Instant,
    timings: Option<FetchTimings>,
}

impl Streamer {
    /// Streams `scene` from the source that opened it; the tasks run on `runtime`.
    ///
    /// # Errors
    /// Those of [`Residency::new`], and [`StreamError::Setting`] where the source takes no posts but `transport` needs them.
    pub fn new(
        source: Source,
        scene: Arc<OpenedScene>,
        config: ResidencyConfig,
        transport: Transport,
        runtime: Handle,
    ) -> Result<Self, StreamError> {
        let residency = Residency::new(&scene, config)?;
        let sending = match transport {
            Transport::Get => Sending::Get(GetTransport::default()),
            Transport::Post if source.takes_posts() => Sending::Post(PostTransport::default()),
            Transport::Post => return Err(posts_need_http()),
        };
        let (messages, arrivals) = channel();
        let cores = std::thread::available_parallelism().map_or(2, |cores| cores.get());
        Ok(Self {
            residency,
            sending,
            arrivals,
            started: Instant::now(),
            timings: None,
            shared: Shared {
                source,
                scene,
                messages,
                decoders: Arc::new(Semaphore::new((cores / 2).clamp(1, 8))),
                runtime,
            },
        })
    }

    /// Takes a frame's readback; gives what the GPU has to do. Never waits.
    pub fn tick(&mut self, requests: &[StreamingRequest]) -> Changes {
        self.receive();
        let now_secs = self.now_secs();
        if let Some(timings) = &mut self.timings {
            timings.update += 1;
        }
        self.residency.update(now_secs, requests);
        self.send(now_secs);
        self.residency.take_changes()
    }

    /// The same for a frame that brought no readback. An empty readback would say that nothing is wanted.
    pub fn poll(&mut self) -> Changes {
        self.receive();
        self.send(self.now_secs());
        self.residency.take_changes()
    }

    /// Waits until something came, at most `timeout`; says whether something did. For viewers without a window, which have
    /// nothing else to do; the next tick hands it out.
    pub fn wait(&mut self, timeout: Duration) -> bool {
        match self.arrivals.recv_timeout(timeout) {
            Ok(message) => {
                self.take(message);
                true
            }
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => false,
        }
    }

    fn now_secs(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn receive(&mut self) {
        while let Ok(message) = self.arrivals.try_recv() {
            self.take(message);
        }
    }

    fn take(&mut self, message: Message) {
        let now_secs = self.now_secs();
        match (message, &mut self.sending) {
            (Message::Page { page, came, result }, sending) => {
                if let Some(timings) = &mut self.timings {
                    timings.arrived(page, came, result.as_ref().as_ref().err());
                }
                if let Sending::Post(post) = sending {
                    post.arrived(page);
                }
                self.residency.arrived(page, *result, now_secs);
            }
            (Message::GetEnded { fetch }, Sending::Get(get)) => get.ended(fetch),
            (Message::PostEnded { sequence, error }, Sending::Post(post)) => {
                for (page, error) in post.ended(sequence, error) {
                    if let Some(timings) = &mut self.timings {
                        timings.arrived(page, Instant::now(), Some(&error));
                    }
                    self.residency.arrived(page, Err(error), now_secs);
                }
            }
            // Each transport tells of its own ends only.
            (Message::GetEnded { .. }, Sending::Post(_))
            | (Message::PostEnded { .. }, Sending::Get(_)) => {}
        }
    }

    fn send(&mut self, now_secs: f64) {
        let cancelled = self.residency.cancelled();
        let fetches = self.residency.next_fetches(now_secs);
        if let Some(timings) = &mut self.timings {
            cancelled.iter().for_each(|&fetch| timings.cancelled(fetch));
            let (pages, now) = (self.residency.pages(), Instant::now());
            for fetch in &fetches {
                let range = pages.fetched(fetch);
                let bytes = range.clone().map(|page| u64::from(pages.frame_bytes(page)));
                timings.issued(fetch.id, range.clone(), bytes.sum(), now);
            }
        }
        match &mut self.sending {
            Sending::Get(get) => get.send(&cancelled, &fetches, &self.shared),
            Sending::Post(post) => {
                post.send(
                    &cancelled,
                    &fetches,
                    &self.residency,
                    now_secs,
                    &self.shared,
                );
            }
        }
    }

    /// From now on notes how long fetches take, for [`Streamer::take_timings`].
    pub fn time_fetches(&mut self) {
        self.timings.get_or_insert_default();
    }

    /// Fetches that ended since the last call.
    pub fn take_timings(&mut self) -> Vec<FetchTiming> {
        self.timings.as_mut().map_or(Vec::new(), FetchTimings::take)
    }

    /// The residency, for its questions: settled, stalled, pixel error, layout.
    pub fn residency(&self) -> &Residency {
        &self.residency
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<OpenedScene> {
        &self.shared.scene
    }

    /// See [`Residency::pixel_error`].
    pub fn pixel_error(&self) -> f32 {
        self.residency.pixel_error()
    }

    /// See [`Residency::pixel_error_limit`].
    pub fn pixel_error_limit(&self) -> PixelErrorLimit {
        self.residency.pixel_error_limit()
    }

    /// See [`Residency::set_pixel_error`].
    pub fn set_pixel_error(&mut self, asked_px: f32) -> Result<(), StreamError> {
        self.residency.set_pixel_error(asked_px)
    }

    /// See [`Residency::view_changed`].
    pub fn view_changed(&mut self) {
        self.residency.view_changed();
    }

    /// See [`Residency::is_settled`].
    pub fn is_settled(&self) -> bool {
        self.residency.is_settled()
    }

    /// See [`Residency::stats`].
    pub fn stats(&self) -> StreamStats {
        self.residency.stats()
    }
}
