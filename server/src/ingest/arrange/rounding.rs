//! Instances onto steps: no point of an asset moves by more than a quarter of its rounding.
//!
//! The rounding of an asset is half the diagonal of a cell of its grid; in the world it is as much
//! larger as the instance stretches. Where offsets are shorter as they are, turns alone take the
//! quarter; else two fifths of it, and the offsets the most of the rest. Each instance is then
//! measured at the corners of the box, and stays as it was where it would move farther.

use lodestream_format::Scene;
use lodestream_format::instances::{
    InstanceSteps, Placing, SharedParts, largest_column, linear_of, offset_of,
};
use lodestream_format::scene::Instance;

use super::{AssetBox, Freedom};
use crate::ingest::neighbours::Placed;

/// Share of the rounding that an instance may move by.
const MOVED_SHARE: f64 = 0.25;
/// Share of it for the linear part where offsets keep their bits.
const LINEAR_ALONE_SHARE: f64 = 0.95;
/// Shares of it for the linear part and the offset.
const LINEAR_SHARE: f64 = 0.4;
const OFFSET_SHARE: f64 = 0.55;
/// Fewest instances for which the steps of an asset pay.
const LEAST_MOVED: u32 = 8;
/// Largest share of different values in a coordinate that is still short bit by bit.
const REPEATED_SHARE: usize = 4;

/// Chooses the steps of the assets, and moves the instances onto them. They are in their order.
pub(super) fn round(scene: &mut Scene, boxes: &[AssetBox], freedoms: &[Freedom]) {
    let shared = SharedParts::new(&scene.instances);
    let is_own = |instance: &Instance| shared.number(&linear_of(instance)).is_none();
    let is_free = |instance: &Instance| {
        let freedom = freedoms[instance.asset as usize];
        let least = if is_own(instance) {
            Freedom::Own
        } else {
            Freedom::All
        };
        freedom >= least && has_volume(instance)
    };
    let moves_offsets = {
        let free = || scene.instances.iter().filter(|instance| is_free(instance));
        offsets_are_long(free, boxes)
    };
    let may_move = |instance: &Instance| is_free(instance) && (moves_offsets || is_own(instance));
    let mut least = vec![f64::INFINITY; boxes.len()];
    let mut moved = vec![0u32; boxes.len()];
    for instance in &scene.instances {
        if may_move(instance) {
            let asset = instance.asset as usize;
            moved[asset] += 1;
            if is_own(instance) {
                let stretch = largest_column(&linear_of(instance));
                least[asset] = least[asset].min(stretch);
            }
        }
    }
    for (asset, used) in scene.assets.iter_mut().enumerate() {
        if moved[asset] >= LEAST_MOVED {
            used.steps = steps(&boxes[asset], least[asset], moves_offsets);
        }
    }
    let mut placing = Placing::default();
    for instance in &mut scene.instances {
        let asset = instance.asset as usize;
        let steps = &scene.assets[asset].steps;
        if may_move(instance)
            && let Some(nearest) = placing.nearest(steps, instance, !is_own(instance))
            && is_near(&boxes[asset], instance, &nearest)
        {
            *instance = nearest;
        }
        placing.pass(steps, instance);
    }
}

/// Steps of an asset whose own turns stretch by `least` or more.
fn steps(around: &AssetBox, least: f64, moves_offsets: bool) -> InstanceSteps {
    // A turn moves nothing there.
    let (center, share) = match moves_offsets {
        true => (around.center.map(f64::from), LINEAR_SHARE),
        false => ([0.0; 3], LINEAR_ALONE_SHARE),
    };
    let radius = around
        .corners
        .iter()
        .map(|corner| distance(corner, &center));
    // Not zero: a mesh may be a point.
    let radius = radius.fold(around.rounding, f64::max);
    let moved = MOVED_SHARE * around.rounding;
    // Rounded roots stay above it.
    let root = 0.999 * least.sqrt();
    let (root, turn) = match root.is_finite() {
        true => (root, 0.5 * share * moved * root / radius),
        false => (0.0, 0.0),
    };
    InstanceSteps {
        center: around.center,
        root,
        turn,
        offset: if moves_offsets {
            offset_step(around)
        } else {
            0.0
        },
    }
}

fn offset_step(around: &AssetBox) -> f64 {
    // Half the diagonal of a cell of the step.
    OFFSET_SHARE * MOVED_SHARE * around.rounding / 0.75f64.sqrt()
}

/// Whether the offsets of these instances take more bits as they are than on steps. Those of single
/// precision and those of a lattice do not.
fn offsets_are_long<'a, I: Iterator<Item = &'a Instance>>(
    free: impl Fn() -> I,
    boxes: &[AssetBox],
) -> bool {
    let bits = |number: f64| (1.0 + number).log2();
    let (mut count, mut on_steps) = (0usize, 0.0);
    let mut before: Option<[f64; 3]> = None;
    for instance in free() {
        let offset = offset_of(instance);
        let around = &boxes[instance.asset as usize];
        let step = offset_step(around) * largest_column(&linear_of(instance));
        for axis in 0..3 {
            let from = before.map_or(offset[axis], |before| before[axis]);
            on_steps += bits((offset[axis] - from).abs() / step);
        }
        before = Some(offset);
        count += 1;
    }
    let mut exact = 0.0;
    for axis in 0..3 {
        let mut values: Vec<u64> = free().map(|it| offset_of(it)[axis].to_bits()).collect();
        // Zeros that all have at their end are not stored.
        let zeros = values
            .iter()
            .fold(0, |all, bits| all | bits)
            .trailing_zeros();
        let unit = 2f64.powi(zeros.min(63) as i32);
        let differences = values.windows(2).map(|pair| pair[0].abs_diff(pair[1]));
        let differences: f64 = differences.map(|it| bits(it as f64 / unit)).sum();
        values.sort_unstable();
        values.dedup();
        // Few values are a table, and an index each.
        let is_table = REPEATED_SHARE * values.len() <= count;
        let index = count as f64 * bits(values.len() as f64);
        exact += if is_table {
            index.min(differences)
        } else {
            differences
        };
    }
    exact > on_steps
}

fn has_volume(instance: &Instance) -> bool {
    Placed::new(0, &instance.world_from_object).is_some()
}

/// Whether no corner of the box moves by more than its share of the rounding.
fn is_near(around: &AssetBox, from: &Instance, to: &Instance) -> bool {
    let most = MOVED_SHARE * around.rounding * largest_column(&linear_of(from));
    let moves = |corner: &[f64; 3]| {
        // Differences first: far from the origin the places themselves would round.
        let mut square = 0.0;
        for (from, to) in from.world_from_object.iter().zip(&to.world_from_object) {
            let along = |axis: usize| (to[axis] - from[axis]) * corner[axis];
            let moved = along(0) + along(1) + along(2) + (to[3] - from[3]);
            square += moved * moved;
        }
        square.sqrt()
    };
    around.corners.iter().all(|corner| moves(corner) <= most)
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let squares = (0..3).map(|axis| (a[axis] - b[axis]) * (a[axis] - b[axis]));
    squares.sum::<f64>().sqrt()
}
