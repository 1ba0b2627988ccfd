//! Street lamps and benches.

use glam::DVec3;

use super::palette::{BARK, GLASS, METAL};
use crate::samples::number::turn;
use crate::samples::surface::{Frame, Model};

/// Street lamp `kind`: a curved arm over +z, or a lantern.
pub(super) fn lamp(kind: usize) -> Model {
    let mut model = Model::new(format!("lamp {kind}"), false, true);
    let iron = [0.035, 0.05, 0.045];
    let world = Frame::world();
    let foot = [
        (0.0, 0.0),
        (0.22, 0.0),
        (0.22, 0.14),
        (0.17, 0.22),
        (0.15, 0.62),
        (0.11, 0.74),
        (0.14, 0.80),
        (0.08, 0.92),
    ];
    model.part(METAL, iron).lathe(&world, &foot, 20);
    if kind.is_multiple_of(2) {
        let pole = [(0.08, 0.9), (0.075, 3.0), (0.055, 5.6)];
        model.part(METAL, iron).lathe(&world, &pole, 20);
        let arm = [
            (5.5, 0.0),
            (6.1, 0.12),
            (6.5, 0.55),
            (6.62, 1.15),
            (6.6, 1.7),
        ];
        let path: Vec<(DVec3, f64)> = arm
            .iter()
            .map(|&(y, z)| (DVec3::new(0.0, y, z), 0.05))
            .collect();
        model.part(METAL, iron).tube(&path, 14);
        let head = Frame {
            origin: DVec3::new(0.0, 6.56, 1.85),
            ..world
        };
        model.part(METAL, iron).lathe(
            &head,
            &[
                (0.30, -0.05),
                (0.30, -0.02),
                (0.20, 0.05),
                (0.10, 0.12),
                (0.0, 0.14),
            ],
            28,
        );
        model.part(GLASS, [0.92, 0.88, 0.74]).lathe(
            &head,
            &[(0.0, -0.15), (0.14, -0.13), (0.25, -0.05)],
            28,
        );
    } else {
        let pole = [
            (0.08, 0.9),
            (0.06, 2.4),
            (0.10, 2.46),
            (0.10, 2.54),
            (0.055, 2.6),
            (0.05, 3.4),
            (0.13, 3.5),
            (0.20, 3.62),
        ];
        model.part(METAL, iron).lathe(&world, &pole, 20);
        model.part(GLASS, [0.92, 0.88, 0.74]).lathe(
            &world,
            &[(0.19, 3.62), (0.29, 4.12), (0.0, 4.13)],
            6,
        );
        model.part(METAL, iron).lathe(
            &world,
            &[
                (0.33, 4.10),
                (0.33, 4.15),
                (0.20, 4.34),
                (0.10, 4.40),
                (0.05, 4.52),
                (0.07, 4.58),
                (0.0, 4.66),
            ],
            24,
        );
        for bar in 0..6 {
            let (x, z) = turn(f64::from(bar) / 6.0);
            let path = [
                (DVec3::new(x * 0.195, 3.6, z * 0.195), 0.014),
                (DVec3::new(x * 0.295, 4.12, z * 0.295), 0.014),
            ];
            model.part(METAL, iron).tube(&path, 6);
        }
        model.part(METAL, iron).tube(
            &[
                (DVec3::new(-0.42, 2.5, 0.0), 0.022),
                (DVec3::new(0.42, 2.5, 0.0), 0.022),
            ],
            8,
        );
    }
    model
}

/// A bench of slats on cast-iron sides; it looks along +z.
pub(super) fn bench() -> Model {
    let mut model = Model::new("bench", false, true);
    let world = Frame::world();
    let wood = model.part(BARK, [0.26, 0.13, 0.06]);
    for slat in 0..5 {
        let z = -0.22 + 0.1 * f64::from(slat);
        wood.bevelled(&world, [-0.9, 0.43, z], [0.9, 0.465, z + 0.08], 0.012);
    }
    for slat in 0..4 {
        let y = 0.54 + 0.1 * f64::from(slat);
        let z = -0.27 - 0.035 * f64::from(slat);
        wood.bevelled(&world, [-0.9, y, z - 0.035], [0.9, y + 0.08, z], 0.012);
    }
    for x in [-0.78, 0.78] {
        let sweep = |points: &[(f64, f64)]| -> Vec<(DVec3, f64)> {
            points
                .iter()
                .map(|&(z, y)| (DVec3::new(x, y, z), 0.028))
                .collect()
        };
        let iron = model.part(METAL, [0.03, 0.035, 0.035]);
        iron.tube(
            &sweep(&[
                (-0.34, 0.0),
                (-0.27, 0.2),
                (-0.25, 0.4),
                (-0.29, 0.6),
                (-0.40, 0.95),
            ]),
            10,
        );
        iron.tube(
            &sweep(&[
                (0.28, 0.0),
                (0.22, 0.2),
                (0.25, 0.38),
                (0.22, 0.42),
                (-0.25, 0.41),
            ]),
            10,
        );
        iron.tube(
            &sweep(&[
                (-0.30, 0.64),
                (-0.05, 0.68),
                (0.2, 0.66),
                (0.26, 0.58),
                (0.23, 0.42),
            ]),
            10,
        );
    }
    model
}
