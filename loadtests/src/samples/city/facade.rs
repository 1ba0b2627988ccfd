//! Pieces of a wall: windows, curtain wall, doors, mouldings, balconies.

use glam::DVec3;

use super::palette::{GLASS, METAL};
use crate::samples::number::Random;
use crate::samples::surface::{Frame, Model};

/// Materials and colours of a facade.
#[derive(Clone, Copy)]
pub(super) struct Finish {
    pub(super) wall: usize,
    pub(super) wall_colour: [f64; 3],
    pub(super) trim: usize,
    pub(super) trim_colour: [f64; 3],
}

/// A rectangle on a facade, metres right of and above the frame's origin.
#[derive(Clone, Copy)]
pub(super) struct Rectangle {
    pub(super) left: f64,
    pub(super) bottom: f64,
    pub(super) right: f64,
    pub(super) top: f64,
}

impl Rectangle {
    pub(super) fn inset(self, by: f64) -> Self {
        Self {
            left: self.left + by,
            bottom: self.bottom + by,
            right: self.right - by,
            top: self.top - by,
        }
    }

    fn corners(self, frame: &Frame, out: f64) -> [DVec3; 4] {
        [
            frame.at(self.left, self.bottom, out),
            frame.at(self.right, self.bottom, out),
            frame.at(self.right, self.top, out),
            frame.at(self.left, self.top, out),
        ]
    }
}

/// The band between two rectangles, each with its distance out of the wall; corners meet, so nothing cracks.
fn band(
    model: &mut Model,
    material: usize,
    colour: [f64; 3],
    frame: &Frame,
    outer: (Rectangle, f64),
    inner: (Rectangle, f64),
) {
    let surface = model.part(material, colour);
    let (a, b) = (
        outer.0.corners(frame, outer.1),
        inner.0.corners(frame, inner.1),
    );
    for side in 0..4 {
        let next = (side + 1) % 4;
        surface.flat(&[a[side], a[next], b[next], b[side]]);
    }
}

/// A pane: dark, some with a curtain, some lit.
fn pane(model: &mut Model, frame: &Frame, opening: Rectangle, out: f64, random: &mut Random) {
    let shade = random.between(0.7, 1.3);
    let colour = match random.below(10) {
        0 => [0.42, 0.34, 0.20],
        1 | 2 => [0.26, 0.27, 0.27],
        _ => [0.045 * shade, 0.075 * shade, 0.10 * shade],
    };
    model.part(GLASS, colour).flat(&opening.corners(frame, out));
}

/// A framed window in the cell of a wall: reveal, bevelled frame, mullions, sill.
pub(super) fn window(
    model: &mut Model,
    finish: &Finish,
    frame: &Frame,
    cell: Rectangle,
    opening: Rectangle,
    random: &mut Random,
) {
    let (trim, colour) = (finish.trim, finish.trim_colour);
    let outline = opening.inset(-0.13);
    let steps = [
        (outline, 0.0),
        (opening.inset(-0.10), 0.07),
        (opening, 0.05),
        (opening, -0.22),
    ];
    band(
        model,
        finish.wall,
        finish.wall_colour,
        frame,
        (cell, 0.0),
        steps[0],
    );
    for step in steps.windows(2) {
        band(model, trim, colour, frame, step[0], step[1]);
    }
    pane(model, frame, opening, -0.22, random);
    let (width, height) = (opening.right - opening.left, opening.top - opening.bottom);
    let middle = opening.left + width / 2.0;
    let rail = opening.bottom + height * 0.62;
    let surface = model.part(trim, colour.map(|c| c * 0.9));
    surface.cuboid(
        frame,
        [middle - 0.035, opening.bottom, -0.22],
        [middle + 0.035, opening.top, -0.14],
        4 | 8 | 16,
    );
    surface.cuboid(
        frame,
        [opening.left, rail - 0.035, -0.22],
        [opening.right, rail + 0.035, -0.15],
        1 | 2 | 16,
    );
    let surface = model.part(trim, colour);
    surface.cuboid(
        frame,
        [outline.left - 0.06, outline.bottom - 0.10, -0.02],
        [outline.right + 0.06, outline.bottom, 0.20],
        16,
    );
}

/// A cell of curtain wall: mullions in front, a pane above a spandrel.
pub(super) fn curtain(
    model: &mut Model,
    frame: &Frame,
    cell: Rectangle,
    mullion: [f64; 3],
    random: &mut Random,
) {
    let split = cell.bottom + 0.9;
    let spandrel = Rectangle { top: split, ..cell };
    let vision = Rectangle {
        bottom: split,
        ..cell
    };
    for (part, is_glass) in [(spandrel, false), (vision, true)] {
        let face = part.inset(0.05);
        band(model, METAL, mullion, frame, (part, 0.12), (face, 0.12));
        band(
            model,
            METAL,
            mullion,
            frame,
            (face, 0.12),
            (part.inset(0.07), 0.0),
        );
        let inner = part.inset(0.07);
        if is_glass {
            let shade = random.between(0.75, 1.35);
            let colour = if random.below(14) == 0 {
                [0.40, 0.36, 0.26]
            } else {
                [0.06 * shade, 0.12 * shade, 0.15 * shade]
            };
            model.part(GLASS, colour).flat(&inner.corners(frame, 0.0));
        } else {
            model
                .part(GLASS, [0.035, 0.06, 0.075])
                .flat(&inner.corners(frame, 0.0));
        }
    }
}

/// A doorway with a panelled door and a step.
pub(super) fn door(
    model: &mut Model,
    finish: &Finish,
    frame: &Frame,
    cell: Rectangle,
    opening: Rectangle,
    colour: [f64; 3],
) {
    let steps = [
        (opening.inset(-0.16), 0.0),
        (opening.inset(-0.12), 0.10),
        (opening, 0.08),
        (opening, -0.18),
    ];
    let floor = |(r, out): (Rectangle, f64)| {
        (
            Rectangle {
                bottom: opening.bottom,
                ..r
            },
            out,
        )
    };
    let steps = steps.map(floor);
    band(
        model,
        finish.wall,
        finish.wall_colour,
        frame,
        (cell, 0.0),
        steps[0],
    );
    for step in steps.windows(2) {
        band(
            model,
            finish.trim,
            finish.trim_colour,
            frame,
            step[0],
            step[1],
        );
    }
    let panel = model.part(METAL, colour);
    panel.flat(&opening.corners(frame, -0.18));
    let (width, height) = (opening.right - opening.left, opening.top - opening.bottom);
    for (x, y) in [(0.08, 0.06), (0.54, 0.06), (0.08, 0.42), (0.54, 0.42)] {
        let (left, bottom) = (opening.left + width * x, opening.bottom + height * y);
        let tall = if y < 0.2 { 0.30 } else { 0.48 };
        panel.bevelled(
            frame,
            [left, bottom, -0.19],
            [left + width * 0.38, bottom + height * tall, -0.13],
            0.03,
        );
    }
    let knob = Frame {
        origin: frame.at(opening.right - 0.12, opening.bottom + 1.0, -0.18),
        up: frame.out,
        out: -frame.up,
        ..*frame
    };
    model.part(METAL, [0.55, 0.42, 0.15]).lathe(
        &knob,
        &[
            (0.02, 0.0),
            (0.02, 0.05),
            (0.045, 0.07),
            (0.045, 0.10),
            (0.0, 0.12),
        ],
        10,
    );
}

/// A profile of (out, up) run around a box of half sizes `half` at height `y`, mitred at the corners.
pub(super) fn moulding(
    model: &mut Model,
    material: usize,
    colour: [f64; 3],
    half: [f64; 2],
    y: f64,
    profile: &[(f64, f64)],
) {
    let surface = model.part(material, colour);
    let corner = |side: usize, (out, up): (f64, f64)| {
        let (x, z) = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)][side % 4];
        DVec3::new(x * (half[0] + out), y + up, z * (half[1] + out))
    };
    for pair in profile.windows(2) {
        for side in 0..4 {
            surface.flat(&[
                corner(side, pair[0]),
                corner(side + 1, pair[0]),
                corner(side + 1, pair[1]),
                corner(side, pair[1]),
            ]);
        }
    }
}

/// A balcony on brackets: slab, posts, rail.
pub(super) fn balcony(
    model: &mut Model,
    finish: &Finish,
    frame: &Frame,
    left: f64,
    right: f64,
    floor: f64,
) {
    let slab = model.part(finish.trim, finish.trim_colour);
    slab.bevelled(
        frame,
        [left, floor - 0.18, -0.02],
        [right, floor, 1.25],
        0.03,
    );
    for x in [left + 0.15, right - 0.35] {
        slab.bevelled(
            frame,
            [x, floor - 0.55, -0.02],
            [x + 0.2, floor - 0.16, 0.55],
            0.05,
        );
    }
    let iron = model.part(METAL, [0.06, 0.065, 0.07]);
    let posts = ((right - left) / 0.42).round().max(2.0) as usize;
    for post in 0..=posts {
        let x = left + 0.05 + (right - left - 0.1) * post as f64 / posts as f64;
        iron.cuboid(
            frame,
            [x - 0.018, floor, 1.17],
            [x + 0.018, floor + 0.95, 1.205],
            4 | 8,
        );
    }
    for side in [left + 0.03, right - 0.07] {
        for step in 0..3 {
            let z = 0.1 + 0.38 * f64::from(step);
            iron.cuboid(
                frame,
                [side, floor, z],
                [side + 0.035, floor + 0.95, z + 0.035],
                4 | 8,
            );
        }
        iron.bevelled(
            frame,
            [side - 0.02, floor + 0.94, 0.0],
            [side + 0.055, floor + 1.0, 1.22],
            0.012,
        );
    }
    iron.bevelled(
        frame,
        [left, floor + 0.94, 1.15],
        [right, floor + 1.0, 1.23],
        0.012,
    );
}
