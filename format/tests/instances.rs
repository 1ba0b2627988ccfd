//! Stored instances: lists of every kind come back bit by bit, and no bytes break the reader.
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

use lodestream_format::instances::{InstanceSteps, Placing, largest_column, linear_of};
use lodestream_format::scene::{Instance, SceneAsset};
use lodestream_format::{ContentHash, Scene};
use proptest::prelude::*;

type Rows = [[f64; 4]; 3];

/// Steps of a box of one metre with a grid of 2^-14.
fn steps(root: f64) -> InstanceSteps {
    InstanceSteps {
        center: [0.25, -1.0, 3.0],
        root,
        turn: 2e-6 * root,
        offset: 9e-6,
    }
}

fn scene(steps: [InstanceSteps; 2], rows: &[(u32, Rows)]) -> Scene {
    let used = |steps: InstanceSteps| SceneAsset {
        name: "rock".to_owned(),
        asset: ContentHash::of(b"rock"),
        materials: vec![],
        steps,
    };
    let instance = |&(asset, world_from_object): &(u32, Rows)| Instance {
        asset,
        world_from_object,
    };
    Scene {
        assets: steps.map(used).to_vec(),
        instances: rows.iter().map(instance).collect(),
        ..Scene::default()
    }
}

fn bits(scene: &Scene) -> Vec<(u32, [u64; 12])> {
    let of = |instance: &Instance| {
        let values: Vec<u64> = instance
            .world_from_object
            .iter()
            .flatten()
            .map(|value| value.to_bits())
            .collect();
        (instance.asset, values.try_into().unwrap())
    };
    scene.instances.iter().map(of).collect()
}

/// As a builder does it: each instance to the nearest on the steps, one after the other.
fn rounded(mut scene: Scene) -> (Scene, usize) {
    let mut placing = Placing::default();
    let mut moved = 0;
    for instance in &mut scene.instances {
        let steps = &scene.assets[instance.asset as usize].steps;
        if let Some(nearest) = placing.nearest(steps, instance, false) {
            *instance = nearest;
            moved += 1;
        }
        placing.pass(steps, instance);
    }
    (scene, moved)
}

/// Turns by twice the angle of this tangent: the same bits on every machine.
fn turn(axis: usize, tangent: f64, scale: [f64; 3], at: [f64; 3]) -> Rows {
    let over = 1.0 + tangent * tangent;
    let (sin, cos) = (2.0 * tangent / over, (1.0 - tangent * tangent) / over);
    let mut linear = [[0.0; 3]; 3];
    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
    linear[axis][axis] = scale[axis];
    linear[b][b] = cos * scale[b];
    linear[b][c] = -sin * scale[c];
    linear[c][b] = sin * scale[b];
    linear[c][c] = cos * scale[c];
    [0, 1, 2].map(|row| {
        let [x, y, z] = linear[row];
        [x, y, z, at[row]]
    })
}

fn place() -> impl Strategy<Value = [f64; 3]> {
    let near = [-500.0..500.0f64, -500.0..500.0, -500.0..500.0];
    let far = [-1e7..1e7f64, -1e7..1e7, -1e7..1e7];
    let lattice = [-9i32..9, -9..9, -9..9];
    prop_oneof![
        near,
        far,
        lattice.prop_map(|at| at.map(|value| 0.1 * f64::from(value))),
        Just([-0.0, 0.0, 1e300]),
    ]
}

fn linear() -> impl Strategy<Value = Rows> {
    let size = -6.0..6.0f64;
    let turned =
        (0..3usize, 0.0..7.0f64, size, any::<bool>()).prop_map(|(axis, tangent, size, mirrors)| {
            let scale = 10f64.powf(size) * if mirrors { -1.0 } else { 1.0 };
            turn(axis, tangent, [scale; 3], [0.0; 3])
        });
    let stretched = (0..3usize, 0.0..7.0f64, [-2.0..2.0f64, -2.0..2.0, -2.0..2.0])
        .prop_map(|(axis, tangent, scale)| turn(axis, tangent, scale, [0.0; 3]));
    let any = prop::array::uniform3([-2.0..2.0f64, -2.0..2.0, -2.0..2.0, 0.0..1.0]);
    let fixed = (0..3u32, 0..4u32)
        .prop_map(|(axis, quarter)| turn(axis as usize, f64::from(quarter), [1.0; 3], [0.0; 3]));
    prop_oneof![turned, stretched, any, fixed, Just([[0.0; 4]; 3])]
}

fn rows() -> impl Strategy<Value = Vec<(u32, Rows)>> {
    let one = (0..2u32, linear(), place()).prop_map(|(asset, mut rows, at)| {
        for (row, at) in rows.iter_mut().zip(at) {
            row[3] = at;
        }
        (asset, rows)
    });
    prop::collection::vec(one, 0..200)
}

proptest! {
    #[test]
    fn lists_of_all_kinds_round_trip_bit_by_bit(rows in rows(), root in 1e-3..10.0f64) {
        for steps in [[InstanceSteps::default(); 2], [steps(root), InstanceSteps::default()], [steps(root); 2]] {
            let exact = scene(steps, &rows);
            let (rounded, _) = rounded(exact.clone());
            for scene in [exact, rounded] {
                let bytes = scene.encode().unwrap();
                let read = Scene::decode(&bytes).unwrap();
                prop_assert_eq!(bits(&read), bits(&scene));
                prop_assert_eq!(read.encode().unwrap(), bytes);
            }
        }
    }

    /// A turn moves a point by its distance times twice the root times the step, and the root of
    /// three halves of the offset's step.
    #[test]
    fn what_is_rounded_moves_within_the_steps(rows in rows()) {
        let exact = scene([steps(1e-3); 2], &rows);
        let (rounded, _) = rounded(exact.clone());
        let steps = steps(1e-3);
        let center = steps.center.map(f64::from);
        for (from, to) in exact.instances.iter().zip(&rounded.instances) {
            if from == to {
                continue;
            }
            let stretch = largest_column(&linear_of(from));
            let doubled = (stretch.sqrt() / steps.root).max(1.0);
            let linear = 2.0 * stretch.sqrt().max(steps.root) * steps.turn * doubled;
            for corner in 0..8usize {
                let aside = [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { 0.5 } else { -0.5 });
                let mut moved = 0.0;
                let mut size: f64 = 0.0;
                for (from, to) in from.world_from_object.iter().zip(&to.world_from_object) {
                    let along = |axis: usize| (to[axis] - from[axis]) * (center[axis] + aside[axis]);
                    let row = along(0) + along(1) + along(2) + (to[3] - from[3]);
                    moved += row * row;
                    size = size.max(from[3].abs() + 10.0 * stretch);
                }
                let most = linear * 1.1 + 0.87 * steps.offset * stretch * 1.01 + 1e-15 * size;
                prop_assert!(moved.sqrt() <= most, "{} over {most}", moved.sqrt());
            }
        }
    }
}

fn turns(count: usize) -> Vec<(u32, Rows)> {
    let mut state = 1u64;
    let mut random = || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 33) as f64 / (1u64 << 31) as f64
    };
    let one = |_| {
        let at = [0, 1, 2].map(|_| 100.0 * random());
        let scale = 0.7 + 0.6 * random();
        (0, turn(1, 7.0 * random(), [scale; 3], at))
    };
    (0..count).map(one).collect()
}

/// A turn about an axis with a scale is two integers: 16 bytes with its offset and asset at most,
/// where its numbers take 37.
#[test]
fn turned_instances_are_short() {
    let exact = scene([steps(0.83); 2], &turns(5000));
    let (rounded, moved) = rounded(exact.clone());
    assert_eq!(moved, 5000);
    let size = |scene: &Scene| scene.encode().unwrap().len();
    assert!(size(&rounded) < 5000 * 16, "{}", size(&rounded));
    assert!(size(&exact) > 5000 * 35, "{}", size(&exact));
}

/// Shared turns and a lattice of places need no rounding.
#[test]
fn a_lattice_is_short_bit_by_bit() {
    let place = |index: u32| {
        let at = [index % 20, index / 20 % 20, index / 400].map(|it| 7.3 * f64::from(it));
        (index % 2, turn(1, f64::from(index % 4), [1.0; 3], at))
    };
    let rows: Vec<_> = (0..8000).map(place).collect();
    let scene = scene([InstanceSteps::default(); 2], &rows);
    let bytes = scene.encode().unwrap();
    assert!(bytes.len() < 8000, "{} bytes", bytes.len());
    assert_eq!(bits(&Scene::decode(&bytes).unwrap()), bits(&scene));
}

/// Version 2 of the scene, pinned to the byte of what is compressed: zstd may change its own.
#[test]
fn golden_columns() {
    let mut rows = turns(20);
    rows.push((
        1,
        [
            [1.0, 0.5, 0.0, 3.0],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 2.0, 1e7],
        ],
    ));
    rows.extend([(1, turn(1, 1.0, [1.0; 3], [5.0; 3])); 3]);
    let (scene, _) = rounded(scene([steps(0.8), InstanceSteps::default()], &rows));
    let plain = plain(&scene.encode().unwrap());
    assert_eq!(
        (plain.len(), ContentHash::of(&plain).to_string()),
        (GOLDEN.0, GOLDEN.1.to_owned())
    );
}

const GOLDEN: (usize, &str) = (
    635,
    "a1a1f98e9d4f105759cc3ad0e18feb66ffe9e0b2e2555281d08092bed5a4333e",
);

fn plain(object: &[u8]) -> Vec<u8> {
    zstd::bulk::decompress(&object[12..], 1 << 24).unwrap()
}

fn packed(plain: &[u8]) -> Vec<u8> {
    let length = (plain.len() as u64).to_le_bytes();
    let packed = zstd::bulk::compress(plain, 1).unwrap();
    [b"LSS2", &length[..], &packed].concat()
}

/// Mutations below the compression, where its checks do not catch them.
#[test]
fn no_mutated_column_breaks_the_reader() {
    let mut rows = turns(40);
    rows.extend([(1, turn(1, 1.0, [1.0, 2.0, 1.0], [5.0; 3])); 5]);
    rows.push((0, turn(2, 1.0, [1.0, 2.0, 1.5], [5.0; 3])));
    let (scene, _) = rounded(scene([steps(0.8), InstanceSteps::default()], &rows));
    let plain = plain(&scene.encode().unwrap());
    let mut state = 7u64;
    let mut random = || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 33) as usize
    };
    for length in 0..plain.len() {
        assert!(Scene::decode(&packed(&plain[..length])).is_err());
    }
    let mut read = 0;
    for _ in 0..20_000 {
        let mut bytes = plain.clone();
        for _ in 0..1 + random() % 3 {
            let at = random() % bytes.len();
            bytes[at] = random() as u8;
        }
        if let Ok(scene) = Scene::decode(&packed(&bytes)) {
            read += 1;
            assert_eq!(
                bits(&Scene::decode(&scene.encode().unwrap()).unwrap()),
                bits(&scene)
            );
        }
    }
    assert!(read > 0);
}

/// A list takes memory for what it has bytes for, and not beyond the bound.
#[test]
fn lists_beyond_their_bounds_are_refused() {
    let scene = scene([InstanceSteps::default(); 2], &turns(10_000));
    let bytes = scene.encode().unwrap();
    assert!(Scene::decode_within(&bytes, 16 << 20).is_ok());
    let error = Scene::decode_within(&bytes, 1_500_000)
        .map(drop)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("scene instances: expected at most"),
        "{error}"
    );

    let mut nobody = scene.clone();
    nobody.instances[3].asset = 2;
    let error = nobody.encode().unwrap_err().to_string();
    assert_eq!(error, "scene instance 3 asset: expected below 2, found 2");

    let mut endless = scene;
    endless.instances[7].world_from_object[1][3] = f64::INFINITY;
    let error = Scene::decode(&endless.encode().unwrap())
        .unwrap_err()
        .to_string();
    assert!(error.contains("scene instance 7 transform"), "{error}");

    // A claim of 2^24 instances without their bytes.
    let claim = [&[0][..], &[252], &(1u32 << 24).to_le_bytes(), &[4], &[0; 4]].concat();
    let error = Scene::decode(&packed(&[claim, vec![0; 4]].concat()))
        .unwrap_err()
        .to_string();
    assert!(error.contains("instance columns"), "{error}");
    let claim = [&[0][..], &[252], &(1u32 << 25).to_le_bytes(), &[4], &[0; 4]].concat();
    let error = Scene::decode(&packed(&[claim, vec![0; 4]].concat()))
        .unwrap_err()
        .to_string();
    assert_eq!(
        error,
        "scene instances: expected at most 16777216, found 33554432"
    );

    let error = Scene {
        assets: vec![SceneAsset {
            name: String::new(),
            asset: ContentHash::of(b"rock"),
            materials: vec![],
            steps: InstanceSteps {
                turn: -1.0,
                ..InstanceSteps::default()
            },
        }],
        ..Scene::default()
    };
    let error = Scene::decode(&error.encode().unwrap())
        .unwrap_err()
        .to_string();
    assert!(error.contains("scene asset 0 steps"), "{error}");
}
