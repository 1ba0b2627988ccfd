//! The mean look of an asset from its six sides, measured on small pictures of a coarse cut.

use glam::{DVec3, Vec3};
use lodestream_format::cluster::Attributes;
use lodestream_format::hierarchy::ROOT_ERROR;
use lodestream_format::octahedral;
use lodestream_format::proxy::{MOST_SHARES, PROXY_SIDES, Proxy, ProxySide, SlotShare};

use super::cluster::ClusterView;
use super::vertex::Grids;

/// Triangles of the cut at most, where the mesh gets so coarse.
pub(super) const MOST_TRIANGLES: u64 = 4096;
/// Pixels a side of the pictures.
const SIDE_PX: usize = 64;
/// Share of an area by which its measure may be wrong.
const MEASURED_WITHIN: f32 = 0.03;
/// The same for the areas of its slots: many small ones are measured with few pixels.
const SHARES_WITHIN: f32 = 0.25;
/// Directions between the axes; their opposites cover the same.
const DIAGONALS: [[f64; 3]; 4] = [
    [1.0, 1.0, 1.0],
    [-1.0, 1.0, 1.0],
    [1.0, -1.0, 1.0],
    [1.0, 1.0, -1.0],
];

/// A triangle of the cut.
pub(super) struct Triangle {
    corners: [DVec3; 3],
    /// Sum of the vertex normals; zero without them.
    normal: DVec3,
    /// Mean vertex colour, 0..=255.
    color: Vec3,
    slot: u16,
}

/// Measures a cut.
pub(super) fn measure(triangles: &[Triangle]) -> Proxy {
    let mut proxy = Proxy::default();
    for axis in 0..3 {
        let picture = Picture::new(triangles, AXES[axis]);
        // A mesh of 2^123 metres covers more than f32 holds.
        proxy.areas_m2[axis] = picture.area_m2().min(f32::MAX.into()) as f32;
        for (side, visible) in [&picture.nearest, &picture.farthest]
            .into_iter()
            .enumerate()
        {
            let toward = AXES[axis] * [1.0, -1.0][side];
            let visible = visible.iter().filter_map(|&(triangle, _)| triangle);
            let visible = visible.map(|triangle| &triangles[triangle as usize]);
            proxy.sides[2 * axis + side] = look(visible, toward);
        }
    }
    proxy.boxiness = boxiness(triangles, proxy.areas_m2.map(f64::from)) as f32;
    debug_assert_eq!(proxy.sides.len(), PROXY_SIDES);
    proxy
}

/// The error that stands for the area that a coarser cut covers too little or too much, or with
/// another material, metres. Where it shows a pixel, the areas differ by a sixteenth of one: so a
/// crowd of instances of a few pixels keeps its mean cover and colour.
pub(super) fn cover_metres(source: &Proxy, coarser: &Proxy) -> f32 {
    let differs = |side: usize| {
        let slots = source.sides[side]
            .shares
            .iter()
            .chain(&coarser.sides[side].shares);
        let mut slots: Vec<u16> = slots.map(|share| share.slot).collect();
        slots.sort_unstable();
        slots.dedup();
        let apart = |&slot: &u16| {
            let [source_m2, coarser_m2] = [source, coarser].map(|it| slot_area_m2(it, side, slot));
            (source_m2 - coarser_m2).abs()
        };
        let apart_m2: f32 = slots.iter().map(apart).sum();
        let [source_m2, coarser_m2] = [source, coarser].map(|it| it.areas_m2[side / 2]);
        let cover_m2 = (source_m2 - coarser_m2).abs() - MEASURED_WITHIN * source_m2;
        // The loss of one slot is the gain of another.
        cover_m2.max(0.5 * apart_m2 - SHARES_WITHIN * source_m2)
    };
    let most_m2 = (0..PROXY_SIDES).map(differs).fold(0.0, f32::max);
    // A mesh of 2^123 metres has areas past f32; its error stays below the root's.
    (4.0 * most_m2.sqrt()).min(ROOT_ERROR / 4.0)
}

/// Visible area of a slot from a side, square metres.
fn slot_area_m2(proxy: &Proxy, side: usize, slot: u16) -> f32 {
    let shares = &proxy.sides[side].shares;
    let total: f32 = shares.iter().map(|share| f32::from(share.share)).sum();
    let own = shares.iter().find(|share| share.slot == slot);
    own.map_or(0.0, |own| {
        proxy.areas_m2[side / 2] * f32::from(own.share) / total
    })
}

const AXES: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];

/// The triangles of a cluster.
pub(super) fn triangles<'a>(
    grids: &'a Grids,
    view: ClusterView<'a>,
) -> impl Iterator<Item = Triangle> + 'a {
    let has = |flag| grids.attributes.has(flag);
    let (normals, colors) = (has(Attributes::NORMAL), has(Attributes::COLOR));
    let one = move |(&[a, b, c, _], slot): (&[u8; 4], u16)| {
        let vertices = [a, b, c].map(|vertex| view.vertices[vertex as usize]);
        let place = |position: [i32; 3]| DVec3::from(position.map(f64::from));
        let normal = vertices.map(|it| Vec3::from(octahedral::decode(it.normal)).as_dvec3());
        let color = vertices
            .map(|it| Vec3::new(it.color[0].into(), it.color[1].into(), it.color[2].into()));
        Triangle {
            corners: vertices.map(|it| place(it.position) * grids.step_metres()),
            normal: match normals {
                true => normal.into_iter().sum(),
                false => DVec3::ZERO,
            },
            color: match colors {
                true => color.into_iter().sum::<Vec3>() / 3.0,
                false => Vec3::splat(255.0),
            },
            slot,
        }
    };
    let slots: Vec<u16> = view.slots().collect();
    view.triangles.iter().zip(slots).map(one)
}

/// Mean of what is visible, a triangle a pixel, from the side that looks along `-toward`.
fn look<'a>(visible: impl Iterator<Item = &'a Triangle>, toward: DVec3) -> ProxySide {
    let (mut normal, mut color, mut pixels) = (DVec3::ZERO, Vec3::ZERO, 0.0);
    let mut counts: Vec<(u16, u64)> = Vec::new();
    for triangle in visible {
        normal += triangle.normal_toward(toward);
        color += triangle.color;
        pixels += 1.0;
        match counts.iter_mut().find(|(slot, _)| *slot == triangle.slot) {
            Some((_, count)) => *count += 1,
            None => counts.push((triangle.slot, 1)),
        }
    }
    if pixels == 0.0 {
        return ProxySide {
            normal: octahedral::encode(toward.as_vec3().to_array()),
            color: [255; 3],
            shares: Vec::new(),
        };
    }
    counts.sort_by_key(|&(slot, count)| (std::cmp::Reverse(count), slot));
    counts.truncate(MOST_SHARES);
    let total: u64 = counts.iter().map(|(_, count)| count).sum();
    let share = |&(slot, count): &(u16, u64)| SlotShare {
        slot,
        share: (count * 255 / total).max(1) as u8,
    };
    ProxySide {
        normal: octahedral::encode(normal.as_vec3().to_array()),
        color: (color / pixels).to_array().map(|value| value.round() as u8),
        shares: counts.iter().map(share).collect(),
    }
}

impl Triangle {
    /// Unit normal on the side that is seen: the triangle's own is turned to the eye, and the
    /// vertex normals after it, as when it is drawn.
    fn normal_toward(&self, toward: DVec3) -> DVec3 {
        let [a, b, c] = self.corners;
        let own = (b - a).cross(c - a).normalize_or_zero();
        let own = if own.dot(toward) < 0.0 { -own } else { own };
        let smooth = self.normal.normalize_or(own);
        if smooth.dot(own) < 0.0 {
            -smooth
        } else {
            smooth
        }
    }
}

/// Where the areas in the directions between the axes lie between the root of the squares and the
/// sum.
fn boxiness(triangles: &[Triangle], areas_m2: [f64; 3]) -> f64 {
    let sum: f64 = areas_m2.iter().sum::<f64>() / 3f64.sqrt();
    let root = areas_m2.iter().map(|area| area * area).sum::<f64>().sqrt() / 3f64.sqrt();
    let measured = DIAGONALS.map(|toward| {
        let toward = DVec3::from(toward).normalize();
        Picture::new(triangles, toward).area_m2()
    });
    let mean = measured.iter().sum::<f64>() / measured.len() as f64;
    match sum - root > 1e-6 * sum {
        true => ((mean - root) / (sum - root)).clamp(0.0, 1.0),
        false => 0.0,
    }
}

/// The first and the last triangle along a direction, a pixel each, with its depth.
struct Picture {
    nearest: Vec<(Option<u32>, f64)>,
    farthest: Vec<(Option<u32>, f64)>,
    pixel_area_m2: f64,
}

impl Picture {
    fn new(triangles: &[Triangle], toward: DVec3) -> Self {
        let (right, up) = toward.any_orthonormal_pair();
        let flat = |point: DVec3| [point.dot(right), point.dot(up), point.dot(toward)];
        let corners: Vec<[[f64; 3]; 3]> = triangles
            .iter()
            .map(|triangle| triangle.corners.map(flat))
            .collect();
        let all = || corners.iter().flatten();
        let side = |axis: usize| {
            let low = all().map(|point| point[axis]).fold(f64::MAX, f64::min);
            let high = all().map(|point| point[axis]).fold(f64::MIN, f64::max);
            (low, (high - low).max(0.0) / SIDE_PX as f64)
        };
        let [(low_u, step_u), (low_v, step_v)] = [side(0), side(1)];
        let mut picture = Self {
            nearest: vec![(None, f64::MIN); SIDE_PX * SIDE_PX],
            farthest: vec![(None, f64::MAX); SIDE_PX * SIDE_PX],
            pixel_area_m2: step_u * step_v,
        };
        if !(step_u > 0.0 && step_v > 0.0) {
            return picture;
        }
        for (index, corners) in (0..).zip(&corners) {
            let px =
                corners.map(|[u, v, depth]| [(u - low_u) / step_u, (v - low_v) / step_v, depth]);
            picture.draw(index, px);
        }
        picture
    }

    /// Centres inside the triangle; a border counts to both sides.
    fn draw(&mut self, index: u32, [a, b, c]: [[f64; 3]; 3]) {
        let edge = |from: [f64; 3], to: [f64; 3], x: f64, y: f64| {
            (to[0] - from[0]) * (y - from[1]) - (to[1] - from[1]) * (x - from[0])
        };
        let area = edge(a, b, c[0], c[1]);
        if area == 0.0 {
            return;
        }
        let range = |axis: usize| {
            let low = a[axis].min(b[axis]).min(c[axis]) - 0.5;
            let high = a[axis].max(b[axis]).max(c[axis]) - 0.5;
            let last = SIDE_PX as f64 - 1.0;
            low.ceil().clamp(0.0, last) as usize..=high.floor().clamp(0.0, last) as usize
        };
        for y in range(1) {
            for x in range(0) {
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let weights = [edge(b, c, px, py), edge(c, a, px, py), edge(a, b, px, py)]
                    .map(|weight| weight / area);
                if weights.iter().any(|&weight| weight < 0.0) {
                    continue;
                }
                let depth = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2];
                let pixel = y * SIDE_PX + x;
                if depth > self.nearest[pixel].1 {
                    self.nearest[pixel] = (Some(index), depth);
                }
                if depth < self.farthest[pixel].1 {
                    self.farthest[pixel] = (Some(index), depth);
                }
            }
        }
    }

    fn area_m2(&self) -> f64 {
        let covered = self
            .nearest
            .iter()
            .filter(|(triangle, _)| triangle.is_some());
        covered.count() as f64 * self.pixel_area_m2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(corners: [[f64; 3]; 3], slot: u16) -> Triangle {
        Triangle {
            corners: corners.map(DVec3::from),
            normal: DVec3::ZERO,
            color: Vec3::splat(255.0),
            slot,
        }
    }

    /// The six faces of a box, each with its own slot, in the order of the sides.
    fn cuboid(size: DVec3) -> Vec<Triangle> {
        let mut faces = Vec::new();
        for axis in 0..3 {
            for sign in [0.5, -0.5] {
                let at = |u: f64, v: f64| {
                    let mut point = [0.0; 3];
                    point[axis] = sign;
                    point[(axis + 1) % 3] = u;
                    point[(axis + 2) % 3] = v;
                    (DVec3::from(point) * size).to_array()
                };
                let [a, b, c, d] = [at(-0.5, -0.5), at(0.5, -0.5), at(0.5, 0.5), at(-0.5, 0.5)];
                let slot = faces.len() as u16 / 2;
                faces.push(triangle([a, b, c], slot));
                faces.push(triangle([a, c, d], slot));
            }
        }
        faces
    }

    #[test]
    fn a_box_shows_each_face_from_its_side_and_adds_up() {
        let faces = cuboid(DVec3::new(2.0, 3.0, 5.0));
        for (axis, expected_m2) in [15.0, 10.0, 6.0].into_iter().enumerate() {
            let picture = Picture::new(&faces, AXES[axis]);
            assert!(
                (picture.area_m2() - expected_m2).abs() < 1e-9,
                "axis {axis}"
            );
            for (side, visible) in [&picture.nearest, &picture.farthest]
                .into_iter()
                .enumerate()
            {
                let slot = (2 * axis + side) as u16;
                let inner = &visible[SIDE_PX * SIDE_PX / 2 + SIDE_PX / 2];
                assert_eq!(faces[inner.0.expect("covered") as usize].slot, slot);
            }
        }
        let whole = boxiness(&faces, [15.0, 10.0, 6.0]);
        assert!(whole > 0.9, "a box's areas add up: {whole}");
    }

    #[test]
    fn a_sphere_covers_the_same_from_everywhere() {
        let at = |ring: usize, turn: usize| {
            let (polar, around) = (ring as f64 / 16.0, turn as f64 / 16.0);
            let (polar, around) = (polar * std::f64::consts::PI, around * std::f64::consts::PI);
            [
                polar.sin() * around.cos(),
                polar.cos(),
                polar.sin() * around.sin(),
            ]
        };
        let mut faces = Vec::new();
        for ring in 0..16 {
            for turn in 0..32 {
                let corners = [at(ring, turn), at(ring + 1, turn), at(ring + 1, turn + 1)];
                faces.push(triangle(corners, 0));
                let corners = [at(ring, turn), at(ring + 1, turn + 1), at(ring, turn + 1)];
                faces.push(triangle(corners, 0));
            }
        }
        let areas = AXES.map(|toward| Picture::new(&faces, toward).area_m2());
        for area_m2 in areas {
            assert!((area_m2 - std::f64::consts::PI).abs() < 0.1, "{area_m2}");
        }
        let whole = boxiness(&faces, areas);
        assert!(whole < 0.1, "a sphere's areas do not add up: {whole}");
    }

    #[test]
    fn a_lone_face_is_seen_from_both_sides_and_has_no_edge() {
        let face = [triangle(
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            3,
        )];
        let picture = Picture::new(&face, DVec3::Z);
        assert!((picture.area_m2() - 0.5).abs() < 0.02);
        assert_eq!(Picture::new(&face, DVec3::X).area_m2(), 0.0);
        for toward in [DVec3::Z, DVec3::NEG_Z] {
            let side = look(face.iter(), toward);
            let normal = Vec3::from(octahedral::decode(side.normal)).as_dvec3();
            assert!(normal.dot(toward) > 0.99);
            assert_eq!(
                side.shares,
                [SlotShare {
                    slot: 3,
                    share: 255
                }]
            );
        }
    }
}
