//! Build: against clusterlod, and error against build time over the knobs. Files `builders-*.json`, which `build` writes.

use serde_json::Value;

use super::sections::{json_table, plot, rows, section as titled};
use super::{Run, Runs, Series};

const COLUMNS: [(&str, &str); 19] = [
    ("input", "input"),
    ("builder", "builder"),
    ("threads", "threads"),
    ("triangles", "triangles"),
    ("build s", "build_secs"),
    ("M triangles a s", "mtris_per_sec"),
    ("a processor s", "mtris_per_cpu_sec"),
    ("with encoding s", "total_secs"),
    ("levels", "levels"),
    ("clusters", "clusters"),
    ("triangles a cluster", "fill"),
    ("level 0", "fill_source"),
    ("above", "fill_above"),
    ("root clusters", "root_clusters"),
    ("DAG / input", "dag_per_input"),
    ("most vertices", "max_vertices"),
    ("stored bytes a triangle", "stored_bytes_per_triangle"),
    ("peak bytes a triangle", "peak_bytes_per_triangle"),
    ("same bytes", "same_bytes"),
];

const EQUAL_COLUMNS: [(&str, &str); 7] = [
    ("input", "input"),
    ("levels, largest", "levels_at_max"),
    ("levels, rms", "levels_at_rms"),
    ("worst level, largest", "worst_level_at_max"),
    ("worst level, rms", "worst_level_at_rms"),
    ("uniform cuts, largest", "cuts_at_max"),
    ("uniform cuts, rms", "cuts_at_rms"),
];

const PROMISE_COLUMNS: [(&str, &str); 8] = [
    ("input", "input"),
    ("groups", "groups"),
    ("measured", "measured"),
    ("share bounded", "bounded_share"),
    ("worst measured / stored", "worst_excess"),
    ("below a grid step", "below_step"),
    ("stored / measured, median", "ratio_p50"),
    ("95th percentile", "ratio_p95"),
];

const EDGE_COLUMNS: [(&str, &str); 4] = [
    ("input", "input"),
    ("builder", "builder"),
    ("open in the source", "source_open_edges"),
    ("opened by a cut, at most", "opened_edges"),
];

const KNOB_COLUMNS: [(&str, &str); 8] = [
    ("input", "input"),
    ("knob", "knob"),
    ("setting", "setting"),
    ("build s", "build_secs"),
    ("with encoding s", "total_secs"),
    ("stored bytes a triangle", "stored_bytes_per_triangle"),
    ("largest distance, m", "max_metres"),
    ("rms, m", "rms_metres"),
];

pub(super) fn section(runs: &Runs) -> String {
    let runs: Vec<&Run> = runs.of("builders").collect();
    let table = |key: &str, columns| {
        let all = runs.iter().flat_map(|run| rows(run, key));
        json_table(all, columns)
    };
    let under = |heading: &str, body: String| match body.is_empty() {
        true => body,
        false => format!("<h3>{heading}</h3>{body}"),
    };
    let mut body = table("rows", &COLUMNS);
    body += &under(
        "Our triangles over clusterlod's at equal measured error (geometric means)",
        table("equal_error", &EQUAL_COLUMNS),
    );
    let errors = || runs.iter().flat_map(|run| rows(run, "errors"));
    for input in inputs(errors()) {
        body += &plot(
            &format!("Measured error a level: {input}"),
            ["triangles", "metres"],
            [true, true],
            level_curves(errors().filter(|row| row["input"] == input)),
        );
    }
    body += &under(
        "Our groups: stored against measured error",
        table("promises", &PROMISE_COLUMNS),
    );
    body += &under("Open edges", table("errors", &EDGE_COLUMNS));
    let knobs = || runs.iter().flat_map(|run| rows(run, "knobs"));
    let mut curves = String::new();
    for input in inputs(knobs()) {
        curves += &plot(
            &format!("Error against build time: {input}"),
            [
                "build and encode, s",
                "rms of a sixteenth of the triangles, m",
            ],
            [false, true],
            knob_curves(knobs().filter(|row| row["input"] == input)),
        );
    }
    body += &under("Knobs", curves + &table("knobs", &KNOB_COLUMNS));
    titled(
        "Build: against clusterlod",
        "Ours and meshoptimizer's clusterlod with its defaults, in one process in turns; medians. Memory in a process of its own. \
         Distances both ways in f64, 15 samples a triangle (of fewer triangles where an input is large).",
        body,
    )
}

/// Different inputs in the order of their rows.
fn inputs<'a>(rows: impl Iterator<Item = &'a Value>) -> Vec<String> {
    let mut inputs: Vec<String> = Vec::new();
    for row in rows {
        let input = row["input"].as_str().unwrap_or_default();
        if !inputs.iter().any(|known| known == input) {
            inputs.push(input.to_owned());
        }
    }
    inputs
}

/// Largest and mean square error of each builder.
fn level_curves<'a>(rows: impl Iterator<Item = &'a Value>) -> Vec<Series> {
    rows.flat_map(|row| {
        let builder = row["builder"].as_str().unwrap_or_default();
        [("largest", "max_metres"), ("rms", "rms_metres")].map(|(name, key)| {
            let levels = row["levels"].as_array().into_iter().flatten();
            Series {
                name: format!("{builder}, {name}"),
                points: levels
                    .filter_map(|cut| Some((cut["triangles"].as_f64()?, cut[key].as_f64()?)))
                    .collect(),
            }
        })
    })
    .collect()
}

/// A curve a knob.
fn knob_curves<'a>(rows: impl Iterator<Item = &'a Value>) -> Vec<Series> {
    let mut series: Vec<Series> = Vec::new();
    for row in rows {
        let point = row["total_secs"].as_f64().zip(row["rms_metres"].as_f64());
        let (Some(point), Some(knob)) = (point, row["knob"].as_str()) else {
            continue;
        };
        match series.iter_mut().find(|known| known.name == knob) {
            Some(known) => known.points.push(point),
            None => series.push(Series {
                name: knob.into(),
                points: vec![point],
            }),
        }
    }
    series
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn curves_are_by_builder_and_by_knob() {
        let errors = [
            json!({"builder": "a", "levels": [{"triangles": 8, "max_metres": 2.0, "rms_metres": 1.0}]}),
        ];
        let curves = level_curves(errors.iter());
        assert_eq!(curves.len(), 2);
        assert_eq!(
            (curves[1].name.as_str(), &curves[1].points[..]),
            ("a, rms", &[(8.0, 1.0)][..])
        );
        let knobs = [
            json!({"input": "i", "knob": "step", "total_secs": 1.0, "rms_metres": 0.5}),
            json!({"input": "i", "knob": "codec", "total_secs": 2.0, "rms_metres": 0.5}),
            json!({"input": "j", "knob": "step", "total_secs": 3.0, "rms_metres": null}),
        ];
        assert_eq!(knob_curves(knobs.iter()).len(), 2);
        assert_eq!(inputs(knobs.iter()), ["i", "j"]);
    }
}
