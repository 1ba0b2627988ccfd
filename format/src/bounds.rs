//! Conservative bounds: a merge never loses a point, whatever the rounding.

/// A sphere in local space (metres from the asset's centre).
#[derive(Debug, Clone, Copy, PartialEq, Default, bincode::Encode, bincode::Decode)]
pub struct Sphere {
    /// Centre, metres.
    pub center: [f32; 3],
    /// Radius, metres.
    pub radius: f32,
}

impl Sphere {
    /// The smallest sphere found that contains all of `spheres`, rounded up so that containment holds in f32.
    ///
    /// Starts from the centre of the bounding box and moves the centre towards the farthest sphere
    /// (Bădoiu and Clarkson, "Smaller core-sets for balls", 2003), then takes the exact largest reach.
    pub fn enclosing(spheres: &[Sphere]) -> Sphere {
        let Some(first) = spheres.first() else {
            return Sphere::default();
        };
        if spheres.len() == 1 {
            return *first;
        }
        let (mut low, mut high) = ([f64::MAX; 3], [f64::MIN; 3]);
        for sphere in spheres {
            for axis in 0..3 {
                low[axis] = low[axis].min(sphere.center[axis] as f64 - sphere.radius as f64);
                high[axis] = high[axis].max(sphere.center[axis] as f64 + sphere.radius as f64);
            }
        }
        let mut center: [f64; 3] = std::array::from_fn(|axis| 0.5 * (low[axis] + high[axis]));
        let reach =
            |center: &[f64; 3], sphere: &Sphere| distance(center, sphere) + sphere.radius as f64;
        for step in 1..=32 {
            let Some(farthest) = spheres
                .iter()
                .max_by(|a, b| reach(&center, a).total_cmp(&reach(&center, b)))
            else {
                break;
            };
            let length = distance(&center, farthest);
            if length > 0.0 {
                // Moves towards the far end of the farthest sphere, ever less.
                let pull = (length + farthest.radius as f64) / length / (step + 1) as f64;
                for axis in 0..3 {
                    center[axis] += (farthest.center[axis] as f64 - center[axis]) * pull.min(1.0);
                }
            }
        }
        let center = center.map(|value| value as f32);
        let wide = center.map(f64::from);
        let radius = spheres
            .iter()
            .map(|sphere| reach(&wide, sphere))
            .fold(0.0, f64::max);
        Sphere {
            center,
            radius: round_up(radius * (1.0 + 1e-6)),
        }
    }

    /// A sphere around `points` (local metres), rounded up.
    pub fn around(points: impl Iterator<Item = [f32; 3]> + Clone) -> Sphere {
        let spheres: Vec<_> = points
            .map(|center| Sphere {
                center,
                radius: 0.0,
            })
            .collect();
        Sphere::enclosing(&spheres)
    }

    /// Whether `other` lies inside, exactly in f64.
    pub fn contains(&self, other: &Sphere) -> bool {
        distance(&self.center.map(f64::from), other) + other.radius as f64 <= self.radius as f64
    }
}

fn distance(center: &[f64; 3], sphere: &Sphere) -> f64 {
    (0..3)
        .map(|axis| (center[axis] - sphere.center[axis] as f64).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// The smallest f32 not below `value`.
pub fn round_up(value: f64) -> f32 {
    let rounded = value as f32;
    if (rounded as f64) < value {
        rounded.next_up()
    } else {
        rounded
    }
}

/// An axis-aligned box in local space, metres.
#[derive(Debug, Clone, Copy, PartialEq, bincode::Encode, bincode::Decode)]
pub struct Aabb {
    /// Smallest corner.
    pub min: [f32; 3],
    /// Largest corner.
    pub max: [f32; 3],
}

impl Aabb {
    /// Contains nothing; the neutral element of [`Aabb::merge`].
    pub const EMPTY: Aabb = Aabb {
        min: [f32::MAX; 3],
        max: [f32::MIN; 3],
    };

    /// The smallest box around both.
    pub fn merge(&self, other: &Aabb) -> Aabb {
        Aabb {
            min: std::array::from_fn(|axis| self.min[axis].min(other.min[axis])),
            max: std::array::from_fn(|axis| self.max[axis].max(other.max[axis])),
        }
    }

    /// Whether `other` lies inside.
    pub fn contains(&self, other: &Aabb) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.min[axis] && other.max[axis] <= self.max[axis])
    }

    /// Middle of the box, metres.
    pub fn center(&self) -> [f32; 3] {
        std::array::from_fn(|axis| 0.5 * (self.min[axis] + self.max[axis]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sphere() -> impl Strategy<Value = Sphere> {
        (prop::array::uniform3(-1e4f32..1e4), 0.0f32..1e3)
            .prop_map(|(center, radius)| Sphere { center, radius })
    }

    proptest! {
        #[test]
        fn enclosing_contains_all(spheres in prop::collection::vec(sphere(), 1..40)) {
            let outer = Sphere::enclosing(&spheres);
            for inner in &spheres {
                prop_assert!(outer.contains(inner), "{outer:?} {inner:?}");
            }
        }
    }
}
