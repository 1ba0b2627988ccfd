//! Turns with a uniform scale, by a quaternion whose squares add up to the scale.

use super::{InstanceSteps, LinearPart, doubled, integer, is_step, largest_column, octave};
use crate::instances::Linear;

/// Steps of a turn of 1, 2, 3 and 4 numbers: the corner of a cell is equally far from its middle.
const TURN_STEPS: [f64; 4] = [2.0, 1.414, 1.154, 1.0];
/// Largest departure of a turn with a uniform scale from what it stands for, over the scale.
/// Composed transforms depart by a few units in the last place of an f32.
const MOST_DEPARTURE: f64 = 1e-6;

pub(super) fn turn_on_steps(
    steps: &InstanceSteps,
    linear: &Linear,
) -> Option<(LinearPart, Linear)> {
    let (mirrored, quaternion) = quaternion(linear)?;
    let size = quaternion.iter().map(|value| value * value).sum::<f64>();
    let octave = octave(size.sqrt(), steps.root)?;
    let least = 0.5 * doubled(steps.turn, octave);
    let count = quaternion.iter().filter(|it| it.abs() >= least).count();
    let step = turn_step(steps, octave, count);
    let mut numbers = [0; 4];
    for (number, value) in numbers.iter_mut().zip(quaternion) {
        if value.abs() >= least {
            *number = integer(value / step)?;
        }
    }
    let part = LinearPart::Turned {
        mirrored,
        octave,
        numbers,
    };
    let found = turned(steps, mirrored, octave, &numbers);
    Some((part, found))
}

/// `count` numbers are not zero.
fn turn_step(steps: &InstanceSteps, octave: u8, count: usize) -> f64 {
    doubled(TURN_STEPS[count.clamp(1, 4) - 1] * steps.turn, octave)
}

pub(super) fn turned(
    steps: &InstanceSteps,
    mirrored: bool,
    octave: u8,
    numbers: &[i64; 4],
) -> Linear {
    let count = numbers.iter().filter(|number| **number != 0).count();
    let step = turn_step(steps, octave, count);
    let [w, x, y, z] = numbers.map(|number| number as f64 * step);
    let linear = rotation(w, x, y, z);
    match mirrored {
        true => linear.map(|row| row.map(|value| -value)),
        false => linear,
    }
}

fn rotation(w: f64, x: f64, y: f64, z: f64) -> Linear {
    let [ww, xx, yy, zz] = [w * w, x * x, y * y, z * z];
    [
        [
            (ww + xx) - (yy + zz),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            (ww + yy) - (xx + zz),
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            (ww + zz) - (xx + yy),
        ],
    ]
}

/// The quaternion of a turn with a uniform scale, and whether the part mirrors; `None` of others.
fn quaternion(linear: &Linear) -> Option<(bool, [f64; 4])> {
    let [[a, b, c], [d, e, f], [g, h, i]] = *linear;
    let determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
    let mirrored = determinant < 0.0;
    let sign = if mirrored { -1.0 } else { 1.0 };
    let m = linear.map(|row| row.map(|value| sign * value));
    let scale = largest_column(linear);
    if !is_step(scale) || !scale.is_finite() {
        return None;
    }
    let trace = [
        scale + m[0][0] + m[1][1] + m[2][2],
        scale + m[0][0] - m[1][1] - m[2][2],
        scale - m[0][0] + m[1][1] - m[2][2],
        scale - m[0][0] - m[1][1] + m[2][2],
    ];
    let mut first = 0;
    for other in 1..4 {
        if trace[other] > trace[first] {
            first = other;
        }
    }
    // Twice the largest of the four; the others follow from sums and differences.
    let twice = trace[first].sqrt();
    let over = |value: f64| value / (2.0 * twice);
    let [x, y, z] = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]];
    let [xy, xz, yz] = [m[0][1] + m[1][0], m[0][2] + m[2][0], m[1][2] + m[2][1]];
    let half = 0.5 * twice;
    let found = match first {
        0 => [half, over(x), over(y), over(z)],
        1 => [over(x), half, over(xy), over(xz)],
        2 => [over(y), over(xy), half, over(yz)],
        _ => [over(z), over(xz), over(yz), half],
    };
    let found = match found[0] < 0.0 {
        true => found.map(|value| -value),
        false => found,
    };
    let back = rotation(found[0], found[1], found[2], found[3]);
    let mut both = back.iter().flatten().zip(m.iter().flatten());
    let is_turn = both.all(|(a, b)| (a - b).abs() <= MOST_DEPARTURE * scale);
    is_turn.then_some((mirrored, found))
}
