//! What stands on a tower's roof: plant, a water tank, or a spire.

use glam::DVec3;

use super::palette::{GLASS, METAL, STONE};
use crate::samples::number::{Random, turn};
use crate::samples::surface::{Frame, Model};

/// The largest thing on a roof.
#[derive(Clone, Copy)]
pub(super) enum Crown {
    WaterTank,
    Plant,
    Spire,
}

/// What stands on the roof at `y`.
pub(super) fn top(model: &mut Model, crown: Crown, half: [f64; 2], y: f64, random: &mut Random) {
    let frame = Frame {
        origin: DVec3::new(0.0, y, 0.0),
        ..Frame::world()
    };
    for unit in 0..4 {
        let (x, z) = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)][unit];
        let (x, z) = (
            x * half[0] * random.between(0.45, 0.6),
            z * half[1] * random.between(0.45, 0.6),
        );
        let metal = model.part(METAL, [0.42, 0.43, 0.44]);
        metal.bevelled(
            &frame,
            [x - 0.8, 0.0, z - 0.6],
            [x + 0.8, random.between(0.9, 1.5), z + 0.6],
            0.06,
        );
        let fan = Frame {
            origin: DVec3::new(x, y + 0.85, z),
            ..frame
        };
        model.part(METAL, [0.16; 3]).lathe(
            &fan,
            &[(0.45, 0.0), (0.45, 0.85), (0.38, 0.9), (0.0, 0.8)],
            20,
        );
    }
    match crown {
        Crown::WaterTank => {
            let legs = model.part(METAL, [0.10; 3]);
            for leg in 0..4 {
                let (x, z) = turn(0.125 + f64::from(leg) * 0.25);
                legs.tube(
                    &[
                        (DVec3::new(x * 1.7, y, z * 1.7), 0.09),
                        (DVec3::new(x * 1.35, y + 3.2, z * 1.35), 0.09),
                    ],
                    8,
                );
            }
            let tank = model.part(METAL, [0.24, 0.15, 0.09]);
            tank.lathe(
                &frame,
                &[
                    (0.0, 3.1),
                    (1.65, 3.1),
                    (1.72, 3.3),
                    (1.72, 5.9),
                    (1.9, 5.9),
                    (1.9, 6.05),
                    (0.9, 6.7),
                    (0.0, 7.1),
                ],
                40,
            );
            for hoop in 0..6 {
                let up = 3.45 + 0.42 * f64::from(hoop);
                tank.lathe(
                    &frame,
                    &[
                        (1.72, up),
                        (1.77, up + 0.02),
                        (1.77, up + 0.08),
                        (1.72, up + 0.10),
                    ],
                    40,
                );
            }
        }
        Crown::Plant => {
            model.part(STONE, [0.36, 0.36, 0.35]).bevelled(
                &frame,
                [-2.6, 0.0, -2.2],
                [2.6, 3.2, 2.2],
                0.08,
            );
            let grille = model.part(METAL, [0.20; 3]);
            for slat in 0..14 {
                let up = 0.7 + 0.16 * f64::from(slat);
                grille.bevelled(&frame, [-2.2, up, 2.15], [2.2, up + 0.09, 2.3], 0.02);
            }
        }
        Crown::Spire => {
            model.part(STONE, [0.52, 0.49, 0.44]).bevelled(
                &frame,
                [-2.7, 0.0, -2.7],
                [2.7, 2.6, 2.7],
                0.25,
            );
            model.part(STONE, [0.52, 0.49, 0.44]).bevelled(
                &frame,
                [-1.9, 2.4, -1.9],
                [1.9, 5.0, 1.9],
                0.25,
            );
            let copper = model.part(METAL, [0.16, 0.36, 0.29]);
            copper.lathe(
                &frame,
                &[
                    (1.75, 4.9),
                    (1.85, 5.1),
                    (1.5, 5.9),
                    (0.95, 7.4),
                    (0.55, 9.6),
                    (0.28, 12.5),
                    (0.12, 15.5),
                    (0.05, 19.0),
                    (0.0, 19.1),
                ],
                28,
            );
            model.part(GLASS, [0.5, 0.1, 0.06]).lathe(
                &frame,
                &[(0.0, 19.0), (0.16, 19.15), (0.16, 19.35), (0.0, 19.5)],
                12,
            );
        }
    }
}
