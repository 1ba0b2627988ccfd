//! Distances from points to triangles, in f32: what a witness is measured with.

use super::quadric::{cross, dot, sub};

/// A walk may end in a hollow: what it found is held against everything where it is more than this times what is enough.
const SURE: f32 = 1.2;

/// The squared distance to all triangles where a walk found `squared`: a walk may end in a hollow. Any value not above `enough`
/// stands for every other one.
pub(super) fn sure(triangles: &[[[f32; 3]; 3]], at: [f32; 3], squared: f32, enough: f32) -> f32 {
    if squared <= SURE * enough {
        return squared;
    }
    let mut least = squared;
    for corners in triangles {
        least = least.min(to_triangle(at, corners, least));
        if least <= enough {
            break;
        }
    }
    least
}

pub(super) fn middle(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|axis| 0.5 * (a[axis] + b[axis]))
}

/// Squared distance from a point to a triangle (Ericson, "Real-Time Collision Detection", 3.4 and 5.1.5), or that to its plane
/// where already that is not below `least`.
pub(super) fn to_triangle(point: [f32; 3], &[a, b, c]: &[[f32; 3]; 3], least: f32) -> f32 {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(point, a));
    let normal = cross(ab, ac);
    let square = dot(normal, normal);
    if square > 0.0 {
        let height = dot(ap, normal);
        if height * height >= least * square {
            return height * height / square;
        }
        let v = dot(cross(ap, ac), normal);
        let w = dot(cross(ab, ap), normal);
        if v >= 0.0 && w >= 0.0 && v + w <= square {
            return height * height / square;
        }
    }
    to_segment(point, a, b)
        .min(to_segment(point, b, c))
        .min(to_segment(point, c, a))
}

pub(super) fn to_segment(point: [f32; 3], a: [f32; 3], b: [f32; 3]) -> f32 {
    let (ab, ap) = (sub(b, a), sub(point, a));
    let square = dot(ab, ab);
    let along = match square > 0.0 {
        true => (dot(ap, ab) / square).clamp(0.0, 1.0),
        false => 0.0,
    };
    let away = sub(ap, ab.map(|value| value * along));
    dot(away, away)
}
