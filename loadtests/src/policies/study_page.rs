//! A study as one self-contained page: curves over the pool size, then every figure.

use std::fmt::Write;

use super::study::{Run, Study};
use crate::report::{Plot, Series, escape, number};

/// A figure of a run.
type Figure = fn(&Run) -> Option<f64>;

/// Title and label of each plot, and what it shows.
const PLOTS: [(&str, &str, Figure); 4] = [
    (
        "Error-time integral",
        "pixel seconds above the goal",
        |run| Some(run.error_seconds),
    ),
    ("Faults", "faults", |run| Some(run.faults as f64)),
    ("Bytes fetched", "bytes", |run| {
        Some(run.bytes_fetched as f64)
    }),
    ("Time to detail, 95 %", "seconds", |run| {
        run.time_to_detail_secs.map(|waits| waits.p95)
    }),
];

/// Headings and cells of the table.
const COLUMNS: [(&str, Figure); 10] = [
    ("pool MiB", |run| Some(mebibytes(run))),
    ("requests", |run| Some(run.requests as f64)),
    ("faults", |run| Some(run.faults as f64)),
    ("fault rate", |run| Some(run.fault_rate)),
    ("bytes fetched", |run| Some(run.bytes_fetched as f64)),
    ("evictions", |run| Some(run.evictions as f64)),
    ("error seconds", |run| Some(run.error_seconds)),
    ("total error seconds", |run| Some(run.total_error_seconds)),
    ("detail p50 s", |run| {
        run.time_to_detail_secs.map(|waits| waits.p50)
    }),
    ("detail p95 s", |run| {
        run.time_to_detail_secs.map(|waits| waits.p95)
    }),
];

fn mebibytes(run: &Run) -> f64 {
    run.pool_bytes as f64 / f64::from(1 << 20)
}

/// The page.
pub fn page(study: &Study) -> String {
    let mut html = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Eviction policies: {scene}</title>\
         <style>{STYLE}</style><h1>Eviction policies: {scene}</h1><p>{} frames at {} a second, {} viewers, {} Mbps, {} ms; \
         {} pages wanted in all, at most {} at once.</p>",
        study.trace.frames,
        study.trace.fps,
        study.viewers,
        study.link.bandwidth_mbps,
        study.link.latency_ms,
        study.trace.distinct_pages_wanted,
        study.trace.most_pages_wanted_at_once,
        scene = escape(&study.trace.scene),
    );
    for (title, label, figure) in PLOTS {
        let plot = Plot {
            title: title.to_owned(),
            x_label: "pool, MiB".to_owned(),
            y_label: label.to_owned(),
            logarithmic: [true, false],
            series: series(&study.runs, figure),
        };
        html += &plot.svg();
    }
    html += &table(&study.runs);
    html += "</html>\n";
    html
}

/// A curve a policy, over the pool size.
fn series(runs: &[Run], figure: Figure) -> Vec<Series> {
    let mut all: Vec<Series> = Vec::new();
    for run in runs {
        let Some(value) = figure(run) else { continue };
        let point = (mebibytes(run), value);
        match all.iter_mut().find(|series| series.name == run.policy) {
            Some(series) => series.points.push(point),
            None => all.push(Series {
                name: run.policy.clone(),
                points: vec![point],
            }),
        }
    }
    for series in &mut all {
        series.points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    all
}

fn table(runs: &[Run]) -> String {
    let heads: String = COLUMNS
        .iter()
        .map(|(head, _)| format!("<th>{head}</th>"))
        .collect();
    let mut html = format!("<table><tr><th>policy</th>{heads}</tr>");
    for run in runs {
        let cells = COLUMNS
            .iter()
            .map(|(_, figure)| figure(run).map_or("–".to_owned(), number));
        let cells: String = cells.map(|cell| format!("<td>{cell}</td>")).collect();
        // Writing to a string cannot fail.
        let _ = write!(html, "<tr><td>{}</td>{cells}</tr>", escape(&run.policy));
    }
    html + "</table>"
}

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;color:#222;max-width:1000px;margin:24px auto}\
figure{display:inline-block;width:470px;margin:8px;vertical-align:top}svg{width:100%}svg text{font-size:11px;fill:#444}\
svg .t{font-size:13px;font-weight:600}svg .x{text-anchor:middle}svg .y{text-anchor:end}svg .g{stroke:#e6e6e6}\
.k{margin:0 10px;white-space:nowrap;font-size:12px}.k i{display:inline-block;width:10px;height:10px;margin-right:5px}\
table{border-collapse:collapse}td,th{border:1px solid #ddd;padding:3px 9px;text-align:right}\
td:first-child,th:first-child{text-align:left}";
