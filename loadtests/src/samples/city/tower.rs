//! Towers: tiers of windowed floors with cornices, setbacks, balconies and something on the roof.

use glam::DVec3;

use super::crown;
use super::facade::{Finish, Rectangle, balcony, curtain, door, moulding, window};
use super::palette::{BRICK, STONE};
use crate::samples::number::Random;
use crate::samples::surface::{Frame, Model};

/// A storey's height, metres.
const STOREY: f64 = 3.4;
/// The ground floor's height, metres.
const GROUND: f64 = 4.6;
/// A bay's width, metres.
const BAY: f64 = 2.9;

#[derive(Clone, Copy, PartialEq)]
enum Style {
    Masonry,
    Balconies,
    Curtain,
}

/// Bays along x and z, and storeys.
type Tier = (usize, usize, usize);

/// Tower `rank` of six, from a corner house to the tallest; further ranks repeat the six with other colours.
pub(super) fn tower(rank: usize, seed: u64) -> Model {
    let mut random = Random::new(seed, 100 + rank as u64);
    let brick = (BRICK, [1.0, 0.96, 0.92]);
    let sand = (STONE, [0.60, 0.50, 0.37]);
    let limestone = (STONE, [0.62, 0.59, 0.53]);
    let (style, crown, (wall, wall_colour), tiers): (_, _, _, &[Tier]) = match rank % 6 {
        0 => (Style::Masonry, crown::Crown::WaterTank, brick, &[(6, 5, 5)]),
        1 => (Style::Balconies, crown::Crown::Plant, sand, &[(6, 5, 7)]),
        2 => (
            Style::Masonry,
            crown::Crown::WaterTank,
            (BRICK, [0.80, 0.74, 0.72]),
            &[(6, 6, 8), (4, 4, 4)],
        ),
        3 => (
            Style::Curtain,
            crown::Crown::Plant,
            limestone,
            &[(6, 6, 3), (5, 5, 15)],
        ),
        4 => (
            Style::Masonry,
            crown::Crown::Spire,
            limestone,
            &[(6, 6, 6), (4, 4, 9), (3, 3, 6)],
        ),
        _ => (
            Style::Curtain,
            crown::Crown::Spire,
            limestone,
            &[(6, 6, 9), (5, 5, 8), (3, 3, 10)],
        ),
    };
    let fade = if rank < 6 {
        1.0
    } else {
        random.between(0.75, 1.1)
    };
    let finish = Finish {
        wall,
        wall_colour: wall_colour.map(|c| c * fade),
        trim: STONE,
        trim_colour: [0.66, 0.62, 0.55],
    };
    let mut model = Model::new(format!("tower {rank}"), true, true);
    model.part(BRICK, [1.0; 3]).tile_metres = 2.4;
    model.part(STONE, [1.0; 3]).tile_metres = 4.0;
    let mut foot = 0.0;
    for (index, &tier) in tiers.iter().enumerate() {
        foot = raise(
            &mut model,
            style,
            &finish,
            tier,
            foot,
            index == 0,
            &mut random,
        );
    }
    let half = tiers.last().map_or([6.0; 2], |t| {
        [t.0 as f64 * BAY / 2.0, t.1 as f64 * BAY / 2.0]
    });
    crown::top(&mut model, crown, half, foot, &mut random);
    model
}

/// Builds a tier from `foot` up; returns the height of its roof.
fn raise(
    model: &mut Model,
    style: Style,
    finish: &Finish,
    tier: Tier,
    foot: f64,
    is_ground: bool,
    random: &mut Random,
) -> f64 {
    let half = [tier.0 as f64 * BAY / 2.0, tier.1 as f64 * BAY / 2.0];
    let ground = if is_ground { GROUND } else { 0.0 };
    if is_ground {
        shopfronts(model, finish, half, tier, random);
        moulding(
            model,
            STONE,
            finish.trim_colour,
            half,
            GROUND - 0.35,
            &[
                (0.0, -0.05),
                (0.14, 0.06),
                (0.14, 0.22),
                (0.26, 0.32),
                (0.26, 0.42),
                (0.0, 0.50),
            ],
        );
    }
    for (side, (face, length)) in Frame::around(half, foot).into_iter().enumerate() {
        let bays = (length / BAY).round() as usize;
        for storey in 0..tier.2 {
            let bottom = ground + storey as f64 * STOREY;
            for bay in 0..bays {
                let left = bay as f64 * BAY;
                let cell = Rectangle {
                    left,
                    bottom,
                    right: left + BAY,
                    top: bottom + STOREY,
                };
                if style == Style::Curtain {
                    curtain(model, &face, cell, [0.30, 0.31, 0.32], random);
                    continue;
                }
                let opens = style == Style::Balconies && side % 2 == 0 && bay % 3 == 1;
                let sill = if opens { 0.15 } else { 0.95 };
                let wide = if opens { 0.35 } else { 0.62 };
                let opening = Rectangle {
                    left: left + wide,
                    bottom: bottom + sill,
                    right: left + BAY - wide,
                    top: bottom + STOREY - 0.62,
                };
                window(model, finish, &face, cell, opening, random);
                if opens {
                    balcony(
                        model,
                        finish,
                        &face,
                        left - 0.3,
                        left + BAY + 0.3,
                        bottom + 0.02,
                    );
                }
            }
        }
    }
    let roof = foot + ground + tier.2 as f64 * STOREY;
    if style != Style::Curtain {
        dentils(model, finish, half, roof - 0.42);
        // A string course every fourth storey.
        for storey in (4..tier.2).step_by(4) {
            let y = foot + ground + storey as f64 * STOREY;
            moulding(
                model,
                STONE,
                finish.trim_colour,
                half,
                y - 0.14,
                &[(0.0, 0.0), (0.10, 0.05), (0.10, 0.22), (0.0, 0.28)],
            );
        }
    }
    cornice(model, finish, half, roof);
    roof + 0.25
}

/// The top of a tier: cornice, parapet and the flat roof behind it.
fn cornice(model: &mut Model, finish: &Finish, half: [f64; 2], roof: f64) {
    let profile = [
        (0.0, -0.25),
        (0.12, -0.12),
        (0.16, 0.0),
        (0.42, 0.12),
        (0.46, 0.30),
        (0.40, 0.36),
        (0.06, 0.46),
        (0.06, 1.02),
        (0.12, 1.06),
        (0.12, 1.16),
        (-0.28, 1.16),
        (-0.28, 0.25),
    ];
    moulding(model, STONE, finish.trim_colour, half, roof, &profile);
    let [x, z] = half.map(|h| h - 0.28);
    let y = roof + 0.25;
    let corner = |sx: f64, sz: f64| DVec3::new(sx * x, y, sz * z);
    model.part(STONE, [0.20, 0.20, 0.20]).flat(&[
        corner(-1.0, 1.0),
        corner(1.0, 1.0),
        corner(1.0, -1.0),
        corner(-1.0, -1.0),
    ]);
}

/// Small blocks in a row under the cornice.
fn dentils(model: &mut Model, finish: &Finish, half: [f64; 2], y: f64) {
    let surface = model.part(STONE, finish.trim_colour);
    for (face, length) in Frame::around(half, y) {
        let count = (length / 0.58).floor() as usize;
        for index in 0..count {
            let middle = length * (index as f64 + 0.5) / count as f64;
            surface.cuboid(
                &face,
                [middle - 0.13, 0.0, -0.01],
                [middle + 0.13, 0.26, 0.20],
                16,
            );
        }
    }
}

/// Wide shop windows between pilasters, with doors in the middle and awnings.
fn shopfronts(model: &mut Model, finish: &Finish, half: [f64; 2], tier: Tier, random: &mut Random) {
    let stone = Finish {
        wall: STONE,
        wall_colour: finish.trim_colour.map(|c| c * 0.82),
        ..*finish
    };
    for (side, (face, _)) in Frame::around(half, 0.0).into_iter().enumerate() {
        let bays = if side % 2 == 0 { tier.0 } else { tier.1 };
        for bay in 0..bays {
            let left = bay as f64 * BAY;
            let cell = Rectangle {
                left,
                bottom: 0.0,
                right: left + BAY,
                top: GROUND,
            };
            let opening = |margin: f64, bottom: f64, top: f64| Rectangle {
                left: left + margin,
                bottom,
                right: left + BAY - margin,
                top,
            };
            if bay == bays / 2 {
                door(
                    model,
                    &stone,
                    &face,
                    cell,
                    opening(0.75, 0.0, 2.9),
                    [0.07, 0.10, 0.09],
                );
            } else {
                window(
                    model,
                    &stone,
                    &face,
                    cell,
                    opening(0.40, 0.75, 3.35),
                    random,
                );
                if random.below(2) == 0 {
                    awning(model, &face, left + 0.2, left + BAY - 0.2, random);
                }
            }
            let pilaster = model.part(STONE, finish.trim_colour);
            pilaster.bevelled(
                &face,
                [left - 0.16, 0.0, -0.05],
                [left + 0.16, 0.55, 0.16],
                0.03,
            );
            pilaster.bevelled(
                &face,
                [left - 0.12, 0.5, -0.05],
                [left + 0.12, 4.15, 0.11],
                0.025,
            );
        }
    }
}

/// A striped cloth over a shop window, with its hem.
fn awning(model: &mut Model, face: &Frame, left: f64, right: f64, random: &mut Random) {
    let colour = [
        [0.42, 0.06, 0.05],
        [0.06, 0.22, 0.12],
        [0.07, 0.13, 0.30],
        [0.55, 0.40, 0.10],
    ][random.below(4)];
    let stripes = 8;
    for stripe in 0..stripes {
        let at = |index: usize| left + (right - left) * index as f64 / f64::from(stripes);
        let tone = if stripe % 2 == 0 {
            colour
        } else {
            [0.70, 0.68, 0.62]
        };
        let cloth = model.part(STONE, tone);
        let (a, b) = (at(stripe as usize), at(stripe as usize + 1));
        let points = [(3.55, 0.12), (3.30, 0.60), (2.95, 1.05), (2.70, 1.05)];
        for pair in points.windows(2) {
            let mut cloth_quad = [
                face.at(a, pair[1].0, pair[1].1),
                face.at(b, pair[1].0, pair[1].1),
                face.at(b, pair[0].0, pair[0].1),
                face.at(a, pair[0].0, pair[0].1),
            ];
            cloth.flat(&cloth_quad);
            cloth_quad.reverse();
            cloth.flat(&cloth_quad.map(|p| p - face.up * 0.02 - face.out * 0.02));
        }
    }
}
