//! Houses with framed windows, a porch, a chimney and every roof tile.

use glam::DVec3;

use super::facade::{Finish, Rectangle, door, moulding, window};
use super::palette::{BRICK, METAL, STONE, TILES};
use crate::samples::number::{Random, turn};
use crate::samples::surface::{Frame, Model, Surface};

const STOREY: f64 = 2.9;
const BAY: f64 = 2.7;
/// Metres that the roof reaches past the walls.
const EAVES: f64 = 0.55;

/// House `kind` of four; further kinds repeat the four with other colours.
pub(super) fn house(kind: usize, seed: u64) -> Model {
    let mut random = Random::new(seed, 200 + kind as u64);
    let (bays, storeys, wall, colour, tiles): ([usize; 2], usize, _, [f64; 3], [f64; 3]) =
        match kind % 4 {
            0 => ([3, 4], 2, STONE, [0.78, 0.72, 0.60], [0.42, 0.14, 0.08]),
            1 => ([3, 3], 2, BRICK, [1.0, 0.95, 0.90], [0.13, 0.14, 0.16]),
            2 => ([4, 4], 1, STONE, [0.56, 0.64, 0.66], [0.36, 0.17, 0.10]),
            _ => ([3, 4], 2, STONE, [0.74, 0.50, 0.34], [0.22, 0.12, 0.09]),
        };
    let fade = if kind < 4 {
        1.0
    } else {
        random.between(0.75, 1.1)
    };
    let finish = Finish {
        wall,
        wall_colour: colour.map(|c| c * fade),
        trim: STONE,
        trim_colour: [0.80, 0.79, 0.76],
    };
    let mut model = Model::new(format!("house {kind}"), true, true);
    model.part(BRICK, [1.0; 3]).tile_metres = 2.4;
    model.part(STONE, [1.0; 3]).tile_metres = 4.0;
    let half = bays.map(|count| count as f64 * BAY / 2.0);
    let plinth = 0.45;
    let stone = [0.40, 0.39, 0.37];
    moulding(
        &mut model,
        STONE,
        stone,
        half,
        0.0,
        &[
            (0.14, -0.3),
            (0.14, plinth - 0.06),
            (0.08, plinth),
            (0.0, plinth),
        ],
    );
    for (side, (face, length)) in Frame::around(half, plinth).into_iter().enumerate() {
        let count = (length / BAY).round() as usize;
        for storey in 0..storeys {
            for bay in 0..count {
                let (left, bottom) = (bay as f64 * BAY, storey as f64 * STOREY);
                let cell = Rectangle {
                    left,
                    bottom,
                    right: left + BAY,
                    top: bottom + STOREY,
                };
                if side == 0 && storey == 0 && bay == count / 2 {
                    let opening = Rectangle {
                        left: left + 0.85,
                        bottom,
                        right: left + BAY - 0.85,
                        top: bottom + 2.2,
                    };
                    door(
                        &mut model,
                        &finish,
                        &face,
                        cell,
                        opening,
                        [0.10, 0.16, 0.20],
                    );
                    porch(&mut model, &finish, &face, left, left + BAY, plinth);
                } else {
                    let opening = Rectangle {
                        left: left + 0.72,
                        bottom: bottom + 0.85,
                        right: left + BAY - 0.72,
                        top: bottom + 2.3,
                    };
                    window(&mut model, &finish, &face, cell, opening, &mut random);
                    shutters(&mut model, &face, opening, tiles);
                }
            }
        }
    }
    let eaves = plinth + storeys as f64 * STOREY;
    roof(&mut model, &finish, half, eaves, tiles, &mut random);
    model
}

/// Louvred shutters beside a window.
fn shutters(model: &mut Model, face: &Frame, opening: Rectangle, colour: [f64; 3]) {
    let wood = model.part(METAL, colour.map(|c| 0.05 + c * 0.5));
    for (left, right) in [
        (opening.left - 0.66, opening.left - 0.17),
        (opening.right + 0.17, opening.right + 0.66),
    ] {
        wood.bevelled(
            face,
            [left, opening.bottom, 0.0],
            [right, opening.top, 0.05],
            0.015,
        );
        for slat in 0..5 {
            let up = opening.bottom + 0.14 + 0.25 * f64::from(slat);
            wood.cuboid(
                face,
                [left + 0.06, up, 0.04],
                [right - 0.06, up + 0.17, 0.075],
                16,
            );
        }
    }
}

/// Steps, two columns and a small roof before the door.
fn porch(model: &mut Model, finish: &Finish, face: &Frame, left: f64, right: f64, plinth: f64) {
    let step = model.part(STONE, [0.42, 0.41, 0.39]);
    step.bevelled(face, [left, -plinth - 0.2, 0.0], [right, 0.0, 1.5], 0.03);
    step.bevelled(
        face,
        [left + 0.4, -plinth - 0.2, 1.4],
        [right - 0.4, -0.22, 1.9],
        0.03,
    );
    let profile = [
        (0.17, 0.0),
        (0.17, 0.12),
        (0.13, 0.18),
        (0.115, 0.3),
        (0.12, 1.2),
        (0.10, 2.2),
        (0.14, 2.28),
        (0.17, 2.34),
        (0.17, 2.45),
    ];
    for x in [left + 0.25, right - 0.25] {
        let foot = Frame {
            origin: face.at(x, 0.0, 1.25),
            ..*face
        };
        model
            .part(STONE, finish.trim_colour)
            .lathe(&foot, &profile, 20);
    }
    let top = model.part(STONE, finish.trim_colour);
    top.bevelled(
        face,
        [left - 0.1, 2.42, -0.02],
        [right + 0.1, 2.62, 1.6],
        0.05,
    );
    top.bevelled(
        face,
        [left - 0.2, 2.6, -0.02],
        [right + 0.2, 2.70, 1.7],
        0.03,
    );
}

/// A gabled roof along z: gable walls, boards, tiles, ridge, chimney.
fn roof(
    model: &mut Model,
    finish: &Finish,
    half: [f64; 2],
    eaves: f64,
    tiles: [f64; 3],
    random: &mut Random,
) {
    let [x, z] = half;
    let rise = x * 0.85;
    let ridge = eaves + rise;
    for end in [1.0, -1.0] {
        let wall = model.part(finish.wall, finish.wall_colour);
        let mut gable = [
            DVec3::new(-x, eaves, z * end),
            DVec3::new(x, eaves, z * end),
            DVec3::new(0.0, ridge, z * end),
        ];
        wall.facing(&mut gable, DVec3::Z * end);
        let vent = Frame {
            origin: DVec3::new(0.0, eaves + rise * 0.42, z * end),
            right: DVec3::X * end,
            up: DVec3::Z * end,
            out: DVec3::NEG_Y,
        };
        model.part(STONE, finish.trim_colour).lathe(
            &vent,
            &[
                (0.50, -0.02),
                (0.50, 0.08),
                (0.36, 0.10),
                (0.34, 0.02),
                (0.0, 0.02),
            ],
            28,
        );
    }
    let slope = DVec3::new(x, -rise, 0.0).normalize_or(DVec3::X);
    // The eaves continue the slope past the wall.
    let length = ((x * x + rise * rise).sqrt()) + EAVES;
    for side in [1.0, -1.0] {
        let down = DVec3::new(slope.x * side, slope.y, 0.0);
        let frame = Frame {
            origin: DVec3::new(0.0, ridge, (z + EAVES) * side),
            right: DVec3::NEG_Z * side,
            up: -down,
            out: DVec3::NEG_Z.cross(-down) * side,
        };
        let width = 2.0 * (z + EAVES);
        let boards = model.part(STONE, [0.30, 0.24, 0.18]);
        boards.cuboid(&frame, [0.0, -length, -0.10], [width, 0.0, 0.0], 0);
        tile_slope(
            model.part(TILES, tiles),
            &frame,
            width,
            length,
            tiles,
            random,
        );
        // Gutter: a half pipe under the lowest tiles.
        let gutter = model.part(METAL, [0.30, 0.31, 0.32]);
        let pipe = |along: f64| (frame.at(along, -length - 0.06, -0.06), 0.07);
        gutter.tube(&[pipe(0.0), pipe(width / 2.0), pipe(width)], 10);
    }
    let cap = |along: f64| (DVec3::new(0.0, ridge + 0.02, along), 0.14);
    let caps: Vec<_> = (0..=16)
        .map(|i| cap((z + EAVES) * (f64::from(i) / 8.0 - 1.0)))
        .collect();
    model.part(TILES, tiles.map(|c| c * 0.85)).tube(&caps, 12);

    let place = Frame {
        origin: DVec3::new(x * 0.38, 0.0, -z * 0.4),
        ..Frame::world()
    };
    let stack = model.part(BRICK, [0.85, 0.80, 0.78]);
    stack.bevelled(
        &place,
        [-0.42, eaves, -0.42],
        [0.42, ridge + 0.75, 0.42],
        0.02,
    );
    stack.bevelled(
        &place,
        [-0.52, ridge + 0.6, -0.52],
        [0.52, ridge + 0.8, 0.52],
        0.03,
    );
    for pot in [-0.2, 0.2] {
        let foot = Frame {
            origin: place.at(pot, ridge + 0.78, 0.0),
            ..place
        };
        model.part(TILES, [0.40, 0.16, 0.09]).lathe(
            &foot,
            &[
                (0.14, 0.0),
                (0.12, 0.4),
                (0.16, 0.45),
                (0.16, 0.52),
                (0.10, 0.52),
                (0.10, 0.3),
            ],
            16,
        );
    }
}

/// Courses of barrel tiles on a slope; each course lies over the one below.
fn tile_slope(
    surface: &mut Surface,
    frame: &Frame,
    width: f64,
    length: f64,
    colour: [f64; 3],
    random: &mut Random,
) {
    let courses = (length / 0.62).round().max(1.0);
    let across = (width / 0.58).round().max(1.0);
    let (step, pitch) = (length / courses, width / across);
    for course in 0..courses as usize {
        for column in 0..across as usize {
            let tone = random.between(0.75, 1.2);
            surface.pen = crate::samples::number::rgb(colour.map(|c| c * tone));
            let left = column as f64 * pitch;
            let (high, low) = (
                -(course as f64) * step,
                -(course as f64 + 1.0) * step - 0.06,
            );
            let row = |along: f64, lift: f64| -> Vec<DVec3> {
                (0..=3)
                    .map(|k| {
                        let (_, sine) = turn(f64::from(k) / 6.0);
                        frame.at(
                            left + pitch * f64::from(k) / 3.0,
                            along,
                            lift + 0.095 * sine,
                        )
                    })
                    .collect()
            };
            surface.sheet(&[row(low, 0.055), row(high, 0.012)], false);
            let (lip, under) = (row(low, 0.055), row(low, 0.015));
            for k in 0..3 {
                surface.flat(&[under[k], under[k + 1], lip[k + 1], lip[k]]);
            }
        }
    }
}
