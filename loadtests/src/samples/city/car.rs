//! Cars: lofted bodies and cabins on turned wheels. They stand on y = 0 and look along +z.

use glam::DVec3;

use super::palette::{GLASS, METAL, PAINT};
use crate::samples::number::{Random, lerp, turn};
use crate::samples::surface::{Frame, Model, Surface};

/// Half length and half width of every car, metres.
const HALF_LENGTH: f64 = 2.15;
const HALF_WIDTH: f64 = 0.88;
const WHEEL_RADIUS: f64 = 0.33;

/// Car `kind` of three (saloon, van, taxi); further kinds have other colours.
pub(super) fn car(kind: usize, seed: u64) -> Model {
    let mut random = Random::new(seed, 400 + kind as u64);
    let mut model = Model::new(format!("car {kind}"), false, true);
    let paint = match kind {
        0 => [0.42, 0.035, 0.03],
        1 => [0.55, 0.56, 0.57],
        2 => [0.75, 0.45, 0.03],
        _ => std::array::from_fn(|_| random.between(0.03, 0.6)),
    };
    let is_van = kind % 3 == 1;
    body(model.part(PAINT, paint), is_van);
    cabin(&mut model, paint, is_van);
    for (x, z) in [(-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)] {
        wheel(&mut model, x, z * 1.32);
    }
    fittings(&mut model, kind % 3 == 2, is_van);
    model
}

/// A ring of a superellipse-like section: half width, bottom, top.
fn section(z: f64, half_width: f64, bottom: f64, top: f64, boxy: f64) -> Vec<DVec3> {
    let (middle, half) = ((bottom + top) / 2.0, (top - bottom) / 2.0);
    (0..32)
        .map(|step| {
            let (cosine, sine) = turn(f64::from(step) / 32.0);
            // Between a circle and a square by the larger of the two.
            let square = 1.0 / cosine.abs().max(sine.abs());
            let reach = lerp(1.0, square, boxy);
            DVec3::new(
                half_width * (cosine * reach).clamp(-1.0, 1.0),
                middle + half * (sine * reach).clamp(-1.0, 1.0),
                z,
            )
        })
        .collect()
}

/// Value at `t` of a curve through evenly spaced knots.
fn curve(knots: &[f64], t: f64) -> f64 {
    let at = t.clamp(0.0, 1.0) * (knots.len() - 1) as f64;
    let index = (at as usize).min(knots.len() - 2);
    let s = at - index as f64;
    lerp(knots[index], knots[index + 1], s * s * (3.0 - 2.0 * s))
}

fn body(surface: &mut Surface, is_van: bool) {
    let tops = if is_van {
        [0.72, 0.98, 1.0, 1.0, 0.98, 0.92, 0.62]
    } else {
        [0.70, 0.90, 0.93, 0.94, 0.92, 0.84, 0.58]
    };
    let widths = [0.86, 0.97, 1.0, 1.0, 1.0, 0.97, 0.82];
    let rows: Vec<Vec<DVec3>> = (0..=30)
        .map(|step| {
            let t = f64::from(step) / 30.0;
            section(
                lerp(-HALF_LENGTH, HALF_LENGTH, t),
                HALF_WIDTH * curve(&widths, t),
                0.24,
                curve(&tops, t),
                0.72,
            )
        })
        .collect();
    surface.sheet(&rows, true);
    for (ring, outward) in [(&rows[0], DVec3::NEG_Z), (&rows[30], DVec3::Z)] {
        let middle = ring.iter().sum::<DVec3>() / ring.len() as f64;
        for corner in 0..ring.len() {
            surface.facing(
                &mut [middle, ring[corner], ring[(corner + 1) % ring.len()]],
                outward,
            );
        }
    }
}

/// Glass all round, then the roof and pillars in paint.
fn cabin(model: &mut Model, paint: [f64; 3], is_van: bool) {
    // z of the foot and of the roof's edge, from rear to front.
    let (rear, rear_top, front_top, front, top) = if is_van {
        (-2.05, -1.95, 0.75, 1.35, 1.95)
    } else {
        (-1.65, -0.95, 0.35, 1.15, 1.46)
    };
    let foot = 0.86;
    let inset = 0.16;
    let outline = |low: f64| -> [DVec3; 4] {
        let t = (low - foot) / (top - foot);
        let x = lerp(HALF_WIDTH - 0.03, HALF_WIDTH - inset, t);
        let (back, ahead) = (lerp(rear, rear_top, t), lerp(front, front_top, t));
        [
            DVec3::new(-x, low, ahead),
            DVec3::new(x, low, ahead),
            DVec3::new(x, low, back),
            DVec3::new(-x, low, back),
        ]
    };
    let (lower, upper) = (outline(foot), outline(top - 0.06));
    let glass = model.part(GLASS, [0.025, 0.035, 0.04]);
    for side in 0..4 {
        let next = (side + 1) % 4;
        glass.flat(&[lower[side], lower[next], upper[next], upper[side]]);
    }
    let skin = model.part(PAINT, paint);
    for corner in 0..4 {
        skin.tube(
            &[
                (lower[corner], 0.055),
                (lower[corner].lerp(upper[corner], 0.5), 0.05),
                (upper[corner], 0.05),
            ],
            8,
        );
        let next = (corner + 1) % 4;
        skin.tube(&[(upper[corner], 0.055), (upper[next], 0.055)], 8);
    }
    // Pillars between the doors.
    let z = (rear_top + front_top) / 2.0;
    for x in [-1.0, 1.0] {
        let (low, high) = (
            DVec3::new(x * (HALF_WIDTH - 0.03), foot, z),
            DVec3::new(x * (HALF_WIDTH - inset), top - 0.06, z),
        );
        skin.tube(&[(low, 0.05), (high, 0.045)], 8);
    }
    // The roof bulges.
    let rows: Vec<Vec<DVec3>> = (0..=10)
        .map(|row| {
            let t = f64::from(row) / 10.0;
            (0..=10)
                .map(|column| {
                    let s = f64::from(column) / 10.0;
                    let edge = upper[3]
                        .lerp(upper[2], s)
                        .lerp(upper[0].lerp(upper[1], s), t);
                    edge + DVec3::Y * (0.045 + 0.30 * s * (1.0 - s) * (0.25 + t * (1.0 - t)))
                })
                .collect()
        })
        .collect();
    let turned: Vec<Vec<DVec3>> = rows.iter().rev().cloned().collect();
    skin.sheet(&turned, false);
}

fn wheel(model: &mut Model, side: f64, z: f64) {
    let axle = Frame {
        origin: DVec3::new(side * (HALF_WIDTH - 0.11), WHEEL_RADIUS, z),
        right: DVec3::Z,
        up: DVec3::X * side,
        out: DVec3::Z.cross(DVec3::X * side),
    };
    let tyre = [
        (0.20, -0.10),
        (0.30, -0.11),
        (0.33, -0.07),
        (0.33, 0.07),
        (0.30, 0.115),
        (0.23, 0.12),
        (0.21, 0.10),
    ];
    model.part(METAL, [0.018; 3]).lathe(&axle, &tyre, 32);
    model.part(METAL, [0.42, 0.43, 0.44]).lathe(
        &axle,
        &[
            (0.21, 0.10),
            (0.19, 0.06),
            (0.06, 0.075),
            (0.05, 0.11),
            (0.0, 0.115),
        ],
        32,
    );
    let arch = Frame {
        origin: axle.origin - axle.up * 0.02,
        ..axle
    };
    model
        .part(METAL, [0.012; 3])
        .lathe(&arch, &[(0.40, -0.30), (0.40, 0.08), (0.0, 0.08)], 32);
    for spoke in 0..5 {
        let (a, b) = turn(f64::from(spoke) / 5.0);
        let out = axle.right * a + axle.out * b;
        let path = [
            (axle.origin + axle.up * 0.095, 0.03),
            (axle.origin + out * 0.2 + axle.up * 0.075, 0.022),
        ];
        model.part(METAL, [0.50, 0.51, 0.52]).tube(&path, 6);
    }
}

/// Lamps, bumpers, plates, mirrors, and a taxi's sign.
fn fittings(model: &mut Model, is_taxi: bool, is_van: bool) {
    let world = Frame::world();
    let dark = model.part(METAL, [0.03; 3]);
    for z in [-HALF_LENGTH, HALF_LENGTH] {
        dark.bevelled(
            &world,
            [-0.76, 0.30, z - 0.09],
            [0.76, 0.44, z + 0.09],
            0.04,
        );
    }
    dark.bevelled(
        &world,
        [-0.34, 0.47, HALF_LENGTH - 0.08],
        [0.34, 0.56, HALF_LENGTH + 0.03],
        0.015,
    );
    for x in [-1.0, 1.0] {
        dark.bevelled(
            &world,
            [x * 0.97 - 0.11, 0.92, 0.88],
            [x * 0.97 + 0.11, 1.06, 1.0],
            0.03,
        );
        for z in [-0.72, 0.25] {
            dark.bevelled(
                &world,
                [x * 0.885 - 0.015, 0.72, z],
                [x * 0.885 + 0.015, 0.755, z + 0.2],
                0.01,
            );
        }
    }
    let plate = model.part(METAL, [0.70, 0.70, 0.66]);
    for z in [-HALF_LENGTH, HALF_LENGTH] {
        plate.bevelled(
            &world,
            [-0.26, 0.32, z - 0.11],
            [0.26, 0.43, z + 0.11],
            0.01,
        );
    }
    for x in [-0.56, 0.56] {
        let lamp = |z: f64, ahead: f64| Frame {
            origin: DVec3::new(x, 0.56, z),
            right: DVec3::X,
            up: DVec3::Z * ahead,
            out: DVec3::NEG_Y * ahead,
        };
        let dome = [(0.125, -0.12), (0.125, 0.0), (0.09, 0.035), (0.0, 0.05)];
        model
            .part(GLASS, [0.85, 0.84, 0.78])
            .lathe(&lamp(HALF_LENGTH - 0.02, 1.0), &dome, 20);
        model
            .part(GLASS, [0.45, 0.012, 0.01])
            .lathe(&lamp(-HALF_LENGTH + 0.02, -1.0), &dome, 20);
    }
    if is_taxi {
        model.part(GLASS, [0.9, 0.88, 0.75]).bevelled(
            &world,
            [-0.3, 1.5, -0.42],
            [0.3, 1.68, -0.2],
            0.04,
        );
    }
    if is_van {
        let rail = model.part(METAL, [0.20; 3]);
        for x in [-0.62, 0.62] {
            rail.tube(
                &[
                    (DVec3::new(x, 2.0, -1.8), 0.025),
                    (DVec3::new(x, 2.03, -0.6), 0.025),
                    (DVec3::new(x, 2.0, 0.6), 0.025),
                ],
                8,
            );
        }
    }
}
