//! Trees: trunks with branches, crowns of rounded masses or of single leaves.

use glam::DVec3;

use super::palette::{BARK, LEAVES};
use crate::samples::noise::fractal;
use crate::samples::number::{Random, rgb, smoothstep, turn};
use crate::samples::surface::{Model, Surface};

/// Tree `kind` of four (plane, lime, fir, poplar); further kinds grow differently.
pub(super) fn tree(kind: usize, seed: u64) -> Model {
    let mut random = Random::new(seed, 300 + kind as u64);
    let mut model = Model::new(format!("tree {kind}"), false, true);
    match kind % 4 {
        0 => broad(&mut model, &mut random, kind as u32),
        1 => leafy(&mut model, &mut random),
        2 => fir(&mut model, &mut random),
        _ => poplar(&mut model, &mut random, kind as u32),
    }
    model
}

/// Bends a trunk from the ground to `height`; returns its points with radii.
fn trunk(model: &mut Model, random: &mut Random, height: f64, radius: f64) -> Vec<(DVec3, f64)> {
    let lean = DVec3::new(random.between(-0.3, 0.3), 0.0, random.between(-0.3, 0.3));
    let path: Vec<(DVec3, f64)> = (0..=10)
        .map(|step| {
            let t = f64::from(step) / 10.0;
            let flare = 1.0 + 0.9 * (1.0 - smoothstep(0.0, 0.14, t));
            (
                lean * t * t + DVec3::Y * (height * t - 0.1),
                radius * flare * (1.0 - 0.75 * t) + 0.02,
            )
        })
        .collect();
    model.part(BARK, [0.13, 0.095, 0.07]).tube(&path, 12);
    path
}

/// A branch that rises outward from `from` and ends at `to`.
fn branch(model: &mut Model, from: DVec3, to: DVec3, radius: f64) {
    let middle = from.lerp(to, 0.5) + DVec3::Y * 0.12 * from.distance(to);
    let path = [
        (from, radius),
        (from.lerp(middle, 0.6), radius * 0.8),
        (middle, radius * 0.6),
        (to, 0.015),
    ];
    model.part(BARK, [0.13, 0.095, 0.07]).tube(&path, 7);
}

/// A rounded mass of foliage: a lat-long ball roughened by noise, dark below.
fn mass(surface: &mut Surface, middle: DVec3, size: DVec3, seed: u32, tint: [f64; 3]) {
    let (rows, columns) = (15, 24);
    let ball: Vec<Vec<DVec3>> = (0..=rows)
        .map(|row| {
            let (down, ring) = turn(0.5 * f64::from(row) / f64::from(rows));
            (0..columns)
                .map(|column| {
                    let (x, z) = turn(f64::from(column) / f64::from(columns));
                    let direction = DVec3::new(ring * x, -down, -ring * z);
                    let bump = 1.0
                        + 0.34 * fractal(direction * 2.1 + middle, seed, 3)
                        + 0.22 * fractal(direction * 6.5 + middle, seed + 1, 2);
                    middle + direction * size * bump
                })
                .collect()
        })
        .collect();
    let first = surface.positions.len();
    surface.sheet(&ball, true);
    for index in first..surface.positions.len() {
        let at = DVec3::from(surface.positions[index].map(f64::from));
        let lit = 0.55 + 0.45 * smoothstep(-1.0, 1.0, (at.y - middle.y) / size.y);
        let speckle = 1.0 + 0.35 * fractal(at * 3.0, seed + 2, 2);
        surface.colours[index] = rgb(tint.map(|c| c * lit * speckle));
    }
}

fn broad(model: &mut Model, random: &mut Random, seed: u32) {
    let path = trunk(model, random, 4.6, 0.28);
    let fork = path[8].0;
    let tint = [0.115, 0.20, 0.045];
    let lobes = 6;
    for lobe in 0..lobes {
        let (x, z) = turn(f64::from(lobe) / f64::from(lobes) + random.between(0.0, 0.08));
        let out = random.between(1.35, 1.85);
        let middle = DVec3::new(x * out, random.between(4.7, 6.0), z * out);
        branch(model, fork, middle, 0.11);
        let width = random.between(1.3, 1.75);
        let tone = random.between(0.85, 1.15);
        mass(
            model.part(LEAVES, tint),
            middle,
            DVec3::new(width, width * 0.85, width),
            seed * 10 + lobe,
            tint.map(|c| c * tone),
        );
    }
    mass(
        model.part(LEAVES, tint),
        DVec3::new(0.1, 6.7, 0.0),
        DVec3::new(1.9, 1.6, 1.9),
        seed * 10 + 9,
        tint.map(|c| c * 1.1),
    );
}

fn poplar(model: &mut Model, random: &mut Random, seed: u32) {
    trunk(model, random, 6.5, 0.22);
    let tint = [0.10, 0.17, 0.035];
    for lobe in 0..7u32 {
        let t = f64::from(lobe) / 6.0;
        let (x, z) = turn(f64::from(lobe) * 0.38);
        let width = 0.75 + 0.75 * (t * (1.0 - t)) * 2.4;
        let middle = DVec3::new(x * 0.25, 2.3 + 6.6 * t, z * 0.25);
        let tone = random.between(0.9, 1.15);
        mass(
            model.part(LEAVES, tint),
            middle,
            DVec3::new(width, width * 1.25, width),
            seed * 10 + lobe,
            tint.map(|c| c * tone),
        );
    }
}

/// A leaf of two triangles, folded along its rib, that shades like the crown it belongs to.
fn leaf(surface: &mut Surface, stem: DVec3, along: DVec3, side: DVec3, crown_normal: DVec3) {
    let fold = along.cross(side) * 0.22;
    let points = [
        stem,
        stem + along * 0.5 + side * 0.36 + fold,
        stem + along,
        stem + along * 0.5 - side * 0.36 + fold,
    ];
    let corners = points.map(|point| surface.vertex(point, crown_normal, crown_normal));
    surface.triangle(corners[0], corners[1], corners[2]);
    surface.triangle(corners[0], corners[2], corners[3]);
}

fn direction(random: &mut Random) -> DVec3 {
    let y = random.between(-1.0, 1.0);
    let (x, z) = turn(random.unit());
    let ring = (1.0 - y * y).sqrt();
    DVec3::new(ring * x, y, ring * z)
}

/// Leaves spread through a shell of an ellipsoid.
fn leafy(model: &mut Model, random: &mut Random) {
    let path = trunk(model, random, 5.2, 0.24);
    let (middle, size) = (DVec3::new(0.0, 5.3, 0.0), DVec3::new(2.4, 2.7, 2.4));
    for limb in 0..12 {
        let (x, z) = turn(f64::from(limb) / 12.0 + random.between(0.0, 0.05));
        let reach = random.between(0.6, 0.85);
        let up = random.between(-0.5, 0.7);
        let to = middle + DVec3::new(x * reach, up, z * reach) * size;
        branch(model, path[5 + limb as usize % 5].0, to, 0.08);
    }
    let surface = model.part(LEAVES, [0.10, 0.18, 0.04]);
    for _ in 0..2300 {
        let out = direction(random);
        // More leaves toward the outside.
        let depth = 1.0 - 0.55 * random.unit() * random.unit();
        let ripple = 1.0 + 0.22 * fractal(out * 2.4, 17, 2);
        let stem = middle + out * size * depth * ripple;
        let along = (direction(random) + DVec3::NEG_Y * 0.5 + out * 0.6).normalize_or(DVec3::X)
            * random.between(0.30, 0.48);
        let side = along.cross(direction(random)).normalize_or(DVec3::Z) * along.length();
        let lit = (0.45 + 0.65 * depth * depth) * random.between(0.7, 1.25) * (0.8 + 0.25 * out.y);
        surface.pen = rgb([0.125 * lit, 0.215 * lit, 0.04 * lit]);
        leaf(
            surface,
            stem,
            along,
            side,
            (out + DVec3::Y * 0.25).normalize_or(DVec3::Y),
        );
    }
}

/// Drooping whorls of needled twigs.
fn fir(model: &mut Model, random: &mut Random) {
    trunk(model, random, 8.2, 0.2);
    for whorl in 0..20 {
        let t = f64::from(whorl) / 19.0;
        let (height, reach) = (1.0 + 7.3 * t, 2.0 * (1.0 - t) + 0.22);
        let twigs = 12 - whorl / 3;
        for twig in 0..twigs {
            let (x, z) = turn(
                (f64::from(twig) + 0.4 * f64::from(whorl) + random.between(-0.15, 0.15))
                    / f64::from(twigs),
            );
            let outward = DVec3::new(x, 0.0, z);
            let length = reach * random.between(0.85, 1.1);
            let tip = DVec3::new(0.0, height - 0.42 * length, 0.0) + outward * length;
            let base = DVec3::new(0.0, height, 0.0);
            let surface = model.part(LEAVES, [0.0; 3]);
            for needle in 0..12 {
                let s = (f64::from(needle) + 0.5) / 12.0;
                let stem = base.lerp(tip, 0.12 + 0.85 * s) + DVec3::Y * 0.05;
                let hand = if needle % 2 == 0 { 1.0 } else { -1.0 };
                let across = DVec3::Y.cross(outward) * hand;
                let along = (outward * 0.7
                    + across * (1.0 - 0.6 * s)
                    + DVec3::Y * random.between(-0.25, 0.15))
                .normalize_or(outward)
                    * (0.60 * (1.05 - 0.45 * s) + 0.14)
                    * (0.50 + 0.5 * reach / 2.1);
                let lit = random.between(0.75, 1.2) * (0.6 + 0.5 * s);
                surface.pen = rgb([0.05 * lit, 0.115 * lit, 0.045 * lit]);
                leaf(
                    surface,
                    stem,
                    along,
                    DVec3::Y.cross(along) * 0.95,
                    (outward * 0.7 + DVec3::Y * 0.7).normalize_or(DVec3::Y),
                );
            }
        }
    }
}
