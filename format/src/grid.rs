//! The object-space grid that positions and texture coordinates quantize to.
//!
//! The step is a power of two and the grid is anchored at the object's origin, never at the bounds, so that
//! modular pieces with the same step meet without cracks.

use crate::error::FormatError;

/// A grid of step `2^step_exponent`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bincode::Encode, bincode::Decode)]
pub struct Grid {
    /// Base-two logarithm of the step (metres for positions, texture widths for texture coordinates).
    pub step_exponent: i32,
}

impl Grid {
    /// Smallest and largest exponents: steps and 2^23 of them stay normal f32 numbers.
    pub const EXPONENTS: std::ops::RangeInclusive<i32> = -100..=100;

    /// Checks the exponent.
    pub fn new(step_exponent: i32) -> Result<Self, FormatError> {
        if Self::EXPONENTS.contains(&step_exponent) {
            Ok(Self { step_exponent })
        } else {
            Err(FormatError::new(
                "grid step exponent",
                "-100..=100",
                step_exponent,
            ))
        }
    }

    /// The step itself; exact.
    pub fn step(self) -> f64 {
        2f64.powi(self.step_exponent)
    }

    /// The nearest grid index, ties to even; saturates at the i64 range, NaN gives 0.
    pub fn quantize(self, value: f64) -> i64 {
        (value / self.step()).round_ties_even() as i64
    }

    /// The coordinate of a grid index.
    pub fn dequantize(self, index: i64) -> f64 {
        index as f64 * self.step()
    }
}
