//! Local origin: a mesh far from the origin keeps its shape in f32 when it is told from a point
//! near it. The instance carries the point, in f64.

use glam::{DAffine3, DVec3};

/// Extents that a mesh may lie away before its origin moves: up to there f32 keeps 2^-20 of them.
const FAR_EXTENTS: f64 = 16.0;
/// Steps on each side of zero that are exact in f32: those of its mantissa.
const STEPS: f64 = (1u32 << 24) as f64;

/// A box of positions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    least: DVec3,
    most: DVec3,
}

impl Bounds {
    pub(super) const EMPTY: Self = Self {
        least: DVec3::INFINITY,
        most: DVec3::NEG_INFINITY,
    };

    /// Those of `positions`.
    pub(super) fn of(positions: impl IntoIterator<Item = [f64; 3]>) -> Self {
        let mut bounds = Self::EMPTY;
        positions.into_iter().for_each(|it| bounds.add(it));
        bounds
    }

    /// Grows around `position`; one that a reader refuses or leaves out counts for nothing.
    pub(super) fn add(&mut self, position: [f64; 3]) {
        if is_finite(position) {
            self.least = self.least.min(position.into());
            self.most = self.most.max(position.into());
        }
    }
}

/// Whether a position has a place in f32.
pub(super) fn is_finite(position: [f64; 3]) -> bool {
    position.iter().all(|&it| (it as f32).is_finite())
}

/// The point that positions of a mesh are told from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Origin {
    /// On a grid of a power of two not below the mesh's extent, so that differences are exact;
    /// 0 along axes near which the mesh lies.
    at: DVec3,
    /// Step of moved positions, 2^-24 of that grid: exact in f32, so that equal places of meshes
    /// of like extent stay equal.
    step: f64,
}

impl Origin {
    /// For a mesh within `bounds`.
    pub(super) fn of(bounds: Bounds) -> Self {
        let extent = (bounds.most - bounds.least).max_element();
        // A point has no shape to lose; a subnormal extent is none.
        if !(extent.is_finite() && extent >= f64::MIN_POSITIVE) {
            return Self::default();
        }
        // The power of two above: the exponent one up, the mantissa cleared.
        const MANTISSA_BITS: u32 = 52;
        let grid = f64::from_bits(((extent.to_bits() >> MANTISSA_BITS) + 1) << MANTISSA_BITS);
        let far = bounds.least.abs().max(bounds.most.abs());
        let middle = (bounds.least + bounds.most) / 2.0;
        let at = |axis: usize| match far[axis] > FAR_EXTENTS * extent {
            true => (middle[axis] / grid).round() * grid,
            false => 0.0,
        };
        Self {
            at: DVec3::new(at(0), at(1), at(2)),
            step: grid / STEPS,
        }
    }

    /// `position` as the mesh has it.
    pub(super) fn local(&self, position: [f64; 3]) -> [f32; 3] {
        std::array::from_fn(|axis| match self.at[axis] == 0.0 {
            true => position[axis] as f32,
            false => {
                let steps = (position[axis] - self.at[axis]) / self.step;
                (steps.round_ties_even() * self.step) as f32
            }
        })
    }

    /// Where the mesh stands.
    pub(super) fn placement(&self) -> DAffine3 {
        DAffine3::from_translation(self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_near_the_origin_stay_as_they_are() {
        for positions in [
            vec![[0.1, 0.2, 0.3], [1.1, 2.2, 3.3]],
            vec![[15.0, 0.0, 0.0], [16.0, 0.0, 0.0]],
            vec![[1e6, 1e6, 1e6]],
            vec![],
            vec![[f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0], [1.25, 1e300, 0.0]],
        ] {
            let origin = Origin::of(Bounds::of(positions.iter().copied()));
            assert_eq!(origin.at, DVec3::ZERO, "{positions:?}");
            assert_eq!(origin.local([0.1, 1e-40, -3e38]), [0.1, 1e-40, -3e38]);
        }
    }

    /// UTM metres: the axes that are far move, by whole extents, and no place moves by more than a
    /// part in 2^25 of the grid.
    #[test]
    fn far_positions_keep_their_shape() {
        let place = |at: u32| {
            let at = f64::from(at);
            [
                456_789.123 + 0.2 * at,
                3.0 + at.sin(),
                -5_428_123.456 + 0.1 * at,
            ]
        };
        let origin = Origin::of(Bounds::of((0..100).map(place)));
        assert_eq!(origin.at, DVec3::new(456_800.0, 0.0, -5_428_128.0));
        for at in 0..100 {
            let local = origin.local(place(at)).map(f64::from);
            let back = DVec3::from(local) + origin.at;
            let off = (back - DVec3::from(place(at))).abs();
            let ulps = DVec3::new(1.0, 0.25, 1.0) * 32.0 * (-25f64).exp2();
            assert!(off.cmple(ulps + 1e-9).all(), "{off}");
        }
    }

    /// Two tiles with one border, told from different origins.
    #[test]
    fn equal_places_stay_equal_between_meshes() {
        let border = |at: u32| {
            [
                500_020.0,
                1.0 / f64::from(at + 1),
                4e6 + f64::from(at) / 7.0,
            ]
        };
        let tile = |x: f64| Bounds::of((0..100).flat_map(move |at| [border(at), [x, 0.0, 4e6]]));
        let (a, b) = (Origin::of(tile(500_000.3)), Origin::of(tile(500_039.1)));
        assert_ne!(a.at, b.at);
        for at in 0..100 {
            let world = |it: Origin| DVec3::from(it.local(border(at)).map(f64::from)) + it.at;
            assert_eq!(world(a), world(b));
        }
    }
}
