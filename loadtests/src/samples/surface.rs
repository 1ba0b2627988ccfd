//! Triangles in the making: a surface of one material, and the model that such surfaces make.

use glam::DVec3;

use super::number::{grid, rgb, turn};

/// A named mesh: surfaces by material, and which attributes it writes.
pub(super) struct Model {
    pub(super) name: String,
    pub(super) has_uv: bool,
    pub(super) has_colour: bool,
    /// Material index and its triangles.
    pub(super) parts: Vec<(usize, Surface)>,
}

impl Model {
    pub(super) fn new(name: impl Into<String>, has_uv: bool, has_colour: bool) -> Self {
        Self {
            name: name.into(),
            has_uv,
            has_colour,
            parts: Vec::new(),
        }
    }

    /// The surface of a material, its pen set to `colour`.
    pub(super) fn part(&mut self, material: usize, colour: [f64; 3]) -> &mut Surface {
        let index = self
            .parts
            .iter()
            .position(|(m, _)| *m == material)
            .unwrap_or_else(|| {
                self.parts.push((material, Surface::default()));
                self.parts.len() - 1
            });
        let surface = &mut self.parts[index].1;
        surface.pen = rgb(colour);
        surface
    }

    pub(super) fn triangles(&self) -> u64 {
        self.parts
            .iter()
            .map(|(_, surface)| surface.indices.len() as u64 / 3)
            .sum()
    }
}

/// A place with three directions: `right`, `up`, and `out` of the wall. `right x up = out`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub(super) origin: DVec3,
    pub(super) right: DVec3,
    pub(super) up: DVec3,
    pub(super) out: DVec3,
}

impl Frame {
    /// At `origin`, upright, looking out along a horizontal direction.
    pub(super) fn upright(origin: DVec3, out: DVec3) -> Self {
        Self {
            origin,
            right: DVec3::Y.cross(out),
            up: DVec3::Y,
            out,
        }
    }

    pub(super) fn world() -> Self {
        Self::upright(DVec3::ZERO, DVec3::Z)
    }

    pub(super) fn at(&self, right: f64, up: f64, out: f64) -> DVec3 {
        self.origin + self.right * right + self.up * up + self.out * out
    }

    /// The four horizontal faces of a box of half sizes `half`, from `y` up: frame at the left foot, and length.
    pub(super) fn around(half: [f64; 2], y: f64) -> [(Self, f64); 4] {
        let face = |out: DVec3, across: f64, away: f64| {
            let frame = Self::upright(DVec3::new(0.0, y, 0.0) + out * away, out);
            (
                Self {
                    origin: frame.at(-across, 0.0, 0.0),
                    ..frame
                },
                across * 2.0,
            )
        };
        let [x, z] = half;
        [
            face(DVec3::Z, x, z),
            face(DVec3::X, z, x),
            face(DVec3::NEG_Z, x, z),
            face(DVec3::NEG_X, z, x),
        ]
    }
}

/// Vertices and triangles of one material. Counter-clockwise is outside.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    pub(super) positions: Vec<[f32; 3]>,
    pub(super) normals: Vec<[f32; 3]>,
    pub(super) uvs: Vec<[f32; 2]>,
    pub(super) colours: Vec<[u8; 4]>,
    pub(super) indices: Vec<u32>,
    /// Colour of the vertices to come.
    pub(super) pen: [u8; 4],
    /// Metres that one repeat of the texture covers.
    pub(super) tile_metres: f64,
}

impl Default for Surface {
    fn default() -> Self {
        Self {
            positions: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            colours: Vec::new(),
            indices: Vec::new(),
            pen: [255; 4],
            tile_metres: 2.0,
        }
    }
}

impl Surface {
    /// Adds a vertex on the 1/1024 grid; texture coordinates are the place projected along `facing`.
    pub(super) fn vertex(&mut self, at: DVec3, normal: DVec3, facing: DVec3) -> u32 {
        let (u, v) = if facing.y.abs() > 0.7 {
            (at.x, at.z)
        } else {
            let right = DVec3::Y.cross(facing).normalize_or(DVec3::X);
            (at.dot(right), -at.y)
        };
        self.positions
            .push([grid(at.x) as f32, grid(at.y) as f32, grid(at.z) as f32]);
        self.normals
            .push(normal.normalize_or(DVec3::Y).as_vec3().to_array());
        self.uvs
            .push([(u / self.tile_metres) as f32, (v / self.tile_metres) as f32]);
        self.colours.push(self.pen);
        self.positions.len() as u32 - 1
    }

    /// Adds a triangle, unless two of its corners fell on one place.
    pub(super) fn triangle(&mut self, a: u32, b: u32, c: u32) {
        let at = |index: u32| self.positions[index as usize];
        if at(a) != at(b) && at(b) != at(c) && at(c) != at(a) {
            self.indices.extend([a, b, c]);
        }
    }

    /// A flat polygon of three or four corners, counter-clockwise seen from outside.
    pub(super) fn flat(&mut self, corners: &[DVec3]) {
        let normal = match *corners {
            [a, b, c] => (b - a).cross(c - a),
            [a, b, c, d] => (c - a).cross(d - b),
            _ => return,
        }
        .normalize_or_zero();
        let first = self.positions.len() as u32;
        for &corner in corners {
            self.vertex(corner, normal, normal);
        }
        for corner in 2..corners.len() as u32 {
            self.triangle(first, first + corner - 1, first + corner);
        }
    }

    /// As [`Self::flat`], turned to face `outward`.
    pub(super) fn facing(&mut self, corners: &mut [DVec3], outward: DVec3) {
        if let [a, b, c, ..] = *corners
            && (b - a).cross(c - a).dot(outward) < 0.0
        {
            corners.reverse();
        }
        self.flat(corners);
    }

    /// A box between two corners in a frame's directions; the faces whose bit is set in `open` are left out
    /// (1 left, 2 right, 4 bottom, 8 top, 16 back, 32 front).
    pub(super) fn cuboid(&mut self, frame: &Frame, low: [f64; 3], high: [f64; 3], open: u32) {
        let pick = |axis: usize, end: usize| if end == 0 { low[axis] } else { high[axis] };
        for face in 0..6 {
            if open & (1 << face) != 0 {
                continue;
            }
            let (axis, end) = (face / 2, face % 2);
            let corner = |first: usize, second: usize| {
                let mut local = [0.0; 3];
                local[axis] = pick(axis, end);
                local[(axis + 1) % 3] = pick((axis + 1) % 3, first);
                local[(axis + 2) % 3] = pick((axis + 2) % 3, second);
                frame.at(local[0], local[1], local[2])
            };
            let outward = [frame.right, frame.up, frame.out][axis] * (end as f64 * 2.0 - 1.0);
            self.facing(
                &mut [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)],
                outward,
            );
        }
    }

    /// A box with its edges cut by `bevel` metres: 44 triangles.
    pub(super) fn bevelled(&mut self, frame: &Frame, low: [f64; 3], high: [f64; 3], bevel: f64) {
        let middle = std::array::from_fn::<f64, 3, _>(|a| (low[a] + high[a]) / 2.0);
        let half = std::array::from_fn::<f64, 3, _>(|a| (high[a] - low[a]) / 2.0);
        let direction = |s: [f64; 3]| frame.right * s[0] + frame.up * s[1] + frame.out * s[2];
        // The corner with signs `s` has three points: each reaches the full size along one axis.
        let point = |s: [f64; 3], full: usize| {
            let local: [f64; 3] = std::array::from_fn(|a| {
                middle[a] + s[a] * if a == full { half[a] } else { half[a] - bevel }
            });
            frame.at(local[0], local[1], local[2])
        };
        let signs = [-1.0, 1.0];
        for axis in 0..3 {
            let (second, third) = ((axis + 1) % 3, (axis + 2) % 3);
            let build = |x: f64, y: f64, z: f64| {
                let mut s = [0.0; 3];
                (s[axis], s[second], s[third]) = (x, y, z);
                s
            };
            for x in signs {
                let corner = |y, z| point(build(x, y, z), axis);
                let mut face = [
                    corner(-1.0, -1.0),
                    corner(1.0, -1.0),
                    corner(1.0, 1.0),
                    corner(-1.0, 1.0),
                ];
                self.facing(&mut face, direction(build(x, 0.0, 0.0)));
                // The edges along `second` that this face shares with the two faces of `third`.
                for z in signs {
                    let mut edge = [
                        point(build(x, -1.0, z), axis),
                        point(build(x, 1.0, z), axis),
                        point(build(x, 1.0, z), third),
                        point(build(x, -1.0, z), third),
                    ];
                    self.facing(&mut edge, direction(build(x, 0.0, z)));
                }
            }
        }
        for corner in 0..8 {
            let s: [f64; 3] = std::array::from_fn(|a| signs[corner >> a & 1]);
            self.facing(&mut [point(s, 0), point(s, 1), point(s, 2)], direction(s));
        }
    }

    /// A smooth sheet through a grid of points. Seen from outside, columns run to the right and rows upward;
    /// `wrap` joins the last column to the first.
    pub(super) fn sheet(&mut self, rows: &[Vec<DVec3>], wrap: bool) {
        let Some(columns) = rows.first().map(Vec::len) else {
            return;
        };
        let spans = if wrap {
            columns
        } else {
            columns.saturating_sub(1)
        };
        let mut normals = vec![vec![DVec3::ZERO; columns]; rows.len()];
        for row in 1..rows.len() {
            for column in 0..spans {
                let next = (column + 1) % columns;
                let (a, b) = (rows[row - 1][column], rows[row - 1][next]);
                let (c, d) = (rows[row][next], rows[row][column]);
                let normal = (c - a).cross(d - b);
                for (r, k) in [
                    (row - 1, column),
                    (row - 1, next),
                    (row, next),
                    (row, column),
                ] {
                    normals[r][k] += normal;
                }
            }
        }
        let first = self.positions.len() as u32;
        for (points, row_normals) in rows.iter().zip(&normals) {
            for (&point, &normal) in points.iter().zip(row_normals) {
                self.vertex(point, normal, normal.normalize_or(DVec3::Y));
            }
        }
        let index = |row: usize, column: usize| first + (row * columns + column % columns) as u32;
        for row in 1..rows.len() {
            for column in 0..spans {
                let (a, b) = (index(row - 1, column), index(row - 1, column + 1));
                let (c, d) = (index(row, column + 1), index(row, column));
                self.triangle(a, b, c);
                self.triangle(a, c, d);
            }
        }
    }

    /// A profile of (radius, height) turned about the frame's `up`; it breaks where the profile bends sharply.
    pub(super) fn lathe(&mut self, frame: &Frame, profile: &[(f64, f64)], segments: usize) {
        let ring = |&(radius, height): &(f64, f64)| -> Vec<DVec3> {
            (0..segments)
                .map(|segment| {
                    let (cosine, sine) = turn(segment as f64 / segments as f64);
                    frame.at(radius * cosine, height, -radius * sine)
                })
                .collect()
        };
        let bends = |a: (f64, f64), b: (f64, f64), c: (f64, f64)| {
            let (p, q) = ((b.0 - a.0, b.1 - a.1), (c.0 - b.0, c.1 - b.1));
            let along = p.0 * q.0 + p.1 * q.1;
            // Sharper than 37 degrees: the cosine is below 0.8.
            along < 0.8 * ((p.0 * p.0 + p.1 * p.1) * (q.0 * q.0 + q.1 * q.1)).sqrt()
        };
        let mut start = 0;
        for end in 1..profile.len() {
            if end + 1 == profile.len() || bends(profile[end - 1], profile[end], profile[end + 1]) {
                let rows: Vec<_> = profile[start..=end].iter().map(ring).collect();
                self.sheet(&rows, true);
                start = end;
            }
        }
    }

    /// A round tube through `path` points with a radius each, open at both ends.
    pub(super) fn tube(&mut self, path: &[(DVec3, f64)], segments: usize) {
        let mut side = DVec3::ZERO;
        let rows: Vec<Vec<DVec3>> = (0..path.len())
            .map(|i| {
                let (before, after) = (
                    path[i.saturating_sub(1)].0,
                    path[(i + 1).min(path.len() - 1)].0,
                );
                let along = (after - before).normalize_or(DVec3::Y);
                let old = if side == DVec3::ZERO {
                    along.any_orthonormal_vector()
                } else {
                    side
                };
                side = (old - along * old.dot(along)).normalize_or(along.any_orthonormal_vector());
                let other = along.cross(side);
                (0..segments)
                    .map(|segment| {
                        let (cosine, sine) = turn(segment as f64 / segments as f64);
                        path[i].0 + (side * cosine + other * sine) * path[i].1
                    })
                    .collect()
            })
            .collect();
        self.sheet(&rows, true);
    }

    /// Lowest and highest coordinates, as written.
    pub(super) fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        self.positions
            .iter()
            .fold(([f32::MAX; 3], [f32::MIN; 3]), |(low, high), p| {
                (
                    std::array::from_fn(|a| low[a].min(p[a])),
                    std::array::from_fn(|a| high[a].max(p[a])),
                )
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six times less than what the triangles sweep from the origin: a closed surface's volume, negative if inside out.
    fn volume(surface: &Surface) -> f64 {
        let at = |index: u32| DVec3::from(surface.positions[index as usize].map(f64::from));
        let swept = |t: &[u32]| at(t[0]).dot(at(t[1]).cross(at(t[2])));
        surface.indices.chunks_exact(3).map(swept).sum::<f64>() / 6.0
    }

    #[test]
    fn solids_enclose_their_volume() {
        let frame = Frame::upright(DVec3::new(3.0, -2.0, 5.0), DVec3::NEG_X);
        let mut cuboid = Surface::default();
        cuboid.cuboid(&frame, [-1.0, 0.0, 0.5], [1.0, 3.0, 2.5], 0);
        assert_eq!((volume(&cuboid), cuboid.indices.len()), (12.0, 36));

        let mut bevelled = Surface::default();
        bevelled.bevelled(&frame, [-1.0, 0.0, 0.5], [1.0, 3.0, 2.5], 0.125);
        assert_eq!(bevelled.indices.len(), 44 * 3);
        assert!(
            (11.7..12.0).contains(&volume(&bevelled)),
            "{}",
            volume(&bevelled)
        );

        let mut cylinder = Surface::default();
        cylinder.lathe(
            &frame,
            &[(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.0, 2.0)],
            64,
        );
        let circle = std::f64::consts::TAU;
        assert!(
            (volume(&cylinder) / circle - 1.0).abs() < 0.01,
            "{}",
            volume(&cylinder)
        );

        // Open ends at the middle of the coordinates sweep nothing along the axis.
        let mut tube = Surface::default();
        tube.tube(&[(DVec3::NEG_Y, 0.5), (DVec3::Y, 0.5)], 32);
        assert!(volume(&tube) > 0.9, "{}", volume(&tube));
    }

    #[test]
    fn triangles_without_area_on_the_grid_are_left_out() {
        let mut surface = Surface::default();
        let near = DVec3::new(1e-5, 0.0, 0.0);
        surface.flat(&[DVec3::ZERO, near, DVec3::Y]);
        assert!(surface.indices.is_empty());
    }
}
