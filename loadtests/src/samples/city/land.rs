//! The country round the city, and the monument in its middle.

use glam::DVec3;

use super::palette::{GRASS, METAL, ROCK};
use crate::samples::noise::fractal;
use crate::samples::number::{lerp, rgb, smoothstep, turn};
use crate::samples::rock::sculpt;
use crate::samples::surface::{Frame, Model};

/// Hills around a plain of `city_metres` radius; the plain lies just below the streets.
pub(super) fn hills(city_metres: f64, seed: u64) -> Model {
    let (rings, sectors) = (44, 128);
    let seed = (seed ^ seed >> 32) as u32;
    let mut model = Model::new("hills", true, true);
    let surface = model.part(GRASS, [1.0; 3]);
    surface.tile_metres = 24.0;
    // Rings from the far rim inward, so that rows run upward as seen from above.
    let rows: Vec<Vec<DVec3>> = (0..=rings)
        .map(|ring| {
            let t = 1.0 - f64::from(ring) / f64::from(rings);
            let radius = city_metres * 3.6 * t * (0.45 + 0.55 * t);
            (0..sectors)
                .map(|sector| {
                    let (x, z) = turn(f64::from(sector) / f64::from(sectors));
                    let at = DVec3::new(radius * x, 0.0, -radius * z);
                    let rise = smoothstep(city_metres * 1.05, city_metres * 2.6, radius);
                    let scale = 2.2 / city_metres;
                    let hill = 0.62 + fractal(at * scale, seed, 5);
                    DVec3::new(at.x, -0.4 + rise * hill * city_metres * 0.30, at.z)
                })
                .collect()
        })
        .collect();
    surface.sheet(&rows, true);
    for index in 0..surface.positions.len() {
        let at = DVec3::from(surface.positions[index].map(f64::from));
        let field = fractal(at * (9.0 / city_metres), seed.wrapping_add(3), 4);
        let wood = smoothstep(0.02, 0.16, field + at.y / city_metres * 0.5);
        let meadow = [0.135, 0.185, 0.05];
        let forest = [0.045, 0.085, 0.028];
        let tone = 1.0 + 0.35 * fractal(at * (34.0 / city_metres), seed.wrapping_add(4), 3);
        surface.colours[index] = rgb(std::array::from_fn(|c| {
            lerp(meadow[c], forest[c], wood) * tone
        }));
    }
    model
}

/// A stone of `triangles` triangles on a stepped base with a bronze plate.
pub(super) fn monument(triangles: u32, seed: u64) -> Model {
    let mut model = Model::new("monument", false, true);
    let world = Frame::world();
    let granite = model.part(ROCK, [0.32, 0.31, 0.31]);
    let mut low = 0.0;
    for (half, height) in [
        (7.6, 0.32),
        (6.9, 0.32),
        (6.2, 0.32),
        (5.2, 1.5),
        (5.5, 0.4),
    ] {
        granite.bevelled(
            &world,
            [-half, low, -half],
            [half, low + height, half],
            0.08,
        );
        low += height;
    }
    for (face, length) in Frame::around([5.2; 2], 0.96) {
        let bronze = model.part(METAL, [0.30, 0.19, 0.07]);
        let middle = length / 2.0;
        bronze.bevelled(
            &face,
            [middle - 1.6, 0.3, -0.02],
            [middle + 1.6, 1.25, 0.06],
            0.03,
        );
        for line in 0..4 {
            let up = 1.05 - 0.2 * f64::from(line);
            for letter in 0..14 {
                // Marks of uneven length read as words from a step away.
                let left = middle - 1.42 + 0.2 * f64::from(letter);
                let long = 0.10 + 0.06 * f64::from((letter * 7 + line * 3) % 3) / 2.0;
                bronze.cuboid(
                    &face,
                    [left, up - 0.05, 0.05],
                    [left + long, up + 0.05, 0.075],
                    16,
                );
            }
        }
    }
    let mut stone = sculpt(triangles, seed, 4.9);
    for position in &mut stone.positions {
        // The rock sinks a little into its base.
        position[1] = crate::samples::number::grid(f64::from(position[1]) + low + 4.3) as f32;
    }
    model.parts.push((ROCK, stone));
    model
}
