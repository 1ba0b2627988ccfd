//! Stability: a row a stiff or extreme case. Files `stability-*.json`, which `stability` writes.

use super::Runs;
use super::sections::{json_table, rows, section as titled};

const COLUMNS: [(&str, &str); 18] = [
    ("case", "case"),
    ("input", "note"),
    ("triangles", "triangles"),
    ("levels", "levels"),
    ("root clusters", "root_clusters"),
    ("open edges of the source", "source_open_edges"),
    ("opened by a cut, at most", "opened_edges"),
    ("grid step, m", "step_metres"),
    ("moved by the grid, m", "grid_metres"),
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

pub(super) fn section(runs: &Runs) -> String {
    let all = runs.of("stability").flat_map(|run| rows(run, "rows"));
    titled(
        "Stability",
        "Stiff and extreme inputs. Reference: distances in f64, both ways, between what replaces a group and the source below it.",
        json_table(all, &COLUMNS),
    )
}
