//! A placing as integers: where an instance lies on the steps of its asset.

mod turns;

use super::{Linear, instance_of, linear_of, offset_of};
use crate::error::{FormatError, ensure};
use crate::scene::Instance;
use turns::{turn_on_steps, turned};

/// Steps on which the instances of an asset may lie. All zero where they are stored bit by bit.
#[derive(Debug, Clone, Copy, PartialEq, Default, bincode::Encode, bincode::Decode)]
pub struct InstanceSteps {
    /// Centre of the asset's box, object space. Offsets are steps of the place where it lies.
    pub center: [f32; 3],
    /// Smallest root of a stretch for which [`Self::turn`] is meant; twice that has twice the step.
    pub root: f64,
    /// Step of a turn's four numbers, whose squares add up to the scale.
    pub turn: f64,
    /// Step of an offset where the stretch is one; zero where offsets are stored bit by bit.
    pub offset: f64,
}

impl InstanceSteps {
    /// Refuses what is no step, of the scene's asset `index`.
    pub(crate) fn check(&self, index: usize) -> Result<(), FormatError> {
        let steps = [self.root, self.turn, self.offset];
        let is_usable = |step: &f64| step.is_finite() && *step >= 0.0;
        ensure(
            steps.iter().all(is_usable) && self.center.iter().all(|value| value.is_finite()),
            format_args!("scene asset {index} steps"),
            "finite numbers, no step below zero",
            format_args!("{self:?}"),
        )
    }
}

/// Step of a linear part's numbers, over the root and the step of turns.
const GENERAL_STEP: f64 = 1.25;
/// Integers of more bits are no shorter than the number itself, and may not be exact.
const MOST_INTEGER: f64 = (1u64 << 48) as f64;
/// Largest exponent of two that steps grow by.
pub(super) const MOST_OCTAVE: u32 = 64;

/// A linear part as integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum LinearPart {
    /// Number of a shared part.
    Shared(u32),
    /// A turn with a uniform scale, by a quaternion whose norm is the root of the scale.
    Turned {
        mirrored: bool,
        octave: u8,
        /// Quaternion: w, x, y, z.
        numbers: [i64; 4],
    },
    /// Any, row by row.
    General { octave: u8, numbers: [i64; 9] },
    /// Any, bit by bit.
    Exact(Linear),
}

/// An offset as integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Offset {
    /// Steps from the centre of the instance before.
    Steps([i64; 3]),
    /// Bit by bit.
    Exact([f64; 3]),
}

/// An instance as integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Integers {
    pub linear: LinearPart,
    pub offset: Offset,
}

/// Goes over the instances of a list in their order.
#[derive(Debug, Default)]
pub struct Placing {
    /// Centre of the instance before, in the world.
    before: [f64; 3],
}

impl Placing {
    /// The instance nearest to `instance` on the steps, with its linear part as it is if
    /// `keeps_linear`, and its offset if there are no steps for it; `None` where it lies too many
    /// steps away. Does not go on: [`Self::pass`].
    pub fn nearest(
        &self,
        steps: &InstanceSteps,
        instance: &Instance,
        keeps_linear: bool,
    ) -> Option<Instance> {
        let exact = linear_of(instance);
        let linear = match keeps_linear {
            true => exact,
            false => linear_on_steps(steps, &exact)?.1,
        };
        let offset = match steps.offset > 0.0 {
            true => self.offset_on_steps(steps, &linear, instance)?.1,
            false => offset_of(instance),
        };
        Some(instance_of(instance.asset, &linear, offset))
    }

    /// Goes on to the instance after `instance`.
    pub fn pass(&mut self, steps: &InstanceSteps, instance: &Instance) {
        let center = center_in_world(steps, &linear_of(instance), offset_of(instance));
        // Far out a centre may not be a number, and nothing could follow it.
        if center.iter().all(|value| value.is_finite()) {
            self.before = center;
        }
    }

    /// The integers that give back every bit of `instance`.
    pub(crate) fn integers(
        &mut self,
        steps: &InstanceSteps,
        instance: &Instance,
        shared: Option<u32>,
    ) -> Integers {
        let exact = linear_of(instance);
        let same = |found: &Linear| {
            let both = found.iter().flatten().zip(exact.iter().flatten());
            both.into_iter().all(|(a, b)| a.to_bits() == b.to_bits())
        };
        let linear = match shared {
            Some(number) => LinearPart::Shared(number),
            None => match linear_on_steps(steps, &exact) {
                Some((part, found)) if same(&found) => part,
                _ => LinearPart::Exact(exact),
            },
        };
        let wanted = offset_of(instance);
        let offset = match self.offset_on_steps(steps, &exact, instance) {
            Some((numbers, found)) if found.map(f64::to_bits) == wanted.map(f64::to_bits) => {
                Offset::Steps(numbers)
            }
            _ => Offset::Exact(wanted),
        };
        self.pass(steps, instance);
        Integers { linear, offset }
    }

    /// The instance of `integers`; `None` where its numbers are not finite.
    pub(crate) fn instance(
        &mut self,
        steps: &InstanceSteps,
        asset: u32,
        integers: &Integers,
        shared: &[Linear],
    ) -> Option<Instance> {
        let linear = match integers.linear {
            LinearPart::Shared(number) => *shared.get(number as usize)?,
            LinearPart::Turned {
                mirrored,
                octave,
                numbers,
            } => turned(steps, mirrored, octave, &numbers),
            LinearPart::General { octave, numbers } => general(steps, octave, &numbers),
            LinearPart::Exact(linear) => linear,
        };
        let offset = match integers.offset {
            Offset::Steps(numbers) => self.offset_at(steps, &linear, &numbers),
            Offset::Exact(offset) => offset,
        };
        let mut values = linear.iter().flatten().chain(&offset);
        if !values.all(|value| value.is_finite()) {
            return None;
        }
        let instance = instance_of(asset, &linear, offset);
        self.pass(steps, &instance);
        Some(instance)
    }

    fn offset_on_steps(
        &self,
        steps: &InstanceSteps,
        linear: &Linear,
        instance: &Instance,
    ) -> Option<([i64; 3], [f64; 3])> {
        let step = steps.offset * largest_column(linear);
        if !is_step(step) {
            return None;
        }
        // Where the linear part moved, the centre stays.
        let wanted = center_in_world(steps, &linear_of(instance), offset_of(instance));
        let mut numbers = [0; 3];
        for axis in 0..3 {
            numbers[axis] = integer((wanted[axis] - self.before[axis]) / step)?;
        }
        Some((numbers, self.offset_at(steps, linear, &numbers)))
    }

    fn offset_at(&self, steps: &InstanceSteps, linear: &Linear, numbers: &[i64; 3]) -> [f64; 3] {
        let step = steps.offset * largest_column(linear);
        let turned_center = center_in_world(steps, linear, [0.0; 3]);
        let axis =
            |axis: usize| (self.before[axis] + numbers[axis] as f64 * step) - turned_center[axis];
        [axis(0), axis(1), axis(2)]
    }
}

/// Length of the longest column: no stretch is larger than `sqrt(3)` times it, and none smaller
/// than it is the largest.
pub fn largest_column(linear: &Linear) -> f64 {
    let column = |column: usize| {
        let [a, b, c] = [0, 1, 2].map(|row| linear[row][column]);
        (a * a + b * b) + c * c
    };
    column(0).max(column(1)).max(column(2)).sqrt()
}

fn center_in_world(steps: &InstanceSteps, linear: &Linear, offset: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = steps.center.map(f64::from);
    let row = |row: usize| {
        let [a, b, c] = linear[row];
        (a * x + b * y) + (c * z + offset[row])
    };
    [row(0), row(1), row(2)]
}

fn is_step(step: f64) -> bool {
    step.is_normal() && step > 0.0
}

fn integer(steps: f64) -> Option<i64> {
    let whole = steps.round();
    // Not so of what is no number.
    (whole.abs() < MOST_INTEGER).then_some(whole as i64)
}

/// Doublings of the steps for what has `size`, where the smallest has `least`.
fn octave(size: f64, least: f64) -> Option<u8> {
    let mut octave = 0u32;
    let mut next = 2.0 * least;
    while size >= next && octave < MOST_OCTAVE {
        octave += 1;
        next *= 2.0;
    }
    (is_step(least) && next.is_finite()).then_some(octave as u8)
}

fn doubled(step: f64, octave: u8) -> f64 {
    step * (1u128 << u32::from(octave).min(MOST_OCTAVE)) as f64
}

/// The linear part nearest to `linear` on the steps, and its integers.
fn linear_on_steps(steps: &InstanceSteps, linear: &Linear) -> Option<(LinearPart, Linear)> {
    if !is_step(steps.turn) || !is_step(steps.root) {
        return None;
    }
    turn_on_steps(steps, linear).or_else(|| general_on_steps(steps, linear))
}

fn general_on_steps(steps: &InstanceSteps, linear: &Linear) -> Option<(LinearPart, Linear)> {
    let octave = octave(largest_column(linear), steps.root * steps.root)?;
    let step = general_step(steps, octave);
    let mut numbers = [0; 9];
    for (number, value) in numbers.iter_mut().zip(linear.iter().flatten()) {
        *number = integer(value / step)?;
    }
    let part = LinearPart::General { octave, numbers };
    Some((part, general(steps, octave, &numbers)))
}

fn general_step(steps: &InstanceSteps, octave: u8) -> f64 {
    doubled(GENERAL_STEP * steps.root * steps.turn, octave)
}

fn general(steps: &InstanceSteps, octave: u8, numbers: &[i64; 9]) -> Linear {
    let step = general_step(steps, octave);
    let at = |row: usize, column: usize| numbers[3 * row + column] as f64 * step;
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| at(row, column)))
}
