//! Order and rounding of instances, against brute force.

use lodestream_format::scene::{Instance, SceneAsset};
use lodestream_format::{ContentHash, Scene};

use super::order::{BLOCK_INSTANCES, sort};
use super::rounding::round;
use super::{AssetBox, Freedom};

/// Step of the grid: 2^14 of them along a metre.
const STEP: f64 = 1.0 / 16_384.0;

/// A box of a metre, its centre aside.
fn around() -> AssetBox {
    let center = [0.25f32, 0.5, -2.0];
    let side = |axis: usize, high: bool| f64::from(center[axis]) + if high { 0.5 } else { -0.5 };
    AssetBox {
        corners: std::array::from_fn(|corner| {
            std::array::from_fn(|axis| side(axis, corner >> axis & 1 == 1))
        }),
        center,
        rounding: 0.75f64.sqrt() * STEP,
    }
}

struct Random(u64);

impl Random {
    /// 0 to 1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005);
        self.0 = self.0.wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    /// A turn about any axis, a uniform scale.
    fn turned(&mut self, scale: f64) -> [[f64; 3]; 3] {
        let q: [f64; 4] = std::array::from_fn(|_| self.within(-1.0, 1.0));
        let length = q.iter().map(|value| value * value).sum::<f64>().sqrt();
        let [w, x, y, z] = q.map(|value| value / length);
        let rows = [
            [
                w * w + x * x - y * y - z * z,
                2.0 * (x * y - w * z),
                2.0 * (x * z + w * y),
            ],
            [
                2.0 * (x * y + w * z),
                w * w - x * x + y * y - z * z,
                2.0 * (y * z - w * x),
            ],
            [
                2.0 * (x * z - w * y),
                2.0 * (y * z + w * x),
                w * w - x * x - y * y + z * z,
            ],
        ];
        rows.map(|row| row.map(|value| scale * value))
    }
}

/// Instances of one kind, at places around `far`.
fn instances(kind: &str, far: f64, count: usize) -> Vec<Instance> {
    let mut random = Random(3);
    let mut one = || {
        let scale = match kind {
            "scales" => 10f64.powf(random.within(-6.0, 6.0)),
            "mirrored" => -random.within(0.5, 2.0),
            _ => random.within(0.5, 2.0),
        };
        let linear = match kind {
            "same" => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            "sheared" => std::array::from_fn(|_| std::array::from_fn(|_| random.within(-2.0, 2.0))),
            "flat" => [
                [random.next(), 0.0, 0.0],
                [0.0; 3],
                [0.0, 0.0, random.next()],
            ],
            _ => random.turned(scale),
        };
        let at: [f64; 3] = std::array::from_fn(|_| far + random.within(-300.0, 300.0));
        Instance {
            asset: 0,
            world_from_object: std::array::from_fn(|row| {
                let [x, y, z] = linear[row];
                [x, y, z, at[row]]
            }),
        }
    };
    (0..count).map(|_| one()).collect()
}

fn scene(instances: Vec<Instance>) -> Scene {
    Scene {
        assets: vec![SceneAsset {
            name: "rock".to_owned(),
            asset: ContentHash::of(b"rock"),
            materials: vec![],
            steps: Default::default(),
        }],
        instances,
        ..Scene::default()
    }
}

/// Largest stretch of a linear part, by many directions.
fn stretch(instance: &Instance) -> f64 {
    let mut random = Random(9);
    let mut most = 0.0f64;
    for _ in 0..500 {
        let direction: [f64; 3] = std::array::from_fn(|_| random.within(-1.0, 1.0));
        let length = direction.iter().map(|value| value * value).sum::<f64>();
        let rows = instance.world_from_object.iter();
        let moved = rows.map(|row| (0..3).map(|axis| row[axis] * direction[axis]).sum::<f64>());
        most = most.max((moved.map(|value| value * value).sum::<f64>() / length).sqrt());
    }
    most
}

/// Largest distance that a corner moves, over a quarter of the rounding that is drawn.
fn moved(from: &Instance, to: &Instance) -> f64 {
    let around = around();
    let corner = |corner: &[f64; 3]| {
        let rows = from.world_from_object.iter().zip(&to.world_from_object);
        let differences = rows.map(|(from, to)| {
            let along = (0..3).map(|axis| (to[axis] - from[axis]) * corner[axis]);
            along.sum::<f64>() + (to[3] - from[3])
        });
        differences.map(|value| value * value).sum::<f64>().sqrt()
    };
    let most = around.corners.iter().map(corner).fold(0.0, f64::max);
    most / (0.25 * around.rounding * stretch(from)).max(f64::MIN_POSITIVE)
}

#[test]
fn no_corner_moves_by_more_than_a_quarter_of_the_rounding() {
    // The least share that moves. Far out the places are as fine as f64, and stay.
    for (kind, far, least) in [
        ("turned", 0.0, 0.99),
        ("turned", 1e6, 0.99),
        ("turned", 1e7, 0.99),
        ("mirrored", 1e6, 0.99),
        ("sheared", 0.0, 0.9),
        ("same", 0.0, 0.99),
        ("same", 1e7, 0.0),
        ("scales", 0.0, 0.5),
        ("scales", 1e7, 0.1),
        ("flat", 0.0, 0.0),
    ] {
        let before = scene(instances(kind, far, 2000));
        let mut after = before.clone();
        round(&mut after, &[around()], &[Freedom::All]);
        let pairs = || before.instances.iter().zip(&after.instances);
        let worst = pairs()
            .map(|(from, to)| moved(from, to))
            .fold(0.0, f64::max);
        assert!(worst <= 1.0, "{kind} at {far}: {worst}");
        let changed = pairs().filter(|(from, to)| from != to).count();
        assert!(
            changed as f64 >= least * 2000.0,
            "{kind} at {far}: {changed}"
        );
        let read = Scene::decode(&after.encode().expect("encodes")).expect("decodes");
        assert_eq!(read, after, "{kind} at {far}");
        if kind == "flat" {
            assert_eq!(changed, 0);
        }
    }
}

/// Borders that meet must go on meeting.
#[test]
fn instances_that_touch_others_keep_every_bit() {
    for kind in ["turned", "same", "sheared"] {
        let before = scene(instances(kind, 0.0, 500));
        let mut after = before.clone();
        round(&mut after, &[around()], &[Freedom::None]);
        assert_eq!(before, after);
    }
    // Not compared: tiles of one turn could meet, those with a turn of their own could not.
    let before = scene(instances("same", 0.0, 500));
    let mut after = before.clone();
    round(&mut after, &[around()], &[Freedom::Own]);
    assert_eq!(before, after);
    let before = scene(instances("turned", 0.0, 500));
    let mut after = before.clone();
    round(&mut after, &[around()], &[Freedom::Own]);
    assert_ne!(before, after);
}

/// A lattice, and places of single precision, are short as they are.
#[test]
fn shared_turns_stay_where_that_is_shorter() {
    for change in [
        |at: f64| f64::from(at as f32),
        |at: f64| (at / 30.0).round() * 7.3,
    ] {
        let mut before = scene(instances("same", 700.0, 2000));
        for row in before
            .instances
            .iter_mut()
            .flat_map(|it| &mut it.world_from_object)
        {
            row[3] = change(row[3]);
        }
        let mut after = before.clone();
        round(&mut after, &[around()], &[Freedom::All]);
        assert!(before == after, "moved");
    }
}

/// As most files have them: places of single precision stay, turns go onto steps.
#[test]
fn turns_move_where_offsets_are_short() {
    let mut before = scene(instances("turned", 0.0, 2000));
    for row in before
        .instances
        .iter_mut()
        .flat_map(|it| &mut it.world_from_object)
    {
        row[3] = f64::from((row[3] * 16.0).round() as f32 / 16.0);
    }
    let mut after = before.clone();
    round(&mut after, &[around()], &[Freedom::All]);
    for (from, to) in before.instances.iter().zip(&after.instances) {
        assert!(moved(from, to) <= 1.0);
        assert_ne!(from, to);
        let offset = |instance: &Instance| instance.world_from_object.map(|row| row[3]);
        assert_eq!(offset(from), offset(to));
    }
    let size = |scene: &Scene| scene.encode().expect("encodes").len();
    assert!(2 * size(&after) < size(&before));
}

#[test]
fn blocks_are_near_each_other_for_any_thread_count() {
    let scattered = instances("turned", 1e6, 64 * BLOCK_INSTANCES);
    let sorted = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let mut list = scattered.clone();
        pool.build()
            .expect("threads")
            .install(|| sort(&mut list, &[around()]));
        list
    };
    let one = sorted(1);
    assert_eq!(one, sorted(7));
    let spread = |block: &[Instance]| {
        let of = |axis: usize| block.iter().map(move |it| it.world_from_object[axis][3]);
        let side = |axis| of(axis).fold(f64::MIN, f64::max) - of(axis).fold(f64::MAX, f64::min);
        side(0) * side(1) * side(2)
    };
    // 64 blocks share the volume of 600 metres a side.
    let volume: f64 = one.chunks(BLOCK_INSTANCES).map(spread).sum();
    assert!(volume < 4.0 * 600f64.powi(3), "{volume}");
    // Equal places stay in their order.
    let mut same = instances("same", 0.0, 200);
    for (number, instance) in same.iter_mut().enumerate() {
        for row in &mut instance.world_from_object {
            row[3] = 5.0;
        }
        // Told apart by a part that does not move the centre of the box.
        instance.world_from_object[0][0] = 1.0 + number as f64;
        instance.world_from_object[0][3] -= 0.25 * number as f64;
    }
    let mut again = same.clone();
    sort(&mut again, &[around()]);
    assert_eq!(same, again);
}
