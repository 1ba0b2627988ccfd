//! Stability: a row a stiff or extreme case. Files `stability-*.json`, which `stability` writes.

use super::Runs;
use super::sections::{json_table, rows, section as titled};

const COLUMNS: [(&str, &str); 20] = [
    ("case", "case"),
    ("input", "note"),
    ("triangles", "triangles"),
    ("levels", "levels"),
    ("root clusters", "root_clusters"),
    ("open edges of the source", "source_open_edges"),
    ("opened by a cut, at most", "opened_edges"),
    ("grid step, m", "step_metres"),
    ("moved by the grid, m", "grid_metres"),
    ("stated for that, m", "grid_stated_metres"),
    ("worst level from the input / stated", "level_excess"),
    ("groups measured", "measured"),
    ("share bounded", "bounded_share"),
    ("worst measured / stored", "worst_excess"),
    ("below a step", "below_step"),
    ("stored / measured, median", "ratio_p50"),
    ("95th percentile", "ratio_p95"),
    ("build s", "build_secs"),
    ("outcome", "outcome"),
    ("does not hold", "faults"),
];

const CLAIMS: [(&str, &str); 5] = [
    ("case", "case"),
    ("reference", "reference"),
    ("expected", "expected"),
    ("found", "found"),
    ("holds", "holds"),
];

pub(super) fn section(runs: &Runs) -> String {
    let all = runs.of("stability").flat_map(|run| rows(run, "rows"));
    let claims = runs.of("stability").flat_map(|run| rows(run, "claims"));
    titled(
        "Stability",
        "Stiff and extreme inputs. Reference: distances in f64, both ways, between what replaces a group and the source below it.",
        json_table(all, &COLUMNS) + &json_table(claims, &CLAIMS),
    )
}
