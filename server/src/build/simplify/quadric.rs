//! Quadrics: what moving a vertex costs (Garland and Heckbert, "Surface simplification using quadric error metrics", 1997),
//! also in its attributes (Hoppe, "New quadric metric for simplifying meshes with appearance attributes", 1999).
//!
//! Every quadric is kept relative to its own vertex. Its linear and constant terms start at 0 and stay as small as the error
//! is, so nothing cancels, however far the vertex lies from the origin and however flat the surface is: f32 is enough.

/// Weighted sum of squared distances to planes, as a function of the offset from a point.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    /// xx, yy, zz, xy, xz, yz.
    pub a: [f32; 6],
    pub b: [f32; 3],
    pub c: f32,
    /// Sum of the weights.
    pub weight: f32,
}

impl Quadric {
    /// Of one plane through the point. `normal` is of unit length.
    pub fn plane(normal: [f32; 3], weight: f32) -> Self {
        let [x, y, z] = normal;
        let products = [x * x, y * y, z * z, x * y, x * z, y * z];
        Self {
            a: products.map(|product| product * weight),
            weight,
            ..Self::default()
        }
    }

    pub fn add(&mut self, other: &Self) {
        for i in 0..6 {
            self.a[i] += other.a[i];
        }
        for i in 0..3 {
            self.b[i] += other.b[i];
        }
        self.c += other.c;
        self.weight += other.weight;
    }

    /// The matrix times a vector.
    pub fn times(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let [xx, yy, zz, xy, xz, yz] = self.a;
        [
            xx * x + xy * y + xz * z,
            xy * x + yy * y + yz * z,
            xz * x + yz * y + zz * z,
        ]
    }

    /// Value at an offset.
    pub fn at(&self, offset: [f32; 3]) -> f32 {
        let times = self.times(offset);
        dot(times, offset) + 2.0 * dot(self.b, offset) + self.c
    }

    /// The same quadric relative to the point at `offset`.
    pub fn moved(&self, offset: [f32; 3]) -> Self {
        let times = self.times(offset);
        Self {
            a: self.a,
            b: std::array::from_fn(|i| self.b[i] + times[i]),
            c: self.at(offset).max(0.0),
            weight: self.weight,
        }
    }
}

/// Weighted sum of squared differences between `K` attributes and their linear course over each triangle, as a function of
/// the offset and of the attributes' change.
#[derive(Debug, Clone, Copy)]
pub(super) struct AttributeQuadric<const K: usize> {
    /// The terms without the attributes' change; its weight is that of the triangles.
    pub base: Quadric,
    /// Weighted sums of the gradients, by coordinate.
    pub gradient: [[f32; K]; 3],
    /// Weighted sums of the differences at the point.
    pub difference: [f32; K],
}

impl<const K: usize> Default for AttributeQuadric<K> {
    fn default() -> Self {
        Self {
            base: Quadric::default(),
            gradient: [[0.0; K]; 3],
            difference: [0.0; K],
        }
    }
}

impl<const K: usize> AttributeQuadric<K> {
    /// Of one triangle, relative to any of its corners. `duals` are the vectors whose products with the two edges from the
    /// first corner are 1 and 0, and 0 and 1; `steps` the attributes' change along these edges.
    pub fn triangle(duals: [[f32; 3]; 2], steps: [[f32; K]; 2], weight: f32) -> Self {
        let mut quadric = Self::default();
        let gradient: [[f32; K]; 3] = std::array::from_fn(|axis| {
            std::array::from_fn(|k| steps[0][k] * duals[0][axis] + steps[1][k] * duals[1][axis])
        });
        let product = |i: usize, j: usize| -> f32 {
            (0..K).map(|k| gradient[i][k] * gradient[j][k]).sum::<f32>() * weight
        };
        quadric.base.a = [
            product(0, 0),
            product(1, 1),
            product(2, 2),
            product(0, 1),
            product(0, 2),
            product(1, 2),
        ];
        quadric.base.weight = weight;
        quadric.gradient = gradient.map(|row| row.map(|value| value * weight));
        quadric
    }

    pub fn add(&mut self, other: &Self) {
        self.base.add(&other.base);
        for axis in 0..3 {
            for k in 0..K {
                self.gradient[axis][k] += other.gradient[axis][k];
            }
        }
        for k in 0..K {
            self.difference[k] += other.difference[k];
        }
    }

    /// Weighted sums of the attributes' linear courses at an offset.
    fn courses(&self, offset: [f32; 3]) -> [f32; K] {
        std::array::from_fn(|k| {
            self.gradient[0][k] * offset[0]
                + self.gradient[1][k] * offset[1]
                + self.gradient[2][k] * offset[2]
                + self.difference[k]
        })
    }

    /// Value at an offset where the attributes change by `change`.
    pub fn at(&self, offset: [f32; 3], change: &[f32; K]) -> f32 {
        let courses = self.courses(offset);
        let (mut mixed, mut square) = (0.0, 0.0);
        for k in 0..K {
            mixed += change[k] * courses[k];
            square += change[k] * change[k];
        }
        self.base.at(offset) - 2.0 * mixed + self.base.weight * square
    }

    /// The same quadric relative to the point at `offset` with the attributes changed.
    pub fn moved(&self, offset: [f32; 3], change: &[f32; K]) -> Self {
        let courses = self.courses(offset);
        let mut moved = *self;
        moved.base.c = self.at(offset, change).max(0.0);
        let times = self.base.times(offset);
        for axis in 0..3 {
            let mixed: f32 = (0..K).map(|k| self.gradient[axis][k] * change[k]).sum();
            moved.base.b[axis] = self.base.b[axis] + times[axis] - mixed;
        }
        for k in 0..K {
            moved.difference[k] = courses[k] - self.base.weight * change[k];
        }
        moved
    }

    /// The attributes' change that costs least at an offset.
    pub fn best_change(&self, offset: [f32; 3]) -> [f32; K] {
        if self.base.weight <= 0.0 {
            return [0.0; K];
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
        let product = |i: usize, j: usize| -> f32 {
            (0..K)
                .map(|k| self.gradient[i][k] * self.gradient[j][k])
                .sum::<f32>()
                * over
        };
        for (entry, (i, j)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
            .into_iter()
            .enumerate()
        {
            quadric.a[entry] -= product(i, j);
        }
        for axis in 0..3 {
            let mixed: f32 = (0..K)
                .map(|k| self.gradient[axis][k] * self.difference[k])
                .sum();
            quadric.b[axis] -= mixed * over;
        }
        quadric
    }
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
        let sum = std::array::from_fn(|axis| offset[axis] + more[axis]);
        assert!((moved.at(more) - expected(sum)).abs() < 1e-6);

        // Attributes over the plane z = 0: the first is x, the second 2y.
        let duals = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let own = AttributeQuadric::<2>::triangle(duals, [[1.0, 0.0], [0.0, 2.0]], 0.5);
        let value = |x: [f32; 3], s: [f32; 2]| -> f32 {
            0.5 * ((x[0] - s[0]).powi(2) + (2.0 * x[1] - s[1]).powi(2))
        };
        let change = [0.2, -0.1];
        assert!((own.at(offset, &change) - value(offset, change)).abs() < 1e-6);
        let moved = own.moved(offset, &change);
        let further = [change[0] + 0.4, change[1] + 0.3];
        assert!((moved.at(more, &[0.4, 0.3]) - value(sum, further)).abs() < 1e-6);
        // Where the attributes follow, a linear course costs nothing.
        let best = own.best_change(offset);
        assert!(own.at(offset, &best).abs() < 1e-6);
        assert!(own.following().at(offset).abs() < 1e-6);
    }
}
