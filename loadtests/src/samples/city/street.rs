//! The ground of a city block with its half of the streets around it.

use glam::DVec3;

use super::facade::moulding;
use super::palette::{ASPHALT, GRASS, METAL, PAVING, STONE};
use crate::samples::surface::{Frame, Model};

/// Metres from one block's middle to the next.
pub(super) const PITCH: f64 = 64.0;
/// Metres from a block's middle to its kerb.
pub(super) const KERB: f64 = 24.0;
/// Metres that the pavement stands above the street.
pub(super) const STEP: f64 = 0.15;
/// Metres from a block's middle to the inner edge of its pavement.
const LOT: f64 = 20.5;

/// The ground of a block; `is_green` for lawns inside the pavement, slabs otherwise.
pub(super) fn block(is_green: bool) -> Model {
    let mut model = Model::new(
        if is_green {
            "green block"
        } else {
            "paved block"
        },
        true,
        true,
    );
    model.part(ASPHALT, [0.10; 3]).tile_metres = 3.0;
    model.part(PAVING, [1.0; 3]).tile_metres = 3.2;
    model.part(GRASS, [1.0; 3]).tile_metres = 5.0;
    for (face, _) in Frame::around([PITCH / 2.0; 2], 0.0) {
        street(&mut model, &face);
    }
    // Below the kerb the ground goes on, so that the city's edge has a side.
    moulding(
        &mut model,
        ASPHALT,
        [0.08; 3],
        [PITCH / 2.0; 2],
        0.0,
        &[(0.0, -0.6), (0.0, 0.0)],
    );
    let kerb = [
        (0.0, -0.02),
        (0.0, STEP - 0.03),
        (-0.03, STEP),
        (-0.22, STEP),
    ];
    moulding(&mut model, STONE, [0.46, 0.45, 0.43], [KERB; 2], 0.0, &kerb);
    ring(
        &mut model,
        PAVING,
        [0.34, 0.33, 0.31],
        KERB - 0.22,
        LOT,
        STEP,
    );
    let edging = [
        (0.0, STEP),
        (0.0, STEP + 0.07),
        (-0.03, STEP + 0.09),
        (-0.14, STEP + 0.09),
        (-0.16, STEP + 0.03),
    ];
    moulding(
        &mut model,
        STONE,
        [0.42, 0.41, 0.39],
        [LOT; 2],
        0.0,
        &edging,
    );
    let (material, colour) = if is_green {
        (GRASS, [0.10, 0.17, 0.045])
    } else {
        (PAVING, [0.25, 0.235, 0.215])
    };
    let inner = LOT - 0.16;
    grid(
        &mut model,
        material,
        colour,
        [-inner, -inner],
        [inner, inner],
        STEP + 0.03,
        6,
    );
    model
}

/// One side's half street: asphalt with the centre line's half, zebra crossings at both ends, and a corner.
fn street(model: &mut Model, face: &Frame) {
    let width = PITCH / 2.0 - KERB;
    let along: Vec<f64> = {
        let mut cuts = vec![width, width + 0.8, width + 3.6];
        cuts.extend((0..20).map(|dash| width + 5.0 + 2.0 * f64::from(dash)));
        cuts.extend([PITCH - width - 3.6, PITCH - width - 0.8, PITCH - width]);
        cuts.sort_by(f64::total_cmp);
        cuts
    };
    // Distance from the street's middle: half of the centre line, then stripes of half a metre.
    let mut across = vec![0.0, 0.09];
    across.extend((1..16).map(|stripe| f64::from(stripe) * 0.5));
    across.push(width);
    let asphalt = model.part(ASPHALT, [0.10; 3]);
    for (i, s) in along.windows(2).enumerate() {
        for (k, t) in across.windows(2).enumerate() {
            let is_zebra = (i == 1 || i == along.len() - 3) && k % 2 == 1;
            let is_dash = k == 0 && i % 2 == 1 && i > 2 && i < along.len() - 4;
            let colour = if is_zebra || is_dash {
                [0.62, 0.62, 0.60]
            } else {
                [0.105, 0.105, 0.11]
            };
            asphalt.pen = crate::samples::number::rgb(colour);
            let corner = |x: f64, z: f64| face.at(x, 0.0, -z);
            asphalt.flat(&[
                corner(s[0], t[0]),
                corner(s[1], t[0]),
                corner(s[1], t[1]),
                corner(s[0], t[1]),
            ]);
        }
    }
    asphalt.pen = crate::samples::number::rgb([0.10, 0.10, 0.105]);
    // Each of the four sides brings one corner of the crossing.
    let corner = |x: f64, z: f64| face.at(x * width, 0.0, -z * width);
    asphalt.flat(&[
        corner(0.0, 0.0),
        corner(1.0, 0.0),
        corner(1.0, 1.0),
        corner(0.0, 1.0),
    ]);
    // A manhole cover in the lane.
    let lid = Frame {
        origin: face.at(PITCH * 0.36, 0.0, -3.0),
        ..Frame::world()
    };
    model.part(METAL, [0.09; 3]).lathe(
        &lid,
        &[
            (0.42, 0.0),
            (0.40, 0.012),
            (0.33, 0.012),
            (0.31, 0.004),
            (0.0, 0.006),
        ],
        28,
    );
}

/// A flat square ring between two half sizes, cut into squares of paving.
fn ring(model: &mut Model, material: usize, colour: [f64; 3], outer: f64, inner: f64, y: f64) {
    for (low, high) in [
        ([-outer, inner], [outer, outer]),
        ([-outer, -outer], [outer, -inner]),
        ([-outer, -inner], [-inner, inner]),
        ([inner, -inner], [outer, inner]),
    ] {
        grid(model, material, colour, low, high, y, 4);
    }
}

/// A flat rectangle in the plane at `y`, cut `cuts` by `cuts`.
fn grid(
    model: &mut Model,
    material: usize,
    colour: [f64; 3],
    low: [f64; 2],
    high: [f64; 2],
    y: f64,
    cuts: usize,
) {
    let rows: Vec<Vec<DVec3>> = (0..=cuts)
        .map(|row| {
            (0..=cuts)
                .map(|column| {
                    let part = |axis: usize, step: usize| {
                        low[axis] + (high[axis] - low[axis]) * step as f64 / cuts as f64
                    };
                    DVec3::new(part(0, column), y, part(1, cuts - row))
                })
                .collect()
        })
        .collect();
    model.part(material, colour).sheet(&rows, false);
}
