//! Figures as aligned text.

use serde::Serialize;
use serde_json::Value;

use super::curves::CutFigures;
use super::libraries::Libraries;
use super::stability::Stability;
use super::stored::Stored;
use super::study::{Promises, Study};
use crate::pages::Row;
use crate::report::number;

/// A column: heading, and the key in a row of figures.
type Column = (&'static str, &'static str);

/// Rows under headings, text to the left and numbers to the right; missing figures are a dash.
pub fn table<'a, T: Serialize + 'a>(
    title: &str,
    columns: &[Column],
    rows: impl IntoIterator<Item = &'a T>,
) -> String {
    let mut lines: Vec<Vec<String>> = Vec::new();
    for row in rows {
        // Rows are plain structs with string keys: nothing in them can fail to serialize.
        let row = serde_json::to_value(row).unwrap_or(Value::Null);
        let cells = columns.iter().map(|(_, key)| cell(&row[key]));
        lines.push(cells.collect());
    }
    if lines.is_empty() {
        return String::new();
    }
    lines.insert(
        0,
        columns.iter().map(|(head, _)| head.to_string()).collect(),
    );
    let widths: Vec<usize> = (0..columns.len())
        .map(|column| {
            let widths = lines.iter().map(|line| line[column].chars().count());
            widths.max().unwrap_or(0)
        })
        .collect();
    let mut text = format!("{title}\n");
    for line in &lines {
        let cells = line.iter().zip(&widths).enumerate();
        let cells = cells.map(|(column, (cell, width))| match column {
            0 => format!("  {cell:<width$}"),
            _ => format!("  {cell:>width$}"),
        });
        text += cells.collect::<String>().trim_end();
        text.push('\n');
    }
    text
}

fn cell(value: &Value) -> String {
    match value {
        Value::Null => "-".into(),
        Value::String(text) => text.clone(),
        Value::Array(all) => all.iter().map(cell).collect::<Vec<_>>().join("; "),
        Value::Number(whole) if !whole.is_f64() => whole.to_string(),
        value => value.as_f64().map_or_else(|| value.to_string(), number),
    }
}

/// The stability table.
pub fn stability(stability: &Stability) -> String {
    let mut text = table(
        "stability",
        &[
            ("case", "case"),
            ("triangles", "triangles"),
            ("levels", "levels"),
            ("roots", "root_clusters"),
            ("open", "source_open_edges"),
            ("opened", "opened_edges"),
            ("grid m", "grid_metres"),
            ("stated m", "grid_stated_metres"),
            ("step m", "step_metres"),
            ("level / stated", "level_excess"),
            ("groups", "measured"),
            ("bounded", "bounded_share"),
            ("below a step", "below_step"),
            ("stored/measured", "ratio_p50"),
            ("p95", "ratio_p95"),
            ("s", "build_secs"),
            ("outcome", "outcome"),
            ("faults", "faults"),
        ],
        &stability.rows,
    );
    text += &table(
        "claims",
        &[
            ("case", "case"),
            ("expected", "expected"),
            ("found", "found"),
            ("holds", "holds"),
        ],
        &stability.claims,
    );
    let (passed, failed) = (stability.passed, stability.failed);
    text += &format!("{passed} rows pass, {failed} do not\n");
    text
}

/// The study's tables.
pub fn study(study: &Study) -> String {
    let mut text = table(
        "builders",
        &[
            ("input", "input"),
            ("builder", "builder"),
            ("thr", "threads"),
            ("triangles", "triangles"),
            ("build s", "build_secs"),
            ("Mtri/s", "mtris_per_sec"),
            ("Mtri/cpu s", "mtris_per_cpu_sec"),
            ("total s", "total_secs"),
            ("levels", "levels"),
            ("groups", "groups"),
            ("clusters", "clusters"),
            ("fill", "fill"),
            ("at 0", "fill_source"),
            ("above", "fill_above"),
            ("roots", "root_clusters"),
            ("root tri", "root_triangles"),
            ("dag/input", "dag_per_input"),
            ("max vtx", "max_vertices"),
            ("B/tri", "stored_bytes_per_triangle"),
            ("peak B/tri", "peak_bytes_per_triangle"),
            ("same bytes", "same_bytes"),
            ("refused", "refused"),
        ],
        &study.rows,
    );
    text += &table(
        "\nour triangles over clusterlod's at equal measured error (geometric means)",
        &[
            ("input", "input"),
            ("levels, max", "levels_at_max"),
            ("levels, rms", "levels_at_rms"),
            ("worst, max", "worst_level_at_max"),
            ("worst, rms", "worst_level_at_rms"),
            ("cuts, max", "cuts_at_max"),
            ("cuts, rms", "cuts_at_rms"),
        ],
        &study.equal_error,
    );
    text += &promises(&study.promises);
    text += &table(
        "\nopen edges over levels and uniform-error cuts",
        &[
            ("input", "input"),
            ("builder", "builder"),
            ("source", "source_open_edges"),
            ("opened", "opened_edges"),
        ],
        &study.errors,
    );
    text += &table(
        "\nour knobs; errors of a cut of a sixteenth of the triangles",
        &[
            ("input", "input"),
            ("knob", "knob"),
            ("setting", "setting"),
            ("build s", "build_secs"),
            ("total s", "total_secs"),
            ("B/tri", "stored_bytes_per_triangle"),
            ("max m", "max_metres"),
            ("rms m", "rms_metres"),
            ("refused", "refused"),
        ],
        &study.knobs,
    );
    for errors in &study.errors {
        text += &levels(&errors.input, errors.builder, &errors.levels);
    }
    text
}

/// Ours and theirs, stage by stage.
pub fn libraries(libraries: &Libraries) -> String {
    let mut text = table(
        "triangles to clusters",
        &[
            ("input", "input"),
            ("by", "by"),
            ("clusters", "clusters"),
            ("fill", "fill"),
            ("places/tri", "places_per_triangle"),
            ("border edges", "border_share"),
            ("radius/disk", "radius_ratio"),
            ("s", "secs"),
        ],
        &libraries.clusters,
    );
    text += &table(
        "\nclusters to groups",
        &[
            ("input", "input"),
            ("level", "level"),
            ("clusters", "clusters"),
            ("by", "by"),
            ("groups", "groups"),
            ("mean", "mean"),
            ("largest", "largest"),
            ("under 8", "small"),
            ("locked edges/tri", "locked_per_triangle"),
            ("s", "secs"),
        ],
        &libraries.partitions,
    );
    text += &table(
        "\ngroups to half of their triangles; errors over ours",
        &[
            ("input", "input"),
            ("by", "by"),
            ("groups", "groups"),
            ("triangles", "triangles"),
            ("left", "left"),
            ("max", "max_ratio"),
            ("rms", "rms_ratio"),
            ("s", "secs"),
        ],
        &libraries.simplifiers,
    );
    text
}

/// The tables of a stored scene.
pub fn stored(stored: &Stored) -> String {
    let mut text = table(
        "assets",
        &[
            ("asset", "input"),
            ("triangles", "source_triangles"),
            ("levels", "levels"),
            ("groups", "groups"),
            ("clusters", "clusters"),
            ("fill", "fill"),
            ("at 0", "fill_source"),
            ("above", "fill_above"),
            ("roots", "root_clusters"),
            ("root tri", "root_triangles"),
            ("B/tri", "stored_bytes_per_triangle"),
            ("open", "source_open_edges"),
            ("opened", "opened_edges"),
        ],
        &stored.rows,
    );
    text += &promises(&stored.promises);
    for row in &stored.rows {
        text += &levels(&row.input, "stored", &row.level_cuts);
    }
    text
}

/// What pages cost.
pub fn pages(rows: &[Row]) -> String {
    let mut text = table(
        "stored bytes",
        &[
            ("input", "input"),
            ("bits", "bits"),
            ("placement", "placement"),
            ("error px", "error_px"),
            ("triangles", "source_triangles"),
            ("B/input", "stored_per_input"),
            ("B/dag", "stored_per_dag"),
            ("whole mesh", "whole_mesh_per_input"),
            ("memory B/dag", "memory_per_dag"),
            ("slack", "slack"),
            ("vtx/tri", "vertices_per_triangle"),
            ("own", "own_share"),
            ("repeated", "repeated_share"),
            ("inherited", "inherited_share"),
            ("refused", "refused"),
        ],
        rows,
    );
    text += &table(
        "\nbits of a triangle of all levels",
        &[
            ("input", "input"),
            ("bits", "bits"),
            ("placement", "placement"),
            ("topology", "topology_bits"),
            ("references", "references_bits"),
            ("positions", "positions_bits"),
            ("normals", "normals_bits"),
            ("uvs", "uvs_bits"),
            ("colours", "colors_bits"),
            ("metadata", "metadata_bits"),
            ("hierarchy", "hierarchy_bits"),
        ],
        rows,
    );
    text
}

fn promises(promises: &[Promises]) -> String {
    table(
        "\nour groups: stored against measured error",
        &[
            ("input", "input"),
            ("groups", "groups"),
            ("measured", "measured"),
            ("bounded", "bounded_share"),
            ("unbounded", "unbounded"),
            ("worst excess", "worst_excess"),
            ("below a step", "below_step"),
            ("stored/measured p50", "ratio_p50"),
            ("p95", "ratio_p95"),
        ],
        promises,
    )
}

fn levels(input: &str, builder: &str, levels: &[CutFigures]) -> String {
    table(
        &format!("\n{input}, {builder}: levels"),
        &[
            ("level", "by"),
            ("triangles", "triangles"),
            ("clusters", "clusters"),
            ("stored m", "stored_metres"),
            ("max m", "max_metres"),
            ("rms m", "rms_metres"),
            ("opened", "opened_edges"),
        ],
        levels,
    )
}
