//! What is fetched, in which order, how much at once.
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

mod stream_common;

use lodestream_client::stream::{
    Fetch, OpenedScene, PixelErrorControl, Residency, ResidencyConfig, StreamingRequest,
};
use proptest::prelude::*;
use stream_common::{Random, Size, config, make_scene};

const KIB: u64 = 1024;

/// A scene of one asset whose pages depend on nothing and have frames of 20 to 100 KiB.
fn flat_scene(random: &mut Random) -> OpenedScene {
    let size = Size {
        assets: 1,
        finest_groups: 200,
        levels: 3,
    };
    let mut opened = make_scene(random.below(u32::MAX) as u64, size).opened;
    for entry in &mut opened.assets[0].asset.pages {
        entry.dependencies.clear();
        entry.bytes = (20 + random.below(80)) * KIB as u32;
    }
    opened
}

struct Sent {
    pages: Vec<u32>,
    bytes: u64,
    most_px_a_byte: f32,
}

fn sent(fetches: &[Fetch], scene: &OpenedScene, priorities: &[f32]) -> Vec<Sent> {
    let entries = &scene.assets[0].asset.pages;
    let bytes_of = |page: u32| entries[page as usize].bytes;
    fetches
        .iter()
        .map(|fetch| {
            let pages: Vec<u32> = (fetch.first_page..=fetch.last_page).collect();
            let densities = pages
                .iter()
                .map(|&page| priorities[page as usize] / bytes_of(page) as f32);
            Sent {
                bytes: pages.iter().map(|&page| bytes_of(page) as u64).sum(),
                most_px_a_byte: densities.fold(0.0, f32::max),
                pages,
            }
        })
        .collect()
}

fn requests(priorities: &[f32]) -> Vec<StreamingRequest> {
    (0..)
        .zip(priorities)
        .map(|(page, &priority_px)| StreamingRequest {
            page,
            error_px: 2.0,
            priority_px,
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Most error per byte first; joined up to 256 KiB with neighbours of at least half the priority; the first window is
    /// filled and not exceeded by more than the last fetch; the next update orders anew.
    #[test]
    fn fetches_come_by_error_per_byte_in_joined_ranges_up_to_the_window(seed in any::<u64>()) {
        let mut random = Random(seed);
        let scene = flat_scene(&mut random);
        let count = scene.page_count() as usize;
        let settings = config(&scene, count as u32 + 4, PixelErrorControl::Governed);
        let mut residency = Residency::new(&scene, settings).unwrap();
        residency.take_changes();
        let roots = scene.assets[0].asset.root_page_count;
        let mut left: Vec<u32> = (roots..count as u32).collect();
        for round in 0..2 {
            let priorities: Vec<f32> = (0..count).map(|_| 1.5 + 50.0 * random.unit().powi(3)).collect();
            residency.update(round as f64, &requests(&priorities));
            let fetches = residency.next_fetches(round as f64);
            let sent = sent(&fetches, &scene, &priorities);
            for (index, fetch) in sent.iter().enumerate() {
                prop_assert!(fetch.bytes <= 256 * KIB || fetch.pages.len() == 1);
                let density = |page: u32| priorities[page as usize] / scene.assets[0].asset.pages[page as usize].bytes as f32;
                left.retain(|page| !fetch.pages.contains(page));
                prop_assert!(left.iter().all(|&page| density(page) <= fetch.most_px_a_byte), "fetch {index}");
                let lead = fetch.pages.iter().copied().max_by(|&a, &b| density(a).total_cmp(&density(b))).unwrap();
                let least = 0.5 * priorities[lead as usize];
                prop_assert!(fetch.pages.iter().all(|&page| priorities[page as usize] >= least));
                // Joined as far as it goes: the next page of the asset is taken, too unimportant, or too much.
                let next = fetch.pages.last().unwrap() + 1;
                if left.contains(&next) && priorities[next as usize] >= least {
                    prop_assert!(fetch.bytes + scene.assets[0].asset.pages[next as usize].bytes as u64 > 256 * KIB);
                }
            }
            let stats = residency.stats();
            let total: u64 = sent.iter().map(|fetch| fetch.bytes).sum();
            prop_assert_eq!(stats.bytes_in_flight, total);
            let before_last = total - sent.last().unwrap().bytes;
            prop_assert!(before_last < 1024 * KIB || sent.len() <= 4);
            prop_assert!(left.is_empty() || total >= 1024 * KIB);
            // Nothing answered, nothing more to send.
            prop_assert!(residency.next_fetches(round as f64).is_empty());
            // All of it fails or is called off, so the window is free for the next round.
            for _ in 0..8 {
                residency.update(round as f64, &[]);
            }
            prop_assert_eq!(residency.cancelled().len(), sent.len());
            prop_assert_eq!(residency.stats().bytes_in_flight, 0);
            left = (roots..count as u32).collect();
        }
    }
}

/// Whatever the window says, no more is held than the configuration allows, and never fewer than four fetches are tried.
#[test]
fn bytes_in_flight_are_bounded_by_the_configuration() {
    let mut random = Random(5);
    let scene = flat_scene(&mut random);
    let count = scene.page_count();
    let settings = ResidencyConfig {
        max_in_flight_bytes: 1,
        ..config(&scene, count, PixelErrorControl::Governed)
    };
    let mut residency = Residency::new(&scene, settings).unwrap();
    residency.take_changes();
    residency.update(0.0, &requests(&vec![3.0; count as usize]));
    assert_eq!(residency.next_fetches(0.0).len(), 4);
}

/// The same calls give the same answers.
#[test]
fn residency_is_deterministic() {
    let run = || {
        let size = Size {
            assets: 2,
            finest_groups: 60,
            levels: 4,
        };
        let scene = make_scene(9, size);
        let settings = config(&scene.opened, 20, PixelErrorControl::Governed);
        let mut residency = Residency::new(&scene.opened, settings).unwrap();
        let mut log = Vec::new();
        for frame in 0..200 {
            let eye = [0.3 * frame as f32, 1.0, 0.0];
            let requests = scene.requests(eye, true, residency.pixel_error());
            residency.update(frame as f64, &requests);
            let fetches = residency.next_fetches(frame as f64);
            for fetch in &fetches {
                let base = scene.opened.assets[fetch.asset_index].page_base;
                for local in fetch.first_page..=fetch.last_page {
                    let page = base + local;
                    residency.arrived(page, Ok(scene.decoded(page)), frame as f64);
                }
            }
            let changes = residency.take_changes();
            log.push((
                fetches,
                changes.evicted,
                changes.installed,
                residency.pixel_error(),
            ));
        }
        assert!(residency.stats().pages_evicted > 0);
        log
    };
    assert!(run() == run());
}
