//! The six invariants of residency, over random scenes, cameras, orders of arrival, failures, policies and tiny pools.
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

mod stream_common;

use std::collections::BTreeMap;

use lodestream_client::stream::{
    PixelErrorControl, PixelErrorLimit, Residency, ResidencyConfig, StreamError, StreamingRequest,
    decode_page,
};
use proptest::prelude::*;
use stream_common::world::{Case, World, case};
use stream_common::{Random, Size, config, make_scene};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// Invariants 1 to 4. The checks of 1 to 3 stand in `PoolModel`, after every frame; 4 is the settling at the end.
    #[test]
    fn any_walk_keeps_the_invariants_and_every_request_ends(case in case()) {
        let scene = make_scene(case.seed, case.size);
        let mut world = World::new(&scene, &case);
        let mut random = Random(case.seed ^ 1);
        for _ in 0..120 {
            if random.chance(0.2) {
                world.eye = std::array::from_fn(|axis| {
                    let far = if axis == 0 { 30.0 * case.size.assets as f32 } else { 10.0 };
                    random.unit() * far
                });
                world.half = random.chance(0.5);
            }
            world.frame([0.016, 0.016, 2.0][random.below(3) as usize]);
            for _ in 0..random.below(12) {
                if !world.network.is_empty() {
                    let at = random.below(world.network.len() as u32) as usize;
                    world.answer(at, random.chance(0.2));
                }
            }
            // Answers that nobody asked for, and requests for what is not there.
            if random.chance(0.1) {
                let page = random.below(scene.opened.page_count() + 5);
                world.residency.arrived(page, Err(StreamError::NotFound { place: String::new() }), world.now_secs);
                world.network.retain(|&(_, other)| other != page);
            }
        }
        world.settle();
        let shown_px = world.residency.pixel_error();
        if case.control == PixelErrorControl::Governed {
            for page in world.wanted(world.residency.pixel_error()) {
                prop_assert!(world.gpu.is_installed(page), "page {page} at {shown_px} px");
            }
        }
        prop_assert_eq!(world.residency.stats().pages_missing, 0);
    }

    /// Invariant 5, from a cold start and after a teleport.
    #[test]
    fn a_still_camera_settles_and_then_fetches_nothing(case in case()) {
        let scene = make_scene(case.seed, case.size);
        let mut world = World::new(&scene, &case);
        for eye in [[12.0, 0.0, 0.0], [0.5, 0.5, 0.5]] {
            world.eye = eye;
            world.settle();
            let (shown_px, fetched) = (world.residency.pixel_error(), world.fetched);
            let wanted = world.wanted(world.residency.pixel_error());
            for _ in 0..60 {
                world.frame(0.25);
                prop_assert!(world.residency.is_settled());
            }
            prop_assert_eq!(world.residency.pixel_error(), shown_px);
            prop_assert_eq!(world.fetched, fetched);
            if case.control == PixelErrorControl::Governed {
                prop_assert!(wanted.iter().all(|&page| world.gpu.is_installed(page)));
                let raised = shown_px > 1.0;
                let says = matches!(world.residency.pixel_error_limit(), PixelErrorLimit::Pool { .. });
                prop_assert_eq!(raised, says);
                if raised {
                    // Not for nothing: the pool is more than three quarters full, or a little less would overflow it.
                    let (slots, less) = (case.slots as usize, world.wanted(0.98 * shown_px).len());
                    prop_assert!(wanted.len() * 4 > slots * 3 || less > slots, "{} of {slots}", wanted.len());
                }
            } else {
                prop_assert_eq!(shown_px, 1.0);
            }
        }
    }

    /// A pool that holds all that is asked for never raises the pixel error, whatever comes in which order.
    #[test]
    fn a_pool_that_suffices_shows_what_was_asked(case in case()) {
        let scene = make_scene(case.seed, case.size);
        let case = Case { slots: scene.opened.page_count() + 4, control: PixelErrorControl::Governed, ..case };
        let mut world = World::new(&scene, &case);
        for eye in [[12.0, 0.0, 0.0], [0.5, 0.5, 0.5], [40.0, 1.0, 1.0]] {
            world.eye = eye;
            for _ in 0..5 {
                world.frame(0.016);
                prop_assert_eq!(world.residency.pixel_error(), 1.0);
            }
        }
        world.settle();
        prop_assert!(world.wanted(world.residency.pixel_error()).iter().all(|&page| world.gpu.is_installed(page)));
        prop_assert_eq!(world.residency.stats().pages_evicted, 0);
        prop_assert_eq!(world.residency.pixel_error_limit(), PixelErrorLimit::Asked);
    }

    /// Invariant 6, where bytes become a page: any changed, lost or added byte is an error.
    #[test]
    fn a_corrupted_frame_never_becomes_a_page(seed in any::<u64>(), flips in prop::collection::vec(any::<(u16, u8)>(), 1..4)) {
        let scene = make_scene(seed, Size { assets: 1, finest_groups: 6, levels: 3 });
        let made = &scene.assets[0];
        let opened = &made.opened;
        for (page, frame) in (0..).zip(&made.frames) {
            let decode = |bytes: &[u8]| decode_page(&opened.hash, &opened.asset, &opened.hierarchy, page, bytes);
            prop_assert!(decode(frame).is_ok());
            let mut bytes = frame.to_vec();
            for &(at, by) in &flips {
                let at = at as usize % bytes.len();
                bytes[at] ^= by;
            }
            let same = bytes == frame[..];
            prop_assert_eq!(decode(&bytes).is_ok(), same);
            prop_assert!(decode(&frame[..frame.len() - 1]).is_err());
            // The frame of another page is whole, but not this one.
            if let Some(other) = made.frames.iter().find(|other| *other != frame) {
                let is_hash = matches!(decode(other), Err(StreamError::Hash { .. }));
                prop_assert!(is_hash);
            }
        }
    }
}

/// One page that always fails stops only what depends on it, is asked for less and less often, and is named.
#[test]
fn one_bad_page_never_stops_the_rest() {
    let size = Size {
        assets: 2,
        finest_groups: 30,
        levels: 4,
    };
    let scene = make_scene(11, size);
    let case = Case {
        seed: 11,
        size,
        slots: scene.opened.page_count(),
        policy: 2,
        control: PixelErrorControl::Governed,
        lag: 2,
        max_uploads: 64,
    };
    let mut world = World::new(&scene, &case);
    let roots = scene.opened.assets[0].asset.root_page_count;
    let bad = roots + 1;
    let mut asked_at = Vec::new();
    for _ in 0..4000 {
        world.frame(0.05);
        while !world.network.is_empty() {
            let is_bad = world.network[0].1 == bad;
            if is_bad {
                asked_at.push(world.now_secs);
            }
            let (_, page) = world.network.remove(0);
            let result = match is_bad {
                true => Err(StreamError::Http {
                    url: "test".to_owned(),
                    found: "a broken line".to_owned(),
                }),
                false => Ok(scene.decoded(page)),
            };
            world.residency.arrived(page, result, world.now_secs);
        }
    }
    let mut hurt = BTreeMap::from([(bad, true)]);
    for (page, entry) in (0..).zip(&scene.opened.assets[0].asset.pages) {
        let needs = entry
            .dependencies
            .iter()
            .any(|dependency| hurt.contains_key(dependency));
        if needs {
            hurt.insert(page, true);
        }
    }
    assert!(hurt.len() > 1, "something depends on the bad page");
    for page in world.wanted(world.residency.pixel_error()) {
        assert_eq!(
            world.gpu.is_installed(page),
            !hurt.contains_key(&page),
            "page {page}"
        );
    }
    assert!(world.residency.is_stalled() && !world.residency.is_settled());
    let stats = world.residency.stats();
    assert_eq!(stats.pages_failed, 1);
    assert!(stats.last_failure.unwrap().contains("a broken line"));
    // 200 seconds: doubled from a quarter second up to 30, each up to a quarter longer.
    let waits: Vec<f64> = asked_at.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!((9..=14).contains(&asked_at.len()), "asked at {asked_at:?}");
    assert!(
        waits.windows(2).all(|pair| pair[1] >= pair[0] - 0.11),
        "{waits:?}"
    );
    assert!(waits.iter().all(|&wait| wait <= 30.0 * 1.25 + 0.11));
    // The source recovers: so does the picture.
    world.settle();
    assert!(
        world
            .wanted(world.residency.pixel_error())
            .iter()
            .all(|&page| world.gpu.is_installed(page))
    );
}

/// Requests that make no sense are counted and passed over.
#[test]
fn requests_for_nothing_are_ignored() {
    let size = Size {
        assets: 1,
        finest_groups: 10,
        levels: 3,
    };
    let scene = make_scene(3, size);
    let mut residency = Residency::new(
        &scene.opened,
        config(&scene.opened, 8, PixelErrorControl::Governed),
    )
    .unwrap();
    let request = |page, px| StreamingRequest {
        page,
        error_px: px,
        priority_px: px,
    };
    let last = scene.opened.page_count() - 1;
    residency.update(
        0.0,
        &[
            request(last + 1, 9.0),
            request(u32::MAX, 9.0),
            request(last, f32::NAN),
        ],
    );
    assert_eq!(residency.stats().ignored_requests, 3);
    assert_eq!(residency.stats().pages_wanted, 0);
    residency.update(0.0, &[request(last, f32::INFINITY)]);
    assert!(residency.stats().pages_wanted > 0);
    assert!(residency.pixel_error().is_finite());
}

/// What the camera no longer wants is called off, and what comes all the same does no harm.
#[test]
fn a_turn_of_the_camera_calls_fetches_off() {
    let size = Size {
        assets: 3,
        finest_groups: 30,
        levels: 4,
    };
    let scene = make_scene(5, size);
    let case = Case {
        seed: 5,
        size,
        slots: 400,
        policy: 2,
        control: PixelErrorControl::Governed,
        lag: 0,
        max_uploads: 64,
    };
    let mut world = World::new(&scene, &case);
    world.eye = [0.0; 3];
    world.frame(0.016);
    let in_flight = world.residency.stats().fetches_in_flight;
    assert!(in_flight > 0);
    // Far away, nothing at all is wanted.
    world.eye = [1e6, 0.0, 0.0];
    for _ in 0..3 {
        world.frame(0.016);
        assert_eq!(world.called_off, 0, "not for a flicker");
    }
    world.frame(0.016);
    assert_eq!(world.called_off, in_flight);
    assert_eq!(world.residency.stats().bytes_in_flight, 0);
    world.answer_all();
    world.frame(0.016);
    assert_eq!(world.gpu.installed(), world.residency.layout().roots.len());
    assert!(world.residency.stats().pages_superseded > 0);
}

/// A pool too small names both numbers; the smallest that does is enough.
#[test]
fn a_pool_too_small_is_refused_with_both_numbers() {
    let size = Size {
        assets: 2,
        finest_groups: 10,
        levels: 3,
    };
    let scene = make_scene(3, size);
    let settings = ResidencyConfig::new;
    let Err(StreamError::Pool {
        pool_bytes,
        needed_bytes,
        ..
    }) = Residency::new(&scene.opened, settings(1000))
    else {
        panic!("a pool of 1000 bytes");
    };
    assert_eq!(pool_bytes, 1000);
    assert!(Residency::new(&scene.opened, settings(needed_bytes - 1)).is_err());
    let residency = Residency::new(&scene.opened, settings(needed_bytes)).unwrap();
    assert!(residency.layout().bytes() <= needed_bytes);
}
