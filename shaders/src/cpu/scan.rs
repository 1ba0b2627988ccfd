//! One triangle to fragments by the rules of Vulkan: clipping, eight bits of subpixel, pixel centres, top-left edges.

use glam::{DVec4, Vec4};

/// Steps of the grid that corners snap to, a pixel.
const SUBPIXELS: f64 = 256.0;
/// Triangles are clipped where they leave the screen by this many pixels: edge functions of what is left fit 64 bits.
const GUARD_BAND_PX: f64 = (1 << 20) as f64;

/// A covered pixel centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fragment {
    /// Column, from the left.
    pub x: u32,
    /// Row, from the top.
    pub y: u32,
    /// `near / distance`: 1 at the near plane, towards 0 far away.
    pub depth: f32,
    /// Whether the corners go counter-clockwise on the screen.
    pub front: bool,
}

/// A corner after the perspective division.
#[derive(Debug, Clone, Copy)]
struct Corner {
    x: i64,
    y: i64,
    depth: f64,
}

/// Calls `visit` once for every fragment of the triangle with these clip-space corners. A triangle with a corner that is
/// not finite has none.
pub fn scan_triangle(corners: [Vec4; 3], size_px: [u32; 2], mut visit: impl FnMut(Fragment)) {
    if !corners.iter().all(|corner| corner.is_finite()) {
        return;
    }
    let corners = corners.map(|corner| corner.as_dvec4());
    let planes = planes(size_px);
    if planes
        .iter()
        .all(|plane| corners.iter().all(|&corner| plane.dot(corner) >= 0.0))
    {
        scan(
            corners.map(|corner| snap(corner, size_px)),
            size_px,
            &mut visit,
        );
        return;
    }
    let corners: Vec<_> = clip(&corners, &planes)
        .iter()
        .map(|&corner| snap(corner, size_px))
        .collect();
    // A fan over the clipped polygon: its inner edges are shared, so the top-left rule gives each pixel to one part.
    for pair in corners.get(1..).unwrap_or(&[]).windows(2) {
        scan([corners[0], pair[0], pair[1]], size_px, &mut visit);
    }
}

/// The near plane (z <= w), the far one (z >= 0) and the guard band: what a corner's dot product with is not negative is kept.
fn planes(size_px: [u32; 2]) -> [DVec4; 6] {
    let [x, y] = size_px.map(|size| 1.0 + 2.0 * GUARD_BAND_PX / size as f64);
    [
        DVec4::new(0.0, 0.0, -1.0, 1.0),
        DVec4::new(0.0, 0.0, 1.0, 0.0),
        DVec4::new(-1.0, 0.0, 0.0, x),
        DVec4::new(1.0, 0.0, 0.0, x),
        DVec4::new(0.0, -1.0, 0.0, y),
        DVec4::new(0.0, 1.0, 0.0, y),
    ]
}

/// Sutherland and Hodgman, "Reentrant polygon clipping", 1974.
fn clip(corners: &[DVec4; 3], planes: &[DVec4; 6]) -> Vec<DVec4> {
    let mut polygon = corners.to_vec();
    for plane in planes {
        let before = std::mem::take(&mut polygon);
        for (index, &to) in before.iter().enumerate() {
            let from = before[(index + before.len() - 1) % before.len()];
            let (here, there) = (plane.dot(from), plane.dot(to));
            if (here < 0.0) != (there < 0.0) {
                // From the inner end, so that both triangles of an edge compute the same point.
                let (a, b, a_in, b_in) = match here < 0.0 {
                    true => (to, from, there, here),
                    false => (from, to, here, there),
                };
                polygon.push(a + (b - a) * (a_in / (a_in - b_in)));
            }
            if there >= 0.0 {
                polygon.push(to);
            }
        }
    }
    polygon.retain(|corner| corner.w > 0.0);
    polygon
}

fn snap(corner: DVec4, size_px: [u32; 2]) -> Corner {
    let x_px = (0.5 + 0.5 * corner.x / corner.w) * size_px[0] as f64;
    let y_px = (0.5 - 0.5 * corner.y / corner.w) * size_px[1] as f64;
    Corner {
        x: (x_px * SUBPIXELS).round_ties_even() as i64,
        y: (y_px * SUBPIXELS).round_ties_even() as i64,
        depth: corner.z / corner.w,
    }
}

/// Twice the signed area of `a`, `b` and a point; positive where they go clockwise on the screen, whose y points down.
fn edge(a: Corner, b: Corner, x: i64, y: i64) -> i64 {
    (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)
}

/// Whether a point on the edge from `a` to `b` of a clockwise triangle belongs to it: left and top edges only.
fn owns_border(a: Corner, b: Corner) -> bool {
    b.y < a.y || (b.y == a.y && b.x > a.x)
}

fn scan(corners: [Corner; 3], size_px: [u32; 2], visit: &mut impl FnMut(Fragment)) {
    let [a, mut b, mut c] = corners;
    let area = edge(a, b, c.x, c.y);
    if area == 0 {
        return;
    }
    if area < 0 {
        std::mem::swap(&mut b, &mut c);
    }
    let columns = covered([a.x, b.x, c.x], size_px[0]);
    let step = SUBPIXELS as i64;
    let edges = [(b, c), (c, a), (a, b)];
    // Counting a border in is the same as moving it out by the smallest step.
    let bias = edges.map(|(from, to)| if owns_border(from, to) { 0 } else { -1 });
    for y in covered([a.y, b.y, c.y], size_px[1]) {
        let center_y = y as i64 * step + step / 2;
        let mut values = edges
            .map(|(from, to)| edge(from, to, columns.start as i64 * step + step / 2, center_y));
        for x in columns.clone() {
            if (0..3).all(|index| values[index] + bias[index] >= 0) {
                let depth = a.depth
                    + ((b.depth - a.depth) * values[1] as f64
                        + (c.depth - a.depth) * values[2] as f64)
                        / area.unsigned_abs() as f64;
                visit(Fragment {
                    x,
                    y,
                    depth: depth.clamp(0.0, 1.0) as f32,
                    front: area < 0,
                });
            }
            for (value, (from, to)) in values.iter_mut().zip(edges) {
                *value -= (to.y - from.y) * step;
            }
        }
    }
}

/// Pixels of a side of `size` whose centres lie between the outermost of three coordinates.
fn covered(coordinates: [i64; 3], size: u32) -> std::ops::Range<u32> {
    let step = SUBPIXELS as i64;
    let low = coordinates.into_iter().min().unwrap_or(0);
    let high = coordinates.into_iter().max().unwrap_or(0);
    // The first centre at or after `low`, one past the last at or before `high`.
    let first = (low + step / 2 - 1).div_euclid(step).clamp(0, size as i64);
    let end = ((high - step / 2).div_euclid(step) + 1).clamp(first, size as i64);
    first as u32..end as u32
}
