//! Promises that are no build of one mesh: expected, found, and whether they hold.

use serde::Serialize;

use super::pixels;

/// A row of the second table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Claim {
    /// Its row.
    pub case: String,
    /// The measure beside it.
    pub reference: String,
    /// The promise.
    pub expected: String,
    /// The measured figures.
    pub found: String,
    /// Whether the promise holds.
    pub holds: bool,
}

/// The claims whose names contain `named`.
pub(super) fn claims(named: &str) -> Vec<Claim> {
    let mut claims = pixels::claims();
    claims.retain(|claim| claim.case.contains(named));
    claims
}
