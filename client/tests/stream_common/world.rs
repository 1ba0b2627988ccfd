//! A residency with the GPU and the network around it, frame by frame.

use std::collections::VecDeque;

use lodestream_client::stream::{
    Candidate, DecayedError, EvictionPolicy, LowestError, Lru, PageState, PixelErrorControl,
    Residency, StreamError, StreamingRequest,
};
use proptest::prelude::*;

use super::pool_model::PoolModel;
use super::{MadeScene, Random, Size, config};

/// Answers anything, also numbers past the candidates.
struct Wild(Random);

impl EvictionPolicy for Wild {
    fn name(&self) -> &'static str {
        "wild"
    }

    fn victim(&mut self, candidates: &[Candidate], _: u64) -> usize {
        assert!(!candidates.is_empty());
        self.0.below(2 * candidates.len() as u32) as usize
    }
}

fn policy(number: u32) -> Box<dyn EvictionPolicy> {
    match number {
        0 => Box::new(Lru),
        1 => Box::new(LowestError),
        2 => Box::new(DecayedError::default()),
        _ => Box::new(Wild(Random(7))),
    }
}

#[derive(Debug, Clone)]
pub struct Case {
    pub seed: u64,
    pub size: Size,
    pub slots: u32,
    pub policy: u32,
    pub control: PixelErrorControl,
    pub lag: usize,
    pub max_uploads: usize,
}

pub fn case() -> impl Strategy<Value = Case> {
    let size = (1u32..4, 1u32..40, 1u32..6).prop_map(|(assets, finest_groups, levels)| Size {
        assets,
        finest_groups,
        levels,
    });
    let control =
        prop_oneof![3 => Just(PixelErrorControl::Governed), 1 => Just(PixelErrorControl::Fixed)];
    (
        any::<u64>(),
        size,
        4u32..60,
        0u32..4,
        control,
        0usize..7,
        1usize..20,
    )
        .prop_map(
            |(seed, size, slots, policy, control, lag, max_uploads)| Case {
                seed,
                size,
                slots,
                policy,
                control,
                lag,
                max_uploads,
            },
        )
}

/// A residency with the GPU and the network around it.
pub struct World<'a> {
    pub scene: &'a MadeScene,
    pub residency: Residency,
    pub gpu: PoolModel<'a>,
    /// Pages handed out and not answered, with their fetch; also of fetches that were called off.
    pub network: Vec<(u64, u32)>,
    /// Readbacks on their way.
    pub readbacks: VecDeque<Vec<StreamingRequest>>,
    pub eye: [f32; 3],
    pub half: bool,
    pub now_secs: f64,
    pub fetched: u64,
    pub called_off: u64,
}

impl<'a> World<'a> {
    pub fn new(scene: &'a MadeScene, case: &Case) -> Self {
        let mut settings = config(&scene.opened, case.slots, case.control);
        settings.policy = policy(case.policy);
        settings.max_uploads = case.max_uploads;
        let residency = Residency::new(&scene.opened, settings).unwrap();
        assert_eq!(residency.layout().slot_count, case.slots);
        Self {
            scene,
            gpu: PoolModel::new(scene, residency.layout()),
            residency,
            network: Vec::new(),
            readbacks: VecDeque::from(vec![vec![]; case.lag]),
            eye: [15.0, 0.0, 0.0],
            half: false,
            now_secs: 0.0,
            fetched: 0,
            called_off: 0,
        }
    }

    /// One frame: cull, read back what an earlier frame wrote, stream, draw.
    pub fn frame(&mut self, secs: f64) -> usize {
        self.now_secs += secs;
        let pixel_error_px = self.residency.pixel_error();
        let requests = self.scene.requests(self.eye, self.half, pixel_error_px);
        self.readbacks.push_back(requests);
        let requests = self.readbacks.pop_front().unwrap();
        self.residency.update(self.now_secs, &requests);
        self.called_off += self.residency.cancelled().len() as u64;
        let mut sent = 0;
        for fetch in self.residency.next_fetches(self.now_secs) {
            let base = self.scene.opened.assets[fetch.asset_index].page_base;
            for local in fetch.first_page..=fetch.last_page {
                self.check_order(base + local, fetch.id);
                self.network.push((fetch.id, base + local));
                sent += 1;
            }
        }
        self.fetched += sent as u64;
        let changes = self.residency.take_changes();
        self.gpu.apply(&changes);
        self.gpu.check_cut(self.eye, self.residency.pixel_error());
        let stats = self.residency.stats();
        assert_eq!(stats.pages_resident, self.gpu.installed() as u64);
        assert_eq!(stats.illegal_transitions, 0);
        sent
    }

    /// Nothing is asked for before what it depends on.
    fn check_order(&self, page: u32, _fetch: u64) {
        let (index, local) = self.scene.opened.locate(page).unwrap();
        let opened = &self.scene.opened.assets[index];
        for dependency in &opened.asset.pages[local as usize].dependencies {
            let state = self.residency.page_state(opened.page_base + dependency);
            let asked = matches!(
                state,
                PageState::InFlight
                    | PageState::Decoded
                    | PageState::Resident
                    | PageState::Installed
            );
            assert!(asked, "page {page} before page {dependency}: {state:?}");
        }
    }

    pub fn answer(&mut self, at: usize, fails: bool) {
        let (_, page) = self.network.swap_remove(at);
        let result = if fails {
            Err(StreamError::NotFound {
                place: format!("page {page}"),
            })
        } else {
            Ok(self.scene.decoded(page))
        };
        self.residency.arrived(page, result, self.now_secs);
    }

    pub fn answer_all(&mut self) {
        while !self.network.is_empty() {
            self.answer(0, false);
        }
    }

    /// Frames until settled, everything answered at once; panics if that never comes.
    pub fn settle(&mut self) {
        self.residency.view_changed();
        for _ in 0..2000 {
            self.frame(0.25);
            self.answer_all();
            if self.residency.is_settled() {
                return;
            }
        }
        panic!("never settled: {:?}", self.residency.stats());
    }

    /// Pages that are wanted at a pixel error, dependencies included, root pages left out.
    pub fn wanted(&self, pixel_error_px: f32) -> Vec<u32> {
        let mut wanted = vec![false; self.scene.opened.page_count() as usize];
        for request in self.scene.requests(self.eye, self.half, pixel_error_px) {
            wanted[request.page as usize] = true;
        }
        for opened in self.scene.opened.assets.iter().rev() {
            let entries = opened.asset.pages.iter().enumerate().rev();
            for (page, entry) in
                entries.map(|(local, entry)| (opened.page_base as usize + local, entry))
            {
                if wanted[page] {
                    for dependency in &entry.dependencies {
                        wanted[(opened.page_base + dependency) as usize] = true;
                    }
                }
            }
            wanted[opened.page_base as usize..][..opened.asset.root_page_count as usize]
                .fill(false);
        }
        (0..)
            .zip(wanted)
            .filter(|(_, wanted)| *wanted)
            .map(|(page, _)| page)
            .collect()
    }
}
