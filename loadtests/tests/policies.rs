//! Policies against what is known to be true of them: the bound is a bound, and no policy breaks an invariant.
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

use std::collections::{BTreeMap, BTreeSet};

use lodestream_client::stream::{
    PageFacts, PixelErrorControl, Residency, ResidencyConfig, StreamingRequest,
};
use lodestream_client::trace::{TRACE_VERSION, Trace, TraceFrame, TraceHeader, TracePage};
use lodestream_loadtests::policies::{
    Future, LinkSpeed, Order, PolicyName, Recorder, ReplayOptions, SimulatedPage, StudyOptions,
    replay, study,
};
use proptest::prelude::*;

const SLOT_BYTES: u64 = 128 * 1024;
/// Frames that each view stays: more than a fetch takes on [`FAST`].
const STAY: usize = 4;
/// What is asked for in one update is there in the next.
const FAST: LinkSpeed = LinkSpeed {
    bandwidth_mbps: 1e6,
    latency_ms: 0.0,
};

/// A trace without dependencies or root pages: each view wants its pages, all equally, for [`STAY`] frames.
fn flat_trace(pages: u32, views: &[BTreeSet<u32>]) -> Trace {
    let page = |_| TracePage {
        bytes: 50_000,
        memory_words: 30_000,
        root: false,
        dependencies: vec![],
    };
    let header = TraceHeader {
        version: TRACE_VERSION,
        scene: "flat".into(),
        fps: 30,
        pages: (0..pages).map(page).collect(),
    };
    let frames = views
        .iter()
        .flat_map(|view| std::iter::repeat_n(view, STAY))
        .zip(0..);
    let frame = |(view, frame): (&BTreeSet<u32>, u32)| TraceFrame {
        frame,
        requests: view.iter().map(|&page| (page, 8.0, 8.0)).collect(),
    };
    Trace {
        header,
        frames: frames.map(frame).collect(),
    }
}

fn options(slots: u64) -> ReplayOptions {
    ReplayOptions {
        pool_bytes: slots * SLOT_BYTES,
        pixel_error_px: 1.0,
        link: FAST,
        first_frame: 0,
        order: Order::Total,
    }
}

fn future(trace: &Trace, slots: u64) -> Future {
    let recorder = Recorder::new(trace.header.pages.len());
    replay(trace, Box::new(recorder.clone()), options(slots)).unwrap();
    recorder.future()
}

fn faults(trace: &Trace, policy: PolicyName, slots: u64) -> u64 {
    replay(trace, policy.build(&future(trace, slots)), options(slots))
        .unwrap()
        .faults
}

/// The fewest faults that any choice of victims gives, by trying them all.
fn fewest_faults(views: &[BTreeSet<u32>], slots: u64) -> u64 {
    let mut states = BTreeMap::from([(0u32, 0u64)]);
    for view in views {
        let wanted = view.iter().fold(0u32, |bits, page| bits | 1 << page);
        let mut next: BTreeMap<u32, u64> = BTreeMap::new();
        for (resident, faults) in states {
            let faults = faults + u64::from((wanted & !resident).count_ones());
            let others = resident & !wanted;
            // Every subset of what is there beside the view may stay, as far as it fits.
            let mut kept = others;
            loop {
                let state = wanted | kept;
                if u64::from(state.count_ones()) <= slots {
                    next.entry(state)
                        .and_modify(|least| *least = faults.min(*least))
                        .or_insert(faults);
                }
                if kept == 0 {
                    break;
                }
                kept = (kept - 1) & others;
            }
        }
        states = next;
    }
    states.into_values().min().unwrap()
}

fn views(
    pages: u32,
    most: usize,
    count: std::ops::Range<usize>,
) -> impl Strategy<Value = Vec<BTreeSet<u32>>> {
    prop::collection::vec(prop::collection::btree_set(0..pages, 1..=most), count)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn the_clairvoyant_is_as_good_as_trying_everything(views in views(9, 4, 2..14), slots in 4u64..6) {
        let trace = flat_trace(9, &views);
        prop_assert_eq!(faults(&trace, PolicyName::Clairvoyant, slots), fewest_faults(&views, slots));
    }

    #[test]
    fn nobody_has_fewer_faults_than_the_clairvoyant(views in views(40, 6, 5..60), slots in 6u64..20) {
        let trace = flat_trace(40, &views);
        let bound = faults(&trace, PolicyName::Clairvoyant, slots);
        for policy in PolicyName::ALL {
            prop_assert!(faults(&trace, policy, slots) >= bound, "{:?}", policy);
        }
    }
}

/// A made scene: pages with up to two dependencies each, the first two of each asset being root pages.
fn scene(seed: u64) -> Vec<PageFacts> {
    let mut random = Random(seed);
    let mut facts: Vec<PageFacts> = Vec::new();
    for asset in 0..3u32 {
        let base = facts.len() as u32;
        for number in 0..30u32 {
            let count = if number == 0 { 0 } else { 1 + random.below(2) };
            let dependencies = match number {
                0 => vec![],
                1 => vec![base],
                _ => (0..count).map(|_| base + random.below(number)).collect(),
            };
            facts.push(PageFacts {
                frame_bytes: 1000 + 100 * number + asset,
                memory_words: 20_000,
                is_root: number < 2,
                dependencies,
            });
        }
    }
    facts
}

/// Xorshift; Marsaglia, 2003.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u32) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 33) as u32 % end
    }
}

/// Walks at random through a made scene and checks the page table after every update.
fn keeps_closure_and_bytes(policy: PolicyName, future: &Future, seed: u64) {
    let facts = scene(seed);
    let pool_bytes = 2 << 20;
    let config = ResidencyConfig {
        policy: policy.build(future),
        control: PixelErrorControl::Fixed,
        ..ResidencyConfig::new(pool_bytes)
    };
    let mut residency: Residency<SimulatedPage> =
        Residency::over(&facts, SimulatedPage, config).unwrap();
    let mut random = Random(seed ^ 0x5555);
    let mut table: BTreeMap<u32, u32> = BTreeMap::new();
    let mut evictions = 0;
    for update in 0..400 {
        let now_secs = f64::from(update) / 30.0;
        let center = random.below(90);
        let requests: Vec<StreamingRequest> = (0..3)
            .map(|_| StreamingRequest {
                page: (center + random.below(12)) % 90,
                error_px: 1.5 + random.below(20) as f32,
                priority_px: 1.5 + random.below(20) as f32,
            })
            .collect();
        for _ in 0..3 {
            residency.update(now_secs, &requests);
            for fetch in residency.next_fetches(now_secs) {
                for page in residency.pages().fetched(&fetch) {
                    let form = SimulatedPage(residency.pages().number_in_asset(page));
                    residency.arrived(page, Ok(form), now_secs);
                }
            }
            let changes = residency.take_changes();
            evictions += changes.evicted.len();
            for page in changes.evicted {
                assert!(
                    table.remove(&page).is_some(),
                    "{policy:?} evicted {page}, which is not there"
                );
            }
            for (page, word) in changes.installed {
                assert!(
                    table.insert(page, word).is_none(),
                    "{policy:?} installed {page} twice"
                );
            }
            let places: BTreeSet<u32> = table.values().copied().collect();
            assert_eq!(
                places.len(),
                table.len(),
                "{policy:?}: two pages in one place"
            );
            assert!(residency.layout().bytes() <= pool_bytes);
            for (&page, &word) in &table {
                assert!(word + facts[page as usize].memory_words <= residency.layout().words());
                for dependency in &facts[page as usize].dependencies {
                    assert!(
                        table.contains_key(dependency),
                        "{policy:?}: {page} without {dependency}"
                    );
                }
            }
            for (page, fact) in (0..).zip(&facts) {
                assert!(
                    !fact.is_root || table.contains_key(&page),
                    "{policy:?}: root page {page} is gone"
                );
            }
        }
    }
    assert!(
        evictions > 100,
        "{policy:?}: {evictions} evictions test nothing"
    );
    assert_eq!(residency.stats().illegal_transitions, 0);
}

#[test]
fn every_policy_keeps_closure_root_pages_and_the_pools_bytes() {
    for policy in PolicyName::ALL {
        for seed in [1, 77, 4242] {
            // What the clairvoyant was told does not come true here: no invariant may depend on that.
            let views: Vec<BTreeSet<u32>> =
                (0..50).map(|view| (view..view + 5).collect()).collect();
            keeps_closure_and_bytes(policy, &future(&flat_trace(90, &views), 8), seed);
        }
    }
}

#[test]
fn figures_by_hand() {
    // Four slots. Pages 0-3, then 4-5, then 0-3 again: whoever evicts two of 0-3 has 4 + 2 + 2 faults.
    let views = [0..4u32, 4..6, 0..4].map(|pages| pages.collect::<BTreeSet<_>>());
    let trace = flat_trace(6, &views);
    let options = StudyOptions {
        policies: vec![PolicyName::Lru, PolicyName::Clairvoyant],
        pools_bytes: vec![4 * SLOT_BYTES, 6 * SLOT_BYTES],
        viewers: 1,
        pixel_error_px: 1.0,
        link: FAST,
        order: Order::Total,
    };
    let found = study(&trace, &options).unwrap();
    let figures: Vec<_> = found
        .runs
        .iter()
        .map(|run| {
            (
                run.policy.as_str(),
                run.pool_bytes / SLOT_BYTES,
                run.faults,
                run.evictions,
                run.bytes_fetched,
            )
        })
        .collect();
    assert_eq!(
        figures,
        [
            ("lru", 4, 8, 4, 400_000),
            ("lru", 6, 6, 0, 300_000),
            ("clairvoyant", 4, 8, 4, 400_000),
            ("clairvoyant", 6, 6, 0, 300_000),
        ]
    );
    let small = &found.runs[0];
    // Ten pages wanted over four frames each; a fault shows 8 px instead of 1 for one frame of a thirtieth second, thrice.
    assert_eq!(small.requests, 40);
    assert!(
        (small.error_seconds - 3.0 * 7.0 / 30.0).abs() < 1e-9,
        "{}",
        small.error_seconds
    );
    assert!((small.time_to_detail_secs.unwrap().p95 - 1.0 / 30.0).abs() < 1e-9);
    assert_eq!(found.trace.distinct_pages_wanted, 6);

    let three = study(
        &trace,
        &StudyOptions {
            viewers: 3,
            ..options.clone()
        },
    )
    .unwrap();
    assert_eq!(three.runs[0].requests, 120);
    assert_eq!(
        three,
        study(
            &trace,
            &StudyOptions {
                viewers: 3,
                ..options
            }
        )
        .unwrap()
    );
}

#[test]
fn lru_loses_everything_on_a_loop_that_is_one_page_too_long() {
    let lap = (0..5u32).map(|page| BTreeSet::from([page]));
    let views: Vec<_> = lap.cycle().take(20).collect();
    let trace = flat_trace(5, &views);
    assert_eq!(faults(&trace, PolicyName::Lru, 4), 20);
    assert_eq!(faults(&trace, PolicyName::Fifo, 4), 20);
    assert_eq!(faults(&trace, PolicyName::Clock, 4), 20);
    let bound = fewest_faults(&views, 4);
    assert_eq!(faults(&trace, PolicyName::Clairvoyant, 4), bound);
    assert!(bound < 10, "{bound}");
}

#[test]
fn a_slow_link_costs_error_and_time_but_no_more_faults() {
    let views = [0..4u32, 4..6, 0..4].map(|pages| pages.collect::<BTreeSet<_>>());
    let trace = flat_trace(6, &views);
    let slow = ReplayOptions {
        link: LinkSpeed {
            bandwidth_mbps: 50.0,
            latency_ms: 40.0,
        },
        ..options(6)
    };
    let slow = replay(&trace, PolicyName::Lru.build(&Future::default()), slow).unwrap();
    let fast = replay(
        &trace,
        PolicyName::Lru.build(&Future::default()),
        options(6),
    )
    .unwrap();
    assert_eq!(slow.faults, fast.faults);
    assert!(slow.error_seconds > fast.error_seconds);
    // 40 ms of latency and 8 ms a page, seen at thirtieths of a second.
    assert!(
        slow.waits_secs.iter().all(|&wait_secs| wait_secs >= 0.048),
        "{:?}",
        slow.waits_secs
    );
}

#[test]
fn a_pool_below_its_least_is_refused_with_both_numbers() {
    let trace = flat_trace(6, &[BTreeSet::from([0])]);
    let error = replay(
        &trace,
        PolicyName::Lru.build(&Future::default()),
        options(3),
    )
    .unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with("page pool: expected at least 524288 bytes"),
        "{error}"
    );
}

/// Twenty pages sharpen a thousand instances by 2 px each, twenty others a single nearer one by 20
/// px. The sum over all who gain removes the same error sooner.
#[test]
fn pages_of_many_instances_come_before_those_of_one_nearer() {
    let mut trace = flat_trace(40, &[(0..40).collect()]);
    trace.frames = (0..60)
        .map(|frame| TraceFrame {
            frame,
            requests: (0..40u32)
                .map(|page| match page < 20 {
                    true => (page, 20.0, 20.0),
                    false => (page, 2.0, 2000.0),
                })
                .collect(),
        })
        .collect();
    let run = |order| {
        let options = ReplayOptions {
            link: LinkSpeed {
                bandwidth_mbps: 10.0,
                latency_ms: 10.0,
            },
            order,
            ..options(64)
        };
        replay(&trace, PolicyName::Lru.build(&Future::default()), options).unwrap()
    };
    let (total, largest) = (run(Order::Total), run(Order::Largest));
    assert_eq!(total.bytes_fetched, largest.bytes_fetched);
    assert_eq!(total.faults, 40);
    assert_eq!(total.removed_px.iter().sum::<f64>(), 40_400.0);
    assert!(
        total.total_error_seconds < 0.5 * largest.total_error_seconds,
        "{} {}",
        total.total_error_seconds,
        largest.total_error_seconds
    );
}
