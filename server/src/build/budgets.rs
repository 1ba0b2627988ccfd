//! Budgets: the distance from the source that the groups of a round may reach.
//!
//! The first is the distance that half of the triangles cost in a few groups. Each next one is
//! chosen so that its round halves the triangles again: how the last one did says how fast they
//! fall with the distance.

use super::vertex::Grids;

/// Share of the first distance that the first budget is: some groups are finer than most.
const FIRST: f64 = 0.5;
/// Share of the triangles that a round should leave.
const WANTED_LEFT: f64 = 0.5;
/// Least and largest factor from one budget to the next.
const FACTORS: [f64; 2] = [1.5, 4.0];

/// Budgets of a build.
#[derive(Debug, Clone, Copy)]
pub(super) struct Budgets {
    metres: f64,
    factor: f64,
    /// Above this, any distance is allowed.
    most_metres: f64,
}

impl Budgets {
    /// `first_metres` is the first budget, `size_metres` the size of the mesh.
    pub fn new(grids: &Grids, first_metres: f64, size_metres: f64) -> Self {
        Self {
            metres: (FIRST * first_metres).max(grids.rounding_metres()),
            factor: 2.0,
            most_metres: size_metres,
        }
    }

    /// Budget of the next round, metres.
    pub fn metres(&self) -> f64 {
        match self.is_limited() {
            true => self.metres,
            false => f64::INFINITY,
        }
    }

    /// Whether some distance is too large.
    pub fn is_limited(&self) -> bool {
        self.metres < self.most_metres
    }

    /// Chooses the next budget after a round that left this share of the triangles.
    pub fn advance(&mut self, left: f64) {
        let falls = (1.0 / left.clamp(0.05, 0.999)).ln() / self.factor.ln();
        let wanted = ((1.0 / WANTED_LEFT).ln() / falls).exp();
        self.factor = wanted.clamp(FACTORS[0], FACTORS[1]);
        self.metres *= self.factor;
    }
}
