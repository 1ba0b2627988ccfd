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
        power_of_two(self.step_exponent)
    }

    /// Half the diagonal of a cell: a point is never farther from its grid point.
    pub fn rounding(self) -> f64 {
        // Upwards: the square root of 3 is a little larger than its f64.
        (0.75f64.sqrt() * self.step()).next_up()
    }

    /// The nearest grid index, ties to even; saturates at the i64 range, NaN gives 0.
    pub fn quantize(self, value: f64) -> i64 {
        // Both factors are powers of two: exact, and quicker than a division.
        round(value * power_of_two(-self.step_exponent)) as i64
    }

    /// The coordinate of a grid index.
    pub fn dequantize(self, index: i64) -> f64 {
        index as f64 * self.step()
    }
}

/// Exact for every exponent of [`Grid::EXPONENTS`], both signs.
fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((1023 + exponent) as u64) << 52)
}

/// The nearest whole number, the even one of two. Without an instruction for it the library's own takes longer than all else
/// that quantizes a vertex; adding what leaves no bits behind the point rounds likewise.
fn round(value: f64) -> f64 {
    const SHIFT: f64 = (3u64 << 51) as f64;
    if value.abs() < (1u64 << 51) as f64 {
        value + SHIFT - SHIFT
    } else {
        value.round_ties_even()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rounds_as_the_library_does(value in proptest::num::f64::NORMAL, halves in -1000i64..1000) {
            prop_assert_eq!(round(value), value.round_ties_even());
            let half = halves as f64 / 2.0;
            prop_assert_eq!(round(half), half.round_ties_even());
        }
    }

    #[test]
    fn steps_are_powers_of_two() {
        for exponent in Grid::EXPONENTS {
            assert_eq!(power_of_two(exponent), 2f64.powi(exponent));
        }
    }
}
