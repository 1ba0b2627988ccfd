//! Quadrics: what moving a vertex costs (Garland and Heckbert, "Surface simplification using quadric error metrics", 1997),
//! also in its attributes (Hoppe, "New quadric metric for simplifying meshes with appearance attributes", 1999).
//!
//! Every quadric is kept relative to its own vertex. Its linear and constant terms start at 0 and stay as small as the error
//! is, so nothing cancels, however far the vertex lies from the origin and however flat the surface is: f32 is enough.

use glam::Vec4;

/// Weighted sum of squared distances to planes, as a function of the offset from a point.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    /// Rows of the symmetric matrix, each with its linear term behind.
    rows: [Vec4; 3],
    pub c: f32,
    /// Sum of the weights.
    pub weight: f32,
}

impl Quadric {
    /// Of one plane through the point. `normal` is of unit length.
    pub fn plane(normal: [f32; 3], weight: f32) -> Self {
        let [x, y, z] = normal;
        let row = Vec4::new(x, y, z, 0.0);
        Self {
            rows: normal.map(|value| row * (value * weight)),
            c: 0.0,
            weight,
        }
    }

    /// Adds a quadric of the same point as far as it is a matrix, which leaves linear and constant terms alone.
    pub fn add_matrix(&mut self, other: &Self) {
        for axis in 0..3 {
            self.rows[axis] += other.rows[axis];
        }
    }

    pub fn add(&mut self, other: &Self) {
        self.add_matrix(other);
        self.c += other.c;
        self.weight += other.weight;
    }

    /// xx, yy, zz, xy, xz, yz of the matrix.
    pub fn matrix(&self) -> [f32; 6] {
        let [x, y, z] = self.rows;
        [x.x, y.y, z.z, x.y, x.z, y.z]
    }

    /// Linear terms.
    pub fn linear(&self) -> [f32; 3] {
        self.rows.map(|row| row.w)
    }

    /// The matrix times an offset, with the product of the linear terms and the offset behind.
    #[inline(always)]
    fn times(&self, [x, y, z]: [f32; 3]) -> Vec4 {
        self.rows[0] * x + self.rows[1] * y + self.rows[2] * z
    }

    /// Four numbers whose sum with the constant term is the value at an offset.
    #[inline(always)]
    pub fn lanes(&self, offset: [f32; 3]) -> Vec4 {
        let [x, y, z] = offset;
        self.times(offset) * Vec4::new(x, y, z, 2.0)
    }

    /// Value at an offset.
    #[inline(always)]
    pub fn at(&self, offset: [f32; 3]) -> f32 {
        sum(self.lanes(offset)) + self.c
    }

    /// The same quadric relative to the point at `offset`.
    pub fn moved(&self, offset: [f32; 3]) -> Self {
        let mut moved = *self;
        let times = self.times(offset);
        (0..3).for_each(|axis| moved.rows[axis].w += times[axis]);
        moved.c = self.at(offset).max(0.0);
        moved
    }
}

/// Weighted sum of squared differences between attributes, `L` times four of them, and their linear course over each triangle,
/// as a function of the offset and of the attributes' change.
#[derive(Debug, Clone, Copy)]
pub(super) struct AttributeQuadric<const L: usize> {
    /// The terms without the attributes' change; its weight is that of the triangles.
    pub base: Quadric,
    /// Weighted sums of the gradients, by coordinate.
    gradient: [[Vec4; L]; 3],
    /// Weighted sums of the differences at the point.
    difference: [Vec4; L],
}

impl<const L: usize> Default for AttributeQuadric<L> {
    fn default() -> Self {
        Self {
            base: Quadric::default(),
            gradient: [[Vec4::ZERO; L]; 3],
            difference: [Vec4::ZERO; L],
        }
    }
}

impl<const L: usize> AttributeQuadric<L> {
    /// Of one triangle, relative to any of its corners. `duals` are the vectors whose products with the two edges from the
    /// first corner are 1 and 0, and 0 and 1; `steps` the attributes' change along these edges.
    #[inline(always)]
    pub fn triangle(duals: [[f32; 3]; 2], steps: [[Vec4; L]; 2], weight: f32) -> Self {
        let gradient: [[Vec4; L]; 3] = std::array::from_fn(|axis| {
            std::array::from_fn(|k| steps[0][k] * duals[0][axis] + steps[1][k] * duals[1][axis])
        });
        let weighed = gradient.map(|row| row.map(|value| value * weight));
        let product = |i: usize, j: usize| product(&gradient[i], &weighed[j]);
        let (xy, xz, yz) = (product(0, 1), product(0, 2), product(1, 2));
        Self {
            base: Quadric {
                rows: [
                    Vec4::new(product(0, 0), xy, xz, 0.0),
                    Vec4::new(xy, product(1, 1), yz, 0.0),
                    Vec4::new(xz, yz, product(2, 2), 0.0),
                ],
                c: 0.0,
                weight,
            },
            gradient: weighed,
            difference: [Vec4::ZERO; L],
        }
    }

    /// Adds one triangle of the same point, whose linear and constant terms are 0.
    #[inline(always)]
    pub fn add_triangle(&mut self, other: &Self) {
        self.base.add_matrix(&other.base);
        self.base.weight += other.base.weight;
        for axis in 0..3 {
            (0..L).for_each(|k| self.gradient[axis][k] += other.gradient[axis][k]);
        }
    }

    pub fn add(&mut self, other: &Self) {
        self.add_triangle(other);
        self.base.c += other.base.c;
        (0..L).for_each(|k| self.difference[k] += other.difference[k]);
    }

    /// Weighted sums of the attributes' linear courses at an offset.
    #[inline(always)]
    fn courses(&self, [x, y, z]: [f32; 3]) -> [Vec4; L] {
        let [to_x, to_y, to_z] = &self.gradient;
        std::array::from_fn(|k| to_x[k] * x + to_y[k] * y + to_z[k] * z + self.difference[k])
    }

    /// Four numbers whose sum with the constant term is the value at an offset where the attributes change by `change`.
    #[inline(always)]
    pub fn lanes(&self, offset: [f32; 3], change: &[Vec4; L]) -> Vec4 {
        let courses = self.courses(offset);
        let mut lanes = self.base.lanes(offset);
        for k in 0..L {
            lanes += change[k] * (change[k] * self.base.weight - courses[k] * 2.0);
        }
        lanes
    }

    /// The same quadric relative to the point at `offset` with the attributes changed.
    pub fn moved(&self, offset: [f32; 3], change: &[Vec4; L]) -> Self {
        let courses = self.courses(offset);
        let mut moved = *self;
        moved.base.c = (sum(self.lanes(offset, change)) + self.base.c).max(0.0);
        let times = self.base.times(offset);
        for axis in 0..3 {
            moved.base.rows[axis].w += times[axis] - product(&self.gradient[axis], change);
        }
        for k in 0..L {
            moved.difference[k] = courses[k] - change[k] * self.base.weight;
        }
        moved
    }

    /// The attributes' change that costs least at an offset.
    pub fn best_change(&self, offset: [f32; 3]) -> [Vec4; L] {
        if self.base.weight <= 0.0 {
            return [Vec4::ZERO; L];
        }
        self.courses(offset).map(|course| course / self.base.weight)
    }

    /// The quadric of the offset alone when the attributes follow in the best way.
    pub fn following(&self) -> Quadric {
        let mut quadric = self.base;
        if self.base.weight <= 0.0 {
            return quadric;
        }
        let over = 1.0 / self.base.weight;
        for (axis, row) in quadric.rows.iter_mut().enumerate() {
            let own = &self.gradient[axis];
            let [x, y, z] = [0, 1, 2].map(|other| product(own, &self.gradient[other]));
            *row -= Vec4::new(x, y, z, product(own, &self.difference)) * over;
        }
        quadric
    }
}

/// Sum of four numbers, in an order that is the same on every machine.
#[inline(always)]
pub(super) fn sum(lanes: Vec4) -> f32 {
    let [x, y, z, w] = lanes.to_array();
    (x + z) + (y + w)
}

/// Sum of the products.
#[inline(always)]
fn product<const L: usize>(a: &[Vec4; L], b: &[Vec4; L]) -> f32 {
    sum((0..L).fold(Vec4::ZERO, |lanes, k| lanes + a[k] * b[k]))
}

pub(super) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sum over planes and courses in f64, as the definition has it.
    #[test]
    fn moved_quadrics_keep_their_values() {
        let third = 1.0 / 3f32.sqrt();
        let mut plane = Quadric::plane([third, third, -third], 2.0);
        plane.add(&Quadric::plane([0.0, 0.6, 0.8], 0.5));
        let offset = [0.3, -0.2, 0.7];
        let expected = |x: [f32; 3]| -> f32 {
            2.0 * dot([third, third, -third], x).powi(2) + 0.5 * dot([0.0, 0.6, 0.8], x).powi(2)
        };
        assert!((plane.at(offset) - expected(offset)).abs() < 1e-6);
        let moved = plane.moved(offset);
        let more = [0.1, 0.5, -0.4];
        let total = std::array::from_fn(|axis| offset[axis] + more[axis]);
        assert!((moved.at(more) - expected(total)).abs() < 1e-6);

        // Attributes over the plane z = 0: the first is x, the second 2y.
        let duals = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let four = |[a, b]: [f32; 2]| [Vec4::new(a, b, 0.0, 0.0)];
        let steps = [four([1.0, 0.0]), four([0.0, 2.0])];
        let own = AttributeQuadric::<1>::triangle(duals, steps, 0.5);
        let at = |quadric: &AttributeQuadric<1>, offset, change| {
            sum(quadric.lanes(offset, &change)) + quadric.base.c
        };
        let value = |x: [f32; 3], s: [f32; 2]| -> f32 {
            0.5 * ((x[0] - s[0]).powi(2) + (2.0 * x[1] - s[1]).powi(2))
        };
        let change = [0.2, -0.1];
        assert!((at(&own, offset, four(change)) - value(offset, change)).abs() < 1e-6);
        let moved = own.moved(offset, &four(change));
        let further = [change[0] + 0.4, change[1] + 0.3];
        assert!((at(&moved, more, four([0.4, 0.3])) - value(total, further)).abs() < 1e-6);
        // Where the attributes follow, a linear course costs nothing.
        let best = own.best_change(offset);
        assert!(at(&own, offset, best).abs() < 1e-6);
        assert!(own.following().at(offset).abs() < 1e-6);
    }
}
