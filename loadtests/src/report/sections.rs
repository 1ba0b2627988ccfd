//! The sections of the page, each a function of all runs; an empty string where its files are missing.

use std::fmt::Write;

use super::{
    Plot, Run, Runs, Series, builders, escape, judges, number, pages, passes, sheets, stability,
};

/// The sections in order.
pub(super) const ALL: [fn(&Runs) -> String; 13] = [
    pictures,
    build,
    builders::section,
    judges::section,
    pages::section,
    stability::section,
    sheets::section,
    draw,
    passes::section_of,
    stream,
    pool,
    load,
    left_out,
];

pub(super) fn section(title: &str, note: &str, body: String) -> String {
    if body.is_empty() {
        return String::new();
    }
    format!(
        "<h2>{}</h2><p class=\"note\">{}</p>{body}",
        escape(title),
        escape(note)
    )
}

/// A table of JSON rows by `columns` (heading, key); left out without rows.
pub(super) fn json_table<'a>(
    rows: impl Iterator<Item = &'a serde_json::Value>,
    columns: &[(&str, &str)],
) -> String {
    let mut body = String::new();
    for row in rows {
        let cells = columns.iter().map(|(_, key)| json_cell(&row[*key]));
        let cells = cells.map(|cell| format!("<td>{}</td>", escape(&cell)));
        let _ = write!(body, "<tr>{}</tr>", cells.collect::<String>());
    }
    if body.is_empty() {
        return body;
    }
    let heads = columns
        .iter()
        .map(|(head, _)| format!("<th>{}</th>", escape(head)));
    format!(
        "<table><tr>{}</tr>{body}</table>",
        heads.collect::<String>()
    )
}

fn json_cell(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::Null => "–".into(),
        serde_json::Value::String(text) => text.clone(),
        serde_json::Value::Array(all) => all.iter().map(json_cell).collect::<Vec<_>>().join("; "),
        serde_json::Value::Number(whole) if !whole.is_f64() => whole.to_string(),
        value => value.as_f64().map_or_else(|| value.to_string(), number),
    }
}

/// A table of `columns` (heading, cell); left out without rows.
fn table<'a>(
    runs: impl Iterator<Item = &'a Run>,
    columns: &[(&str, &dyn Fn(&Run) -> Option<String>)],
) -> String {
    let mut rows = String::new();
    for run in runs {
        let _ = write!(rows, "<tr><td>{}</td>", escape(&run.name));
        for (_, cell) in columns {
            let _ = write!(
                rows,
                "<td>{}</td>",
                cell(run).map_or("–".into(), |text| escape(&text))
            );
        }
        rows += "</tr>";
    }
    if rows.is_empty() {
        return rows;
    }
    let heads: String = columns
        .iter()
        .map(|(head, _)| format!("<th>{}</th>", escape(head)))
        .collect();
    format!("<table><tr><th>run</th>{heads}</tr>{rows}</table>")
}

fn at<'a>(path: &'a [&'a str]) -> impl Fn(&Run) -> Option<String> + 'a {
    move |run| run.number(path).map(number)
}

pub(super) fn plot(
    title: &str,
    labels: [&str; 2],
    logarithmic: [bool; 2],
    series: Vec<Series>,
) -> String {
    Plot {
        title: title.into(),
        x_label: labels[0].into(),
        y_label: labels[1].into(),
        logarithmic,
        series,
    }
    .svg()
}

fn pictures(runs: &Runs) -> String {
    let body = runs.pictures().iter().map(|file| {
        let name = escape(file);
        format!("<figure><a href=\"{name}\"><img src=\"{name}\" alt=\"{name}\"></a><figcaption>{name}</figcaption></figure>")
    });
    section(
        "Pictures",
        "Drawn by this program from pages streamed over HTTP.",
        body.collect(),
    )
}

fn build(runs: &Runs) -> String {
    let errors = runs.of("build").map(|run| Series {
        name: run.name.clone(),
        points: rows(run, "levels_table")
            .filter_map(|row| {
                Some((
                    row.get("triangles")?.as_f64()?,
                    row.get("error_max")?.as_f64()?,
                ))
            })
            .collect(),
    });
    let mut body = table(
        runs.of("build"),
        &[
            ("input triangles", &at(&["input_triangles"])),
            ("build s", &at(&["seconds", "build"])),
            ("triangles a s", &|run| {
                Some(number(
                    run.number(&["input_triangles"])? / run.number(&["seconds", "build"])?,
                ))
            }),
            ("levels", &at(&["levels"])),
            ("triangles a cluster", &at(&["cluster_fill"])),
            (
                "stored bytes an input triangle",
                &at(&["bytes_per_input_triangle"]),
            ),
            ("a DAG triangle", &at(&["bytes_per_dag_triangle"])),
            ("peak MB", &|run| {
                Some(number(run.number(&["peak_rss_bytes"])? / 1e6))
            }),
        ],
    );
    body += &plot(
        "Stored error a level",
        ["triangles of the level", "error, metres"],
        [true, true],
        errors.collect(),
    );
    section(
        "Build",
        "Error of each level against its triangles; time and bytes.",
        body,
    )
}

pub(super) fn rows<'a>(run: &'a Run, key: &str) -> impl Iterator<Item = &'a serde_json::Value> {
    run.json
        .get(key)
        .and_then(|rows| rows.as_array())
        .into_iter()
        .flatten()
}

/// Runs named `SCENE@KNOB` as curves over the knob, a curve a scene.
fn curves<'a>(
    runs: impl Iterator<Item = &'a Run>,
    value: impl Fn(&Run) -> Option<f64>,
) -> Vec<Series> {
    let mut series: Vec<Series> = Vec::new();
    for run in runs {
        let Some((scene, knob)) = run.name.split_once('@') else {
            continue;
        };
        let (Ok(knob), Some(value)) = (knob.parse::<f64>(), value(run)) else {
            continue;
        };
        match series.iter_mut().find(|known| known.name == scene) {
            Some(known) => known.points.push((knob, value)),
            None => series.push(Series {
                name: scene.into(),
                points: vec![(knob, value)],
            }),
        }
    }
    for curve in &mut series {
        curve.points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    series
}

fn draw(runs: &Runs) -> String {
    let mut body = plot(
        "Image error over pixel error",
        ["pixel error, px", "PSNR against full detail, dB"],
        [true, false],
        curves(runs.of("compare"), |run| run.number(&["psnr_db"])),
    );
    body += &plot(
        "Triangles drawn over pixel error",
        ["pixel error, px", "triangles"],
        [true, true],
        curves(runs.of("draw"), |run| run.number(&["drawn", "triangles"])),
    );
    body += &plot(
        "Time of a frame over pixel error",
        ["pixel error, px", "median frame, ms"],
        [true, true],
        curves(runs.of("draw"), |run| run.number(&["frame_ms", "p50"])),
    );
    body += &plot(
        "Bytes fetched over pixel error",
        ["pixel error, px", "bytes"],
        [true, true],
        curves(runs.of("draw"), |run| run.number(&["bytes_fetched"])),
    );
    body += &table(
        runs.of("draw"),
        &[
            ("triangles drawn", &at(&["drawn", "triangles"])),
            ("clusters", &at(&["drawn", "clusters"])),
            ("points", &at(&["drawn", "points"])),
            ("hidden clusters", &at(&["drawn", "hidden_clusters"])),
            ("settled s", &at(&["settled_secs"])),
            ("MB fetched", &|run| {
                Some(number(run.number(&["bytes_fetched"])? / 1e6))
            }),
            ("shown px", &at(&["pixel_error_shown"])),
            ("frame ms p50", &at(&["frame_ms", "p50"])),
        ],
    );
    body += &table(
        runs.of("compare"),
        &[
            ("PSNR dB", &at(&["psnr_db"])),
            ("PSNR where covered dB", &at(&["psnr_covered_db"])),
            ("covered px", &at(&["covered_px"])),
            ("coverage differs px", &at(&["coverage_differs_px"])),
            ("share of the picture, %", &|run| {
                Some(number(100.0 * run.number(&["coverage_differs_share"])?))
            }),
        ],
    );
    section(
        "Draw",
        "Against the full-detail reference of the same camera.",
        body,
    )
}

fn stream(runs: &Runs) -> String {
    let error = runs.of("play").map(|run| Series {
        name: run.name.clone(),
        points: rows(run, "timeline")
            .filter_map(|row| {
                Some((
                    row.get("secs")?.as_f64()?,
                    row.get("pixel_error_shown")?.as_f64()?,
                ))
            })
            .collect(),
    });
    let body = plot(
        "Shown pixel error over time",
        ["seconds of the path", "pixel error, px"],
        [false, true],
        error.collect(),
    );
    let table = table(
        runs.of("play"),
        &[
            ("frames", &at(&["frames"])),
            ("pages fetched", &at(&["pages_fetched"])),
            ("MB fetched", &|run| {
                Some(number(run.number(&["bytes_fetched"])? / 1e6))
            }),
            ("pages evicted", &at(&["pages_evicted"])),
            ("frame ms p50", &at(&["frame_ms", "p50"])),
            ("p99", &at(&["frame_ms", "p99"])),
        ],
    );
    section("Stream", "Camera paths played over HTTP.", body + &table)
}

fn pool(runs: &Runs) -> String {
    let mut body = String::new();
    for run in runs.of("policies") {
        let curve = |key: &str| {
            let mut series: Vec<Series> = Vec::new();
            for row in rows(run, "runs") {
                let field = |key: &str| row.get(key).and_then(|value| value.as_f64());
                let (Some(name), Some(pool), Some(value)) = (
                    row.get("policy").and_then(|name| name.as_str()),
                    field("pool_bytes"),
                    field(key),
                ) else {
                    continue;
                };
                let point = (pool / 1048576.0, value);
                match series.iter_mut().find(|known| known.name == name) {
                    Some(known) => known.points.push(point),
                    None => series.push(Series {
                        name: name.into(),
                        points: vec![point],
                    }),
                }
            }
            series
        };
        for (title, key, unit) in [
            (
                "Error-time integral",
                "error_seconds",
                "pixel seconds above the goal",
            ),
            ("Faults", "faults", "faults"),
            ("Bytes fetched", "bytes_fetched", "bytes"),
        ] {
            body += &plot(
                &format!("{title}: {}", run.name),
                ["pool, MiB", unit],
                [true, false],
                curve(key),
            );
        }
    }
    section(
        "Pool",
        "Eviction policies on one trace, beside the clairvoyant bound.",
        body,
    )
}

fn load(runs: &Runs) -> String {
    let body = table(
        runs.of("load"),
        &[
            ("viewers", &at(&["viewers"])),
            ("requests a s", &at(&["requests_per_second"])),
            ("MB a s", &|run| {
                Some(number(run.number(&["bytes_per_second"])? / 1e6))
            }),
            ("errors", &at(&["errors"])),
            ("latency ms p50", &at(&["latency_ms", "p50"])),
            ("p99", &at(&["latency_ms", "p99"])),
            ("max", &at(&["latency_ms", "max"])),
            ("settled s p95", &at(&["settled_secs", "p95"])),
        ],
    );
    section(
        "Load",
        "Virtual viewers against one server, all on this machine.",
        body,
    )
}

fn left_out(runs: &Runs) -> String {
    let list = |run: &Run, key: &str| -> Option<String> {
        Some(
            run.json
                .get(key)?
                .as_array()?
                .iter()
                .filter_map(|name| name.as_str())
                .collect::<Vec<_>>()
                .join(", "),
        )
    };
    let body = table(
        runs.of("draw"),
        &[
            ("passes recorded", &|run| list(run, "passes_recorded")),
            ("pipelines built", &|run| list(run, "pipelines_built")),
        ],
    );
    section(
        "Left out",
        "What each scene needed; every other pass and pipeline was not built.",
        body,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_join_runs_of_a_scene_in_the_order_of_the_knob() {
        let run = |name: &str, value: f64| Run {
            name: name.into(),
            json: serde_json::json!({ "psnr_db": value }),
        };
        let runs = [
            run("rock@4", 30.0),
            run("rock@1", 45.0),
            run("no knob", 1.0),
        ];
        let series = curves(runs.iter(), |run| run.number(&["psnr_db"]));
        assert_eq!(
            series,
            vec![Series {
                name: "rock".into(),
                points: vec![(1.0, 45.0), (4.0, 30.0)]
            }]
        );
    }

    #[test]
    fn sections_without_runs_are_left_out() {
        assert!(
            ALL.iter()
                .all(|section| section(&Runs::default()).is_empty())
        );
    }
}
