//! The inputs that builders are measured on, of any size: two smooth closed surfaces and three that are hard to simplify.
//!
//! The same name gives the same bits on every machine. All have normals and texture coordinates.

use std::collections::HashMap;
use std::fmt;
use std::str::FromStr;

use glam::{DVec2, DVec3};
use lodestream_server::import::Mesh;
use rayon::prelude::*;

use crate::samples::noise::fractal;
use crate::samples::number::{Random, turn};

/// Octaves of the displacement: detail at every scale down to the triangles of four million.
const OCTAVES: u32 = 9;
/// Height of the displacement over the octaves' range, metres.
const DISPLACEMENT_METRES: f64 = 0.3;
/// Radii of the torus, metres.
const TORUS_METRES: (f64, f64) = (1.0, 0.45);
/// Quads along a side of a texture chart of [`Shape::Charts`].
const CHART_QUADS: u32 = 8;
const LEAF_TRIANGLES: u64 = 8;
const LEAF_METRES: f64 = 0.1;

/// A kind of surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// A displaced torus, closed; one texture seam each way.
    Torus,
    /// A displaced cube sphere, closed; six texture charts.
    Sphere,
    /// The torus with a texture chart every 8 x 8 quads, closed.
    Charts,
    /// The torus with flat normals, no vertex shared; closed.
    Facet,
    /// Loose leaf cards of eight triangles in a crown.
    Foliage,
}

const SHAPES: [(&str, Shape); 5] = [
    ("torus", Shape::Torus),
    ("sphere", Shape::Sphere),
    ("charts", Shape::Charts),
    ("facet", Shape::Facet),
    ("foliage", Shape::Foliage),
];

/// A surface of about so many triangles: `torus:1000000`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Generated {
    /// What it is.
    pub shape: Shape,
    /// Triangles asked for; the nearest that the shape divides into are made.
    pub triangles: u64,
}

impl FromStr for Generated {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = SHAPES.map(|(name, _)| name).join(", ");
        let expected = || format!("expected SHAPE:TRIANGLES with a shape of {names}");
        let (name, triangles) = text.split_once(':').ok_or_else(expected)?;
        let shape = SHAPES.iter().find(|(known, _)| *known == name);
        let triangles: u64 = triangles.parse().map_err(|_| expected())?;
        if !(48..=200_000_000).contains(&triangles) {
            return Err(format!(
                "expected 48 to 200000000 triangles, found {triangles}"
            ));
        }
        Ok(Self {
            shape: shape.ok_or_else(expected)?.1,
            triangles,
        })
    }
}

impl fmt::Display for Generated {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let known = SHAPES.iter().find(|(_, shape)| *shape == self.shape);
        write!(f, "{}:{}", known.map_or("", |it| it.0), self.triangles)
    }
}

impl Generated {
    /// The mesh, one material, object space in metres.
    pub fn mesh(&self) -> Mesh {
        let mut mesh = match self.shape {
            Shape::Torus => torus(self.triangles, u32::MAX),
            Shape::Charts => torus(self.triangles, CHART_QUADS),
            Shape::Facet => unwelded(torus(self.triangles, u32::MAX)),
            Shape::Sphere => sphere(self.triangles),
            Shape::Foliage => foliage(self.triangles),
        };
        mesh.name = self.to_string();
        mesh
    }
}

/// Positions, texture coordinates and triangles as a mesh of one material, with smooth normals.
pub fn mesh(
    name: &str,
    positions: Vec<[f32; 3]>,
    uvs: Option<Vec<[f32; 2]>>,
    triangles: Vec<[u32; 3]>,
) -> Mesh {
    Mesh {
        name: name.into(),
        normals: Some(smooth_normals(&positions, &triangles)),
        positions,
        uvs,
        colors: None,
        triangle_materials: vec![0; triangles.len()],
        triangles,
        material_slots: vec![0],
    }
}

/// Area-weighted normals; vertices at one place share theirs.
fn smooth_normals(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let mut places: HashMap<[u32; 3], u32> = HashMap::with_capacity(positions.len());
    let place_of: Vec<u32> = positions
        .iter()
        .map(|position| {
            let next = places.len() as u32;
            *places.entry(position.map(f32::to_bits)).or_insert(next)
        })
        .collect();
    let at = |vertex: u32| DVec3::from(positions[vertex as usize].map(f64::from));
    let mut sums = vec![DVec3::ZERO; places.len()];
    for &corners in triangles {
        let [a, b, c] = corners.map(at);
        let normal = (b - a).cross(c - a);
        for vertex in corners {
            sums[place_of[vertex as usize] as usize] += normal;
        }
    }
    place_of
        .iter()
        .map(|&place| sums[place as usize].normalize_or(DVec3::Y))
        .map(|normal| normal.as_vec3().to_array())
        .collect()
}

/// Quads `(column, row)` of a torus in square charts of at most `chart_quads` a side, each with vertices of its own.
fn torus(triangles: u64, chart_quads: u32) -> Mesh {
    let rows = ((triangles as f64 / 4.0).sqrt().round() as u32).max(3);
    let columns = ((triangles as f64 / (2.0 * rows as f64)).round() as u32).max(3);
    let places: Vec<DVec3> = (0..columns * rows)
        .into_par_iter()
        .map(|place| {
            let share = |index: u32, count: u32| turn(f64::from(index) / f64::from(count));
            let (along, across) = (
                share(place % columns, columns),
                share(place / columns, rows),
            );
            // Outward at this place; the ring lies in the plane of x and z.
            let outward = DVec3::new(across.0 * along.0, across.1, -across.0 * along.1);
            let ring = DVec3::new(along.0, 0.0, -along.1) * TORUS_METRES.0;
            let even = ring + outward * TORUS_METRES.1;
            even + outward * DISPLACEMENT_METRES * fractal(even * 2.0, 7, OCTAVES)
        })
        .collect();
    let (mut positions, mut uvs, mut corners) = (Vec::new(), Vec::new(), Vec::new());
    let starts = |count: u32| (0..count).step_by(chart_quads.min(count) as usize);
    for top in starts(rows) {
        for left in starts(columns) {
            let width = chart_quads.min(columns - left);
            let height = chart_quads.min(rows - top);
            let first = positions.len() as u32;
            for (y, x) in (0..=height).flat_map(|y| (0..=width).map(move |x| (y, x))) {
                let place = (top + y) % rows * columns + (left + x) % columns;
                positions.push(places[place as usize].as_vec3().to_array());
                // A gap of one quad between charts, so that none touches its neighbour's texels.
                let gap = |start: u32| start / chart_quads.min(columns);
                let uv = DVec2::new(
                    f64::from(left + x + gap(left)) / f64::from(columns + columns / chart_quads),
                    f64::from(top + y + gap(top)) / f64::from(rows + rows / chart_quads),
                );
                uvs.push(uv.as_vec2().to_array());
            }
            quads(&mut corners, first, width, height);
        }
    }
    mesh("torus", positions, Some(uvs), corners)
}

/// Two triangles a quad over `(width + 1) * (height + 1)` vertices from `first` on.
fn quads(triangles: &mut Vec<[u32; 3]>, first: u32, width: u32, height: u32) {
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let a = first + y * (width + 1) + x;
        let [b, c, d] = [a + 1, a + width + 2, a + width + 1];
        triangles.extend([[a, b, c], [a, c, d]]);
    }
}

fn sphere(triangles: u64) -> Mesh {
    let n = ((triangles as f64 / 12.0).sqrt().round() as u32).max(2);
    let (mut positions, mut uvs, mut corners) = (Vec::new(), Vec::new(), Vec::new());
    for face in 0..6u32 {
        let (axis, side) = ((face / 2) as usize, f64::from(face % 2) * 2.0 - 1.0);
        let first = positions.len() as u32;
        let face_vertices = (0..(n + 1) * (n + 1)).into_par_iter().map(|index| {
            let [x, y] = [index % (n + 1), index / (n + 1)];
            let mut cube = [0.0; 3];
            cube[axis] = side;
            cube[(axis + 1) % 3] = (f64::from(2 * x) - f64::from(n)) / f64::from(n);
            // Turned with the side, so that every face is counter-clockwise from outside.
            cube[(axis + 2) % 3] = side * (f64::from(2 * y) - f64::from(n)) / f64::from(n);
            let outward = on_sphere(cube);
            let height = 1.0 + DISPLACEMENT_METRES * fractal(outward * 2.0, 11, OCTAVES);
            let chart = DVec2::new(f64::from(face % 3), f64::from(face / 3));
            let inside = DVec2::new(f64::from(x), f64::from(y)) / f64::from(n);
            let uv = (chart + inside * 0.96 + 0.02) / DVec2::new(3.0, 2.0);
            (
                (outward * height).as_vec3().to_array(),
                uv.as_vec2().to_array(),
            )
        });
        let (face_positions, face_uvs): (Vec<_>, Vec<_>) = face_vertices.unzip();
        positions.extend(face_positions);
        uvs.extend(face_uvs);
        quads(&mut corners, first, n, n);
    }
    mesh("sphere", positions, Some(uvs), corners)
}

/// A point of the cube on the unit sphere, spread evenly; the same bits whichever face asks.
fn on_sphere([x, y, z]: [f64; 3]) -> DVec3 {
    let (x2, y2, z2) = (x * x, y * y, z * z);
    let part = |value: f64, a: f64, b: f64| {
        // Sorted, since the sum's rounding must not depend on the face's order of axes.
        let (a, b) = (a.min(b), a.max(b));
        // Adding zero takes the sign from a negative one.
        value * (1.0 - (a + b) / 2.0 + a * b / 3.0).max(0.0).sqrt() + 0.0
    };
    DVec3::new(part(x, y2, z2), part(y, z2, x2), part(z, x2, y2))
}

/// Three vertices a triangle, with its own normal.
fn unwelded(mesh: Mesh) -> Mesh {
    let corners = mesh.triangles.as_flattened();
    let pick = |values: &[[f32; 3]]| -> Vec<[f32; 3]> {
        corners.iter().map(|&it| values[it as usize]).collect()
    };
    let positions = pick(&mesh.positions);
    let normals = positions
        .as_chunks::<3>()
        .0
        .iter()
        .flat_map(|corners| {
            let [a, b, c] = corners.map(|corner| DVec3::from(corner.map(f64::from)));
            [(b - a)
                .cross(c - a)
                .normalize_or(DVec3::Y)
                .as_vec3()
                .to_array(); 3]
        })
        .collect();
    let uvs = mesh
        .uvs
        .as_ref()
        .map(|uvs| corners.iter().map(|&corner| uvs[corner as usize]).collect());
    let count = mesh.triangles.len() as u32;
    Mesh {
        positions,
        normals: Some(normals),
        uvs,
        triangles: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        ..mesh
    }
}

/// Leaves of two by two bent quads, spread through the shell of a crown.
fn foliage(triangles: u64) -> Mesh {
    let leaves = triangles.div_ceil(LEAF_TRIANGLES);
    // As dense as a tree whatever the number of leaves.
    let crown_metres = 0.12 * (leaves as f64).cbrt();
    let mut random = Random::new(5, 1);
    let (mut positions, mut uvs, mut corners) = (Vec::new(), Vec::new(), Vec::new());
    let mut unit = move || loop {
        let at = DVec3::from([(); 3].map(|()| random.between(-1.0, 1.0)));
        if (0.01..=1.0).contains(&at.length_squared()) {
            return at;
        }
    };
    for _ in 0..leaves {
        let middle = unit() * crown_metres;
        let along = unit().normalize();
        let across = along
            .cross(unit())
            .normalize_or(along.any_orthonormal_vector());
        let up = along.cross(across);
        let first = positions.len() as u32;
        for (y, x) in (0..3).flat_map(|y| (0..3).map(move |x| (y, x))) {
            let (s, t) = (f64::from(x) - 1.0, f64::from(y) - 1.0);
            // Narrow at both ends, folded along the midrib, drooping.
            let width = 0.5 * (1.0 - 0.7 * t * t);
            let bend = 0.2 * s.abs() - 0.15 * t * t;
            let at = middle + (along * t + across * s * width + up * bend) * (0.5 * LEAF_METRES);
            positions.push(at.as_vec3().to_array());
            uvs.push([0.5 + 0.5 * s as f32, 0.5 + 0.5 * t as f32]);
        }
        quads(&mut corners, first, 2, 2);
    }
    mesh("foliage", positions, Some(uvs), corners)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn generated(text: &str) -> Mesh {
        text.parse::<Generated>().unwrap().mesh()
    }

    /// Directed edges between places that no opposite edge meets.
    fn open_edges(mesh: &Mesh) -> usize {
        let mut sums: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
        for corners in &mesh.triangles {
            let places = corners.map(|vertex| mesh.positions[vertex as usize].map(f32::to_bits));
            for side in 0..3 {
                let (from, to) = (places[side], places[(side + 1) % 3]);
                let sign = if from < to { 1 } else { -1 };
                *sums.entry([from.min(to), from.max(to)]).or_default() += sign;
            }
        }
        sums.values().filter(|&&sum| sum != 0).count()
    }

    fn volume(mesh: &Mesh) -> f64 {
        let at = |vertex: u32| DVec3::from(mesh.positions[vertex as usize].map(f64::from));
        let six = mesh.triangles.iter().map(|corners| {
            let [a, b, c] = corners.map(at);
            a.dot(b.cross(c))
        });
        six.sum::<f64>() / 6.0
    }

    #[test]
    fn closed_shapes_are_closed_and_face_outward() {
        for name in ["torus:5000", "sphere:5000", "charts:5000", "facet:5000"] {
            let mesh = generated(name);
            assert_eq!(open_edges(&mesh), 0, "{name}");
            assert!(volume(&mesh) > 1.0, "{name}: {}", volume(&mesh));
            let inverted = mesh
                .triangles
                .iter()
                .filter(|corners| {
                    let [a, b, c] =
                        corners.map(|v| DVec3::from(mesh.positions[v as usize].map(f64::from)));
                    let normals = mesh.normals.as_ref().unwrap();
                    let given = DVec3::from(normals[corners[0] as usize].map(f64::from));
                    (b - a).cross(c - a).dot(given) < 0.0
                })
                .count();
            assert!(inverted * 50 < mesh.triangles.len(), "{name}: {inverted}");
        }
    }

    #[test]
    fn counts_are_those_of_the_anchors() {
        for (name, triangles, vertices) in [
            ("torus:250000", 250_000, 501 * 251),
            ("sphere:248832", 248_832, 6 * 145 * 145),
            ("charts:4096", 4096, 32 * 81),
            ("facet:14400", 14_400, 43_200),
            ("foliage:8000", 8000, 9000),
        ] {
            let mesh = generated(name);
            assert_eq!(mesh.triangles.len(), triangles, "{name}");
            assert_eq!(mesh.positions.len(), vertices, "{name}");
            assert_eq!(mesh.normals.as_ref().map(Vec::len), Some(vertices));
            assert_eq!(mesh.uvs.as_ref().map(Vec::len), Some(vertices));
            assert_eq!(mesh, generated(name), "not the same twice");
            let uvs = mesh.uvs.unwrap();
            assert!(uvs.as_flattened().iter().all(|uv| (0.0..=1.0).contains(uv)));
        }
        assert_eq!(open_edges(&generated("foliage:8000")), 8 * 1000);
    }

    #[test]
    fn names_are_read_back_and_wrong_ones_refused() {
        for name in ["torus:1000000", "foliage:64"] {
            assert_eq!(name.parse::<Generated>().unwrap().to_string(), name);
        }
        for name in [
            "torus",
            "cube:100",
            "torus:x",
            "torus:3",
            "torus:999999999999",
        ] {
            assert!(name.parse::<Generated>().is_err(), "{name}");
        }
    }
}
