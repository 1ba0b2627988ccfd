//! Instances onto steps: no point of an asset moves by more than a quarter of its rounding.
//!
//! The rounding of an asset is half the diagonal of a cell of its grid; in the world it is as much
//! larger as the instance stretches. A turn takes two fifths of the quarter, the offset the most of
//! the rest. Each instance is then measured at the corners of the box, and stays as it was where it
//! would move farther.

use lodestream_format::Scene;
use lodestream_format::instances::{
    InstanceSteps, Placing, SharedParts, largest_column, linear_of, offset_of,
};
use lodestream_format::scene::Instance;

use super::{AssetBox, Freedom};
use crate::ingest::neighbours::Placed;

/// Share of the rounding that an instance may move by.
const MOVED_SHARE: f64 = 0.25;
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
    let shorter = shared_offsets_are_long(&scene.instances, &is_own);
    let may_move = |instance: &Instance| {
        let freedom = freedoms[instance.asset as usize];
        match is_own(instance) {
            true => freedom != Freedom::None && has_volume(instance),
            false => shorter && freedom == Freedom::All && has_volume(instance),
        }
    };
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
            used.steps = steps(&boxes[asset], least[asset]);
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
fn steps(around: &AssetBox, least: f64) -> InstanceSteps {
    let center = around.center.map(f64::from);
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
        true => (root, 0.5 * LINEAR_SHARE * moved * root / radius),
        false => (0.0, 0.0),
    };
    InstanceSteps {
        center: around.center,
        root,
        turn,
        // Half the diagonal of a cell of the step.
        offset: OFFSET_SHARE * moved / 0.75f64.sqrt(),
    }
}

/// Whether the offsets of instances with shared parts are longer bit by bit than on steps: neither
/// of the single precision of most files, nor of few values as in a lattice.
fn shared_offsets_are_long(instances: &[Instance], is_own: &impl Fn(&Instance) -> bool) -> bool {
    let mut count = 0;
    let mut long = 0;
    for instance in instances.iter().filter(|instance| !is_own(instance)) {
        count += 1;
        let is_long = |value: &f64| f64::from(*value as f32) != *value;
        long += usize::from(offset_of(instance).iter().any(is_long));
    }
    if 2 * long <= count {
        return false;
    }
    (0..3).any(|axis| {
        let own = instances.iter().filter(|instance| !is_own(instance));
        let mut values: Vec<u64> = own.map(|it| offset_of(it)[axis].to_bits()).collect();
        values.sort_unstable();
        values.dedup();
        REPEATED_SHARE * values.len() > count
    })
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
