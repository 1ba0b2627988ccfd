//! Residency: which pages are wanted, fetched, kept and installed. A pure state machine: no clock, no I/O, no chance; the
//! same calls give the same answers.
//!
//! A frame calls [`Residency::update`] with the requests that were read back, [`Residency::arrived`] for what came,
//! [`Residency::next_fetches`] and [`Residency::cancelled`] for what to send and call off, and [`Residency::take_changes`]
//! for what the GPU has to do. `arrive.rs` holds the second, `order.rs` the third, `install.rs` the last.

use std::collections::BTreeMap;

use lodestream_format::disk_form::DiskForm;

use super::error::StreamError;
use super::governor::{Governor, PixelErrorControl, PixelErrorLimit};
use super::install::Upload;
use super::opened_scene::OpenedScene;
use super::page_state::{PageEvent, PageState};
use super::policy::{DecayedError, EvictionPolicy};
use super::pool::{PoolLayout, Slots};
use super::scene_pages::{PageFacts, ScenePages};
use super::stats::StreamStats;
use super::want::{Closure, StreamingRequest, Want, admit, is_hidden};
use super::window::{Ticket, Window};

/// Settings of a [`Residency`].
pub struct ResidencyConfig {
    /// Bytes of the page pool.
    pub pool_bytes: u64,
    /// Pixel error that the user asked for.
    pub pixel_error_px: f32,
    /// Whether the pixel error rises when the pool is too small.
    pub control: PixelErrorControl,
    /// Most bytes in flight or waiting for a slot in host memory, whatever the window says.
    pub max_in_flight_bytes: u64,
    /// Most pages that one [`Residency::take_changes`] uploads: bounds what streaming adds to a frame.
    pub max_uploads: usize,
    /// Updates from a new camera or pixel error to the first requests made with it, at least: what settling and the
    /// governor wait for.
    pub readback_updates: u32,
    /// Whether hidden pages are fetched, after all visible ones. A still picture never needs them.
    pub fetches_hidden: bool,
    /// Who leaves.
    pub policy: Box<dyn EvictionPolicy>,
}

impl ResidencyConfig {
    /// The defaults over a pool of `pool_bytes`.
    pub fn new(pool_bytes: u64) -> Self {
        Self {
            pool_bytes,
            pixel_error_px: 1.0,
            control: PixelErrorControl::default(),
            max_in_flight_bytes: 64 << 20,
            max_uploads: 64,
            readback_updates: 8,
            fetches_hidden: true,
            policy: Box::new(DecayedError::default()),
        }
    }
}

/// Updates that a page under way may go unwanted before it is given up: culling flickers at the borders.
const LINGER_UPDATES: u64 = 4;
/// `fetch` of a page that is in none.
pub(super) const NO_FETCH: u64 = 0;
/// `slot` of a page that has none.
pub(super) const NO_SLOT: u32 = u32::MAX;

/// What is known of a page.
#[derive(Debug, Clone, Copy)]
pub(super) struct PageRecord {
    pub(super) state: PageState,
    /// The update that admitted it last.
    pub(super) wanted_update: u64,
    /// Its priority then.
    pub(super) priority_px: f32,
    /// Installed pages that depend on it.
    pub(super) installed_dependents: u32,
    pub(super) slot: u32,
    pub(super) fetch: u64,
    /// In a row.
    pub(super) failures: u32,
}

/// A fetch under way.
#[derive(Debug, Clone)]
pub(super) struct InFlight {
    pub(super) ticket: Ticket,
    /// Pages not yet come.
    pub(super) pages: Vec<u32>,
}

/// What arrives of a page. A viewer's is the checked disk form; a simulation keeps the number alone.
pub trait PageForm {
    /// Number of the page in its asset.
    fn page(&self) -> u32;

    /// Page of its asset and cluster of each parent that vertices are inherited from; the page depends on those pages.
    fn parents(&self) -> &[[u32; 2]];
}

impl PageForm for DiskForm {
    fn page(&self) -> u32 {
        DiskForm::page(self)
    }

    fn parents(&self) -> &[[u32; 2]] {
        DiskForm::parents(self)
    }
}

/// See the module.
pub struct Residency<Form = DiskForm> {
    pub(super) pages: ScenePages,
    pub(super) layout: PoolLayout,
    pub(super) records: Vec<PageRecord>,
    pub(super) slots: Slots,
    pub(super) policy: Box<dyn EvictionPolicy>,
    pub(super) decoded: BTreeMap<u32, Form>,
    pub(super) decoded_bytes: u64,
    /// Root pages before the first `take_changes`.
    pub(super) roots: Vec<Upload<Form>>,
    /// Admitted and not installed, ascending.
    pub(super) missing: Vec<u32>,
    pub(super) fetches: BTreeMap<u64, InFlight>,
    pub(super) in_flight_bytes: u64,
    pub(super) last_fetch: u64,
    pub(super) window: Window,
    pub(super) update_count: u64,
    pub(super) quiet_updates: u32,
    pub(super) stats: StreamStats,
    pub(super) max_in_flight_bytes: u64,
    pub(super) max_uploads: usize,
    readback_updates: u32,
    fetches_hidden: bool,
    closure: Closure,
    governor: Governor,
    cancelled: Vec<u64>,
}

impl Residency {
    /// Nothing is installed before the first [`Residency::take_changes`], which brings the root pages.
    ///
    /// # Errors
    /// [`StreamError::Pool`] where the pool is too small; [`StreamError::Setting`] where the pixel error is not a positive
    /// number.
    pub fn new(scene: &OpenedScene, config: ResidencyConfig) -> Result<Self, StreamError> {
        let layout = PoolLayout::new(scene, config.pool_bytes)?;
        let forms = scene.assets.iter().flat_map(|opened| &opened.root_pages);
        let roots = layout.roots.iter().zip(forms).map(|(&place, form)| Upload {
            page: place.0,
            word_offset: place.1,
            parents: Vec::new(),
            form: form.clone(),
        });
        let roots = roots.collect();
        Self::start(ScenePages::new(scene), layout, roots, config)
    }
}

impl<Form: PageForm> Residency<Form> {
    /// Over pages without a scene: `root_form` makes what stands for a root page of its number in its asset.
    ///
    /// # Errors
    /// Those of [`Residency::new`] and [`ScenePages::of_pages`].
    pub fn over(
        facts: &[PageFacts],
        root_form: impl Fn(u32) -> Form,
        config: ResidencyConfig,
    ) -> Result<Self, StreamError> {
        let pages = ScenePages::of_pages(facts)?;
        let roots = (0..).zip(facts).filter(|(_, page)| page.is_root);
        let root_words = roots.map(|(number, page)| (number, page.memory_words));
        let layout = PoolLayout::over(root_words, config.pool_bytes)?;
        let roots = layout.roots.iter().map(|&(page, word_offset)| Upload {
            page,
            word_offset,
            parents: Vec::new(),
            form: root_form(pages.number_in_asset(page)),
        });
        let roots = roots.collect();
        Self::start(pages, layout, roots, config)
    }

    fn start(
        pages: ScenePages,
        layout: PoolLayout,
        roots: Vec<Upload<Form>>,
        config: ResidencyConfig,
    ) -> Result<Self, StreamError> {
        check_pixel_error(config.pixel_error_px)?;
        let record = PageRecord {
            state: PageState::Absent,
            wanted_update: 0,
            priority_px: 0.0,
            installed_dependents: 0,
            slot: NO_SLOT,
            fetch: NO_FETCH,
            failures: 0,
        };
        let mut residency = Self {
            roots,
            records: vec![record; pages.count() as usize],
            slots: Slots::new(layout.slot_count),
            closure: Closure::new(pages.count()),
            governor: Governor::new(
                config.control,
                config.pixel_error_px,
                config.readback_updates,
            ),
            policy: config.policy,
            decoded: BTreeMap::new(),
            decoded_bytes: 0,
            missing: Vec::new(),
            fetches: BTreeMap::new(),
            in_flight_bytes: 0,
            last_fetch: NO_FETCH,
            window: Window::default(),
            update_count: 0,
            quiet_updates: 0,
            stats: StreamStats::default(),
            max_in_flight_bytes: config.max_in_flight_bytes,
            max_uploads: config.max_uploads.max(1),
            readback_updates: config.readback_updates.max(1),
            fetches_hidden: config.fetches_hidden,
            cancelled: Vec::new(),
            pages,
            layout,
        };
        for page in residency.layout.roots.clone() {
            residency.step(page.0, PageEvent::Open);
        }
        Ok(residency)
    }

    /// Takes what the GPU read back; once a frame that brought a readback.
    pub fn update(&mut self, now_secs: f64, requests: &[StreamingRequest]) {
        self.update_count += 1;
        let (mut wants, ignored) = self.closure.close(requests, &self.pages);
        self.stats.ignored_requests += ignored;
        // Hidden pages take only free slots: they raise no pixel error.
        let seen: Vec<Want> = wants
            .iter()
            .copied()
            .filter(|want| !want.is_hidden())
            .collect();
        if let Some(threshold_px) = self.governor.step(&seen, self.layout.slot_count as usize) {
            wants.retain(|want| want.error_px > threshold_px);
        }
        let records = &self.records;
        if !self.fetches_hidden {
            let installed = |page: u32| records[page as usize].state == PageState::Installed;
            wants.retain(|want| !want.is_hidden() || installed(want.page));
        }
        admit(&mut wants, self.layout.slot_count as usize, |page| {
            records[page as usize].state == PageState::Installed
        });
        self.stats.requests += wants.len() as u64;
        self.stats.pages_wanted = wants.len() as u64;
        self.want(&wants);
        self.end_back_offs(now_secs);
        self.cancel_unwanted();
        let quiet = self.sees_all() && self.governor.is_steady();
        self.quiet_updates = if quiet {
            self.quiet_updates.saturating_add(1)
        } else {
            0
        };
    }

    /// Marks what is wanted now, and forgets what was wanted before and was not yet asked for.
    fn want(&mut self, wants: &[Want]) {
        let before = std::mem::take(&mut self.missing);
        for &Want {
            page, priority_px, ..
        } in wants
        {
            self.policy.wanted(page, priority_px, self.update_count);
            let record = &mut self.records[page as usize];
            record.wanted_update = self.update_count;
            record.priority_px = priority_px;
            if record.state == PageState::Absent {
                self.stats.faults += 1;
                self.step(page, PageEvent::Want);
            }
            if self.state(page) != PageState::Installed {
                self.missing.push(page);
            }
        }
        for page in before {
            if self.state(page) == PageState::Wanted && !self.is_wanted(page) {
                self.step(page, PageEvent::Forget);
            }
        }
    }

    fn cancel_unwanted(&mut self) {
        let unwanted = |&page: &u32| !self.lingers(page);
        let called_off: Vec<u64> = self
            .fetches
            .iter()
            .filter(|(_, fetch)| fetch.pages.iter().all(unwanted))
            .map(|(&id, _)| id)
            .collect();
        for id in called_off {
            let pages = self
                .fetches
                .remove(&id)
                .map_or(Vec::new(), |fetch| fetch.pages);
            for page in pages {
                self.in_flight_bytes -= self.pages.frame_bytes(page) as u64;
                self.records[page as usize].fetch = NO_FETCH;
                self.step(page, PageEvent::Cancel);
            }
            self.stats.fetches_cancelled += 1;
            self.cancelled.push(id);
        }
    }

    /// Numbers of the fetches to call off, since the last call. What still comes of them does no harm.
    pub fn cancelled(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.cancelled)
    }

    /// The pixel error to cull with: what the user asked for, or more where the pool is too small.
    pub fn pixel_error(&self) -> f32 {
        self.governor.shown_px()
    }

    /// Why [`Residency::pixel_error`] is what it is.
    pub fn pixel_error_limit(&self) -> PixelErrorLimit {
        self.governor.limit()
    }

    /// Changes what the user asks for.
    ///
    /// # Errors
    /// [`StreamError::Setting`] where it is not a positive number; the old one stays.
    pub fn set_pixel_error(&mut self, asked_px: f32) -> Result<(), StreamError> {
        check_pixel_error(asked_px)?;
        self.governor.ask(asked_px);
        self.quiet_updates = 0;
        Ok(())
    }

    /// Whether the last updates found all visible pages installed, no visible page is under way,
    /// and the pixel error stays. Hidden pages may still come.
    pub fn is_settled(&self) -> bool {
        self.quiet_updates >= self.readback_updates && self.sees_all()
    }

    /// Tells that the camera or the scene moved; to be called with every frame in which it did. Readbacks on their way say
    /// nothing about the new view, so [`Residency::is_settled`] waits until they have come, and the pixel error may probe anew
    /// what did not fit.
    pub fn view_changed(&mut self) {
        self.governor.view_changed();
        self.quiet_updates = 0;
    }

    /// Whether all that is missing waits for the end of a back-off, or for a page that does: nothing will change soon.
    pub fn is_stalled(&self) -> bool {
        let under_way = !self.fetches.is_empty() || !self.roots.is_empty();
        let failed = |&page: &u32| matches!(self.state(page), PageState::Failed { .. });
        // What came and waits for a page that failed is missing and blocked too.
        !under_way
            && self.missing.iter().any(failed)
            && self.blocked().iter().all(|&blocked| blocked)
    }

    /// Whether nothing is missing or under way, hidden pages included.
    pub fn is_idle(&self) -> bool {
        self.missing.is_empty()
            && self.fetches.is_empty()
            && self.decoded.is_empty()
            && self.roots.is_empty()
    }

    /// Whether no visible page is missing or under way.
    fn sees_all(&self) -> bool {
        let hidden = |page: &u32| is_hidden(self.records[*page as usize].priority_px);
        self.missing.iter().all(hidden)
            && self
                .fetches
                .values()
                .all(|fetch| fetch.pages.iter().all(hidden))
            && self.decoded.keys().all(hidden)
            && self.roots.is_empty()
    }

    /// How things stand.
    pub fn stats(&self) -> StreamStats {
        let failed = |&&page: &&u32| matches!(self.state(page), PageState::Failed { .. });
        let hidden = |page: &&u32| is_hidden(self.records[**page as usize].priority_px);
        let hidden_missing = self.missing.iter().filter(hidden).count() as u64;
        StreamStats {
            pages_resident: (self.slots.used() + self.layout.roots.len()) as u64,
            pages_missing: self.missing.len() as u64 - hidden_missing,
            pages_hidden_missing: hidden_missing,
            pages_failed: self.missing.iter().filter(failed).count() as u64,
            fetches_in_flight: self.fetches.len() as u64,
            bytes_in_flight: self.in_flight_bytes,
            window_bytes: self.window.bytes().min(self.max_in_flight_bytes),
            bytes_a_sec: self.window.bytes_a_sec(),
            latency_secs: self.window.latency_secs(),
            pool_bytes: self.layout.bytes(),
            pool_slots: self.layout.slot_count as u64,
            pixel_error_asked: self.governor.asked_px(),
            pixel_error_shown: self.governor.shown_px(),
            ..self.stats.clone()
        }
    }

    /// Sizes and dependencies of the pages.
    pub fn pages(&self) -> &ScenePages {
        &self.pages
    }

    /// Where everything lies in the pool.
    pub fn layout(&self) -> &PoolLayout {
        &self.layout
    }

    /// State of a scene-wide page; absent past the last one.
    pub fn page_state(&self, page: u32) -> PageState {
        self.records
            .get(page as usize)
            .map_or(PageState::Absent, |record| record.state)
    }

    pub(super) fn state(&self, page: u32) -> PageState {
        self.records[page as usize].state
    }

    /// Whether the last update admitted the page.
    pub(super) fn is_wanted(&self, page: u32) -> bool {
        self.update_count > 0 && self.records[page as usize].wanted_update == self.update_count
    }

    /// Whether one of the last updates admitted the page, so that the next one may again.
    pub(super) fn lingers(&self, page: u32) -> bool {
        self.records[page as usize].wanted_update + LINGER_UPDATES > self.update_count
    }

    /// Priority of a page when it was admitted last, pixels; 0 past the last page.
    pub fn priority_px(&self, page: u32) -> f32 {
        self.records
            .get(page as usize)
            .map_or(0.0, |record| record.priority_px)
    }

    /// Moves a page along the diagram of `page_state.rs`.
    pub(super) fn step(&mut self, page: u32, event: PageEvent) {
        let record = &mut self.records[page as usize];
        match record.state.after(event) {
            Ok(state) => record.state = state,
            Err(error) => {
                tracing::error!(page, %error);
                self.stats.illegal_transitions += 1;
                debug_assert!(false, "page {page}: {error}");
            }
        }
    }
}

fn check_pixel_error(px: f32) -> Result<(), StreamError> {
    if px > 0.0 && px.is_finite() {
        return Ok(());
    }
    Err(StreamError::Setting {
        setting: "pixel error",
        expected: "a positive number of pixels".to_owned(),
        found: px.to_string(),
    })
}
