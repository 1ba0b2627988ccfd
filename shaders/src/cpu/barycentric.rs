//! Perspective-correct weights of a triangle's corners at a pixel. Twin of `wgsl/shared/barycentric.wgsl`, which tells why.

use glam::{Vec2, Vec3, Vec3Swizzles, Vec4};

/// Weights of the three corners, which sum to 1, and their changes over one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Barycentric {
    /// At the pixel's centre, none below 0.
    pub weights: Vec3,
    /// Change over one pixel to the right.
    pub weights_dx: Vec3,
    /// Change over one pixel down.
    pub weights_dy: Vec3,
}

impl Barycentric {
    /// Weights of the clip-space `corners` at `ndc`; `pixel_in_ndc` is the step to the next pixel to the right and down.
    pub fn at(corners: [Vec4; 3], ndc: Vec2, pixel_in_ndc: Vec2) -> Self {
        let [a, b, c] = corners;
        let scale = 1.0 / a.w.abs().max(b.w.abs()).max(c.w.abs().max(1e-37));
        let w = Vec3::new(a.w, b.w, c.w) * scale;
        let x = Vec3::new(a.x - ndc.x * a.w, b.x - ndc.x * b.w, c.x - ndc.x * c.w) * scale;
        let y = Vec3::new(a.y - ndc.y * a.w, b.y - ndc.y * b.w, c.y - ndc.y * c.w) * scale;
        let edges = x.yzx() * y.zxy() - x.zxy() * y.yzx();
        let edges_dx = (y.yzx() * w.zxy() - y.zxy() * w.yzx()) * pixel_in_ndc.x;
        let edges_dy = (x.zxy() * w.yzx() - x.yzx() * w.zxy()) * pixel_in_ndc.y;
        let sum = edges.x + edges.y + edges.z;
        if sum.is_nan() || sum.abs() <= 1e-30 {
            return Self {
                weights: Vec3::splat(1.0 / 3.0),
                weights_dx: Vec3::ZERO,
                weights_dy: Vec3::ZERO,
            };
        }
        let exact = edges / sum;
        let inside = exact.max(Vec3::ZERO);
        Self {
            weights: inside / (inside.x + inside.y + inside.z),
            weights_dx: (edges_dx - exact * (edges_dx.x + edges_dx.y + edges_dx.z)) / sum,
            weights_dy: (edges_dy - exact * (edges_dy.x + edges_dy.y + edges_dy.z)) / sum,
        }
    }
}
