//! Pages: stored bytes against the error of the position grid, and what they are spent on. Files `pages-*.json`, which `pages` writes.

use serde_json::Value;

use super::sections::{json_table, plot, rows, section as titled};
use super::{Run, Runs, Series};

const COLUMNS: [(&str, &str); 14] = [
    ("input", "input"),
    ("bits", "bits"),
    ("placement", "placement"),
    ("error, pixels of 1000", "error_px"),
    ("triangles", "source_triangles"),
    ("stored bytes an input triangle", "stored_per_input"),
    ("a triangle of all levels", "stored_per_dag"),
    ("whole mesh, no levels", "whole_mesh_per_input"),
    ("memory form", "memory_per_dag"),
    ("slack", "slack"),
    ("vertices a triangle", "vertices_per_triangle"),
    ("own", "own_share"),
    ("repeated", "repeated_share"),
    ("inherited", "inherited_share"),
];

const PART_COLUMNS: [(&str, &str); 11] = [
    ("input", "input"),
    ("bits", "bits"),
    ("placement", "placement"),
    ("topology", "topology_bits"),
    ("references", "references_bits"),
    ("positions", "positions_bits"),
    ("normals", "normals_bits"),
    ("texture coordinates", "uvs_bits"),
    ("colours", "colors_bits"),
    ("metadata", "metadata_bits"),
    ("hierarchy", "hierarchy_bits"),
];

pub(super) fn section(runs: &Runs) -> String {
    let runs: Vec<&Run> = runs.of("pages").collect();
    let all = || runs.iter().flat_map(|run| rows(run, "rows"));
    let mut inputs: Vec<&str> = all().filter_map(|row| row["input"].as_str()).collect();
    inputs.sort_unstable();
    inputs.dedup();
    let mut body = String::new();
    for input in inputs {
        let own = || all().filter(|row| row["input"] == input);
        let curves = curves(own());
        if curves.iter().any(|curve| curve.points.len() > 2) {
            body += &plot(
                &format!("Bytes against the grid's error: {input}"),
                [
                    "half a step's diagonal, pixels of 1000",
                    "bytes an input triangle",
                ],
                [true, false],
                curves,
            );
        }
    }
    body += &json_table(all(), &COLUMNS);
    let parts = json_table(all(), &PART_COLUMNS);
    if !parts.is_empty() {
        body += &format!("<h3>Bits of a triangle of all levels</h3>{parts}");
    }
    titled(
        "Pages: what they cost",
        "All levels, hierarchy and page lists counted, beside level 0 alone as one mesh by meshoptimizer's codecs and zstd on the same grids.",
        body,
    )
}

/// A curve a placement, and one of the whole mesh.
fn curves<'a>(rows: impl Iterator<Item = &'a Value>) -> Vec<Series> {
    let mut curves: Vec<Series> = Vec::new();
    for row in rows.filter(|row| !row["bits"].is_null()) {
        let placement = row["placement"].as_str().unwrap_or_default();
        for (name, key) in [
            (placement, "stored_per_input"),
            ("whole mesh", "whole_mesh_per_input"),
        ] {
            let Some(point) = row["error_px"].as_f64().zip(row[key].as_f64()) else {
                continue;
            };
            match curves.iter_mut().find(|curve| curve.name == name) {
                Some(curve) if curve.points.contains(&point) => {}
                Some(curve) => curve.points.push(point),
                None => curves.push(Series {
                    name: name.into(),
                    points: vec![point],
                }),
            }
        }
    }
    curves
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_curve_a_placement_and_one_of_the_whole_mesh() {
        let row = |placement, error: f64, stored: f64| {
            json!({"bits": 10, "placement": placement, "error_px": error,
                "stored_per_input": stored, "whole_mesh_per_input": 1.0})
        };
        let rows = [
            row("optimal", 1.0, 4.0),
            row("optimal", 0.5, 5.0),
            row("subset", 1.0, 3.0),
        ];
        let curves = curves(rows.iter());
        let lengths: Vec<_> = curves
            .iter()
            .map(|it| (it.name.as_str(), it.points.len()))
            .collect();
        assert_eq!(lengths, [("optimal", 2), ("whole mesh", 2), ("subset", 1)]);
    }
}
