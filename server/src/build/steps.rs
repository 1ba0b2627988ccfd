//! How fine the grids are.

use lodestream_format::grid::Grid;
use lodestream_format::limits::MAX_EXTENT_STEPS;

use super::error::BuildError;
use super::survey::Survey;

/// Step of the position grid.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum PositionStep {
    /// From the mesh: about 64 steps to an edge, and 2^14 or more to the mesh.
    #[default]
    Auto,
    /// Metres, rounded down to a power of two; coarser where the mesh would span more than 2^23 steps.
    Metres(f64),
}

/// A step as it is asked for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted {
    pub step: PositionStep,
    /// That of the grid which the mesh shares with its neighbours; for [`PositionStep::Auto`].
    pub shared_exponent: Option<i32>,
}

/// Steps that a mesh spans unless short edges ask for more.
const USUAL_EXTENT_STEPS: f64 = (1 << 20) as f64;
/// Steps that a mesh spans at least: four to a pixel where it fills a picture of 4096 pixels.
const LEAST_EXTENT_STEPS: f64 = (1 << 14) as f64;
/// The same for a small mesh, whose bytes do not matter.
const SMALL_EXTENT_STEPS: f64 = (1 << 16) as f64;
/// Triangles of a small mesh at most.
const SMALL_TRIANGLES: u64 = 4096;
/// Steps that a mesh may span. Two less than the format's limit: both ends round.
pub const MOST_EXTENT_STEPS: f64 = (MAX_EXTENT_STEPS - 2) as f64;
/// Steps of the texture grid that a mesh spans at most, so that offsets in a cluster fit 24 bits.
pub(super) const MOST_UV_STEPS: i64 = (1 << 23) - 2;
/// Usual step of the texture grid: half a texel of a 4096 texture.
const UV_STEP_EXPONENT: i32 = -13;

/// Chooses the position grid, see [`PositionStep`].
///
/// Auto takes a 64th of the typical (geometric mean) edge or a 16th of the tenth-shortest-in-a-hundred one, the finer of
/// the two, so that small detail beside large triangles keeps its shape; at most 2^20 steps over the whole mesh as long
/// as short edges still span four steps, and never more than 2^23. The mesh spans at least 2^14
/// steps, so that rounding stays below a pixel wherever the mesh fits a picture, and a small mesh
/// 2^16.
pub(super) fn position_grid(
    name: &str,
    survey: &Survey,
    wanted: Wanted,
    warnings: &mut Vec<String>,
) -> Result<Grid, BuildError> {
    let (extent, largest) = (survey.extent(), survey.largest());
    // Grid indices from the origin stay far below 2^63, and local coordinates below 2^23.
    let coarsest_needed =
        ceil_log2(extent / MOST_EXTENT_STEPS).max(ceil_log2(largest / 2f64.powi(50)));
    if coarsest_needed > *Grid::EXPONENTS.end() {
        return Err(BuildError::TooLarge {
            mesh: name.to_owned(),
            extent_metres: extent,
        });
    }
    let step = wanted.step;
    let wanted = match step {
        PositionStep::Metres(metres) if metres > 0.0 && metres.is_finite() => floor_log2(metres),
        PositionStep::Metres(found) => return Err(BuildError::InvalidStep { found }),
        PositionStep::Auto => match wanted.shared_exponent {
            Some(exponent) => exponent,
            None => auto(survey),
        },
    };
    let exponent = wanted
        .max(coarsest_needed)
        .clamp(*Grid::EXPONENTS.start(), *Grid::EXPONENTS.end());
    if exponent != wanted && step != PositionStep::Auto {
        warnings.push(format!(
            "mesh {name:?}: position step 2^{wanted} metres became 2^{exponent} to span {extent} metres"
        ));
    }
    Ok(Grid::new(exponent)?)
}

/// Exponent of the step of a mesh on its own.
pub(super) fn auto(survey: &Survey) -> i32 {
    let (edges, extent, largest) = (&survey.edges, survey.extent(), survey.largest());
    if edges.is_empty() {
        // Nothing has a size; f32's own spacing at the place is as fine as anything can be.
        return if largest > 0.0 {
            floor_log2(largest) - 23
        } else {
            -20
        };
    }
    let typical = (edges.iter().map(|edge| edge.ln()).sum::<f64>() / edges.len() as f64).exp();
    let short = edges[edges.len() / 10];
    let wanted = floor_log2((typical / 64.0).min(short / 16.0));
    let usual = ceil_log2(extent / USUAL_EXTENT_STEPS);
    let of_edges = wanted.max(usual.min(floor_log2(short / 4.0)));
    let least = match survey.triangles <= SMALL_TRIANGLES {
        true => SMALL_EXTENT_STEPS,
        false => LEAST_EXTENT_STEPS,
    };
    of_edges.min(floor_log2(extent / least))
}

/// Chooses the texture grid: 2^-13, coarser where the range needs it.
pub(super) fn uv_grid(survey: &Survey) -> Grid {
    let (low, high) = (survey.uv_low, survey.uv_high);
    let mut step_exponent = UV_STEP_EXPONENT;
    for axis in 0..2 {
        if low[axis] <= high[axis] {
            let range = high[axis] - low[axis];
            let largest = low[axis].abs().max(high[axis].abs());
            step_exponent = step_exponent
                .max(ceil_log2(range / MOST_UV_STEPS as f64))
                .max(ceil_log2(largest / 2f64.powi(30)));
        }
    }
    Grid {
        step_exponent: step_exponent.min(*Grid::EXPONENTS.end()),
    }
}

fn floor_log2(value: f64) -> i32 {
    value.log2().floor() as i32
}

/// The smallest exponent whose power of two is not below `value`; `i32::MIN` for 0.
fn ceil_log2(value: f64) -> i32 {
    value.log2().ceil() as i32
}
