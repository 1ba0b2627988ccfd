//! GPU time of a frame by pass, over the pixel error.

use std::collections::BTreeSet;

use super::sections::{plot, section};
use super::{Run, Runs, Series};

/// Passes that a reader tells apart: a name and the beginnings of the spans that count to it.
const FAMILIES: [(&str, &[&str]); 6] = [
    ("cull", &["cull_", "late_cull_", "compact_requests"]),
    ("hzb", &["build_hzb"]),
    (
        "compute rasterizer",
        &["raster_compute", "late_raster_compute"],
    ),
    ("points", &["raster_points"]),
    (
        "hardware rasterizer",
        &["raster", "raster_masked", "late_raster", "raster_overdraw"],
    ),
    ("shade", &["shade"]),
];

/// A plot a scene: milliseconds of each family of passes.
pub(super) fn section_of(runs: &Runs) -> String {
    let scenes: BTreeSet<&str> = runs
        .of("draw")
        .filter_map(|run| run.name.split_once('@'))
        .map(|(scene, _)| scene)
        .collect();
    let plots = scenes.into_iter().map(|scene| {
        plot(
            &format!("{scene}: time of each pass over pixel error"),
            ["pixel error, px", "GPU ms of a frame"],
            [true, true],
            series(runs, scene),
        )
    });
    section(
        "Passes",
        "Medians of the drawn frames, on the adapter that the reports name. Both passes of a frame count.",
        plots.collect(),
    )
}

fn series(runs: &Runs, scene: &str) -> Vec<Series> {
    let families = FAMILIES.iter().map(|(name, _)| Series {
        name: (*name).to_owned(),
        points: points(runs, scene, name),
    });
    families
        .filter(|series| !series.points.is_empty())
        .collect()
}

fn points(runs: &Runs, scene: &str, family: &str) -> Vec<(f64, f64)> {
    let of_scene = runs.of("draw").filter_map(|run| {
        let (name, knob) = run.name.split_once('@')?;
        let knob: f64 = knob.parse().ok()?;
        let ms = milliseconds(run, family);
        (name == scene && ms > 0.0).then_some((knob, ms))
    });
    let mut points: Vec<(f64, f64)> = of_scene.collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points
}

/// GPU time of a family in a report of `render`.
fn milliseconds(run: &Run, family: &str) -> f64 {
    let spans = run.json.get("gpu_ms").and_then(|spans| spans.as_object());
    let spans = spans.into_iter().flatten();
    let of_family = spans.filter(|(span, _)| family_of(span) == Some(family));
    of_family.filter_map(|(_, ms)| ms.as_f64()).sum()
}

/// The family with the longest beginning that fits.
fn family_of(span: &str) -> Option<&'static str> {
    let fits = |(name, starts): &(&'static str, &[&str])| {
        let longest = starts.iter().filter(|start| span.starts_with(*start));
        longest
            .map(|start| start.len())
            .max()
            .map(|length| (length, *name))
    };
    FAMILIES.iter().filter_map(fits).max().map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_belong_to_the_family_with_the_longest_beginning() {
        for (span, family) in [
            ("cull_nodes", "cull"),
            ("late_cull_clusters", "cull"),
            ("raster_compute", "compute rasterizer"),
            ("late_raster_compute", "compute rasterizer"),
            ("raster_masked", "hardware rasterizer"),
            ("raster", "hardware rasterizer"),
            ("raster_points", "points"),
            ("build_hzb", "hzb"),
            ("shade", "shade"),
        ] {
            assert_eq!(family_of(span), Some(family), "{span}");
        }
        assert_eq!(family_of("transcode"), None);
    }
}
