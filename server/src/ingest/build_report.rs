//! A build's report read back from its record. `BuildReport` only serializes: what is missing here for reading stands in for a
//! derived `Deserialize` of its own, and must name the same fields.

use serde::{Deserialize, Deserializer, Serialize};

use crate::build::{BuildBytes, BuildReport, BuildSeconds, GroupsByTerm, LevelRow};

/// As `BuildReport` serializes, both ways.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct StoredReport(#[serde(deserialize_with = "Report::deserialize")] pub BuildReport);

#[derive(Deserialize)]
#[serde(remote = "BuildReport", deny_unknown_fields)]
struct Report {
    triangles: u64,
    dag_triangles: u64,
    clusters: u64,
    groups: u64,
    groups_with_moved_open_edges: u64,
    groups_by_term: GroupsByTerm,
    levels: u32,
    pages: u64,
    #[serde(deserialize_with = "Bytes::deserialize")]
    bytes: BuildBytes,
    cluster_fill: f64,
    #[serde(deserialize_with = "rows")]
    levels_table: Vec<LevelRow>,
    #[serde(deserialize_with = "Seconds::deserialize")]
    seconds: BuildSeconds,
    warnings: Vec<String>,
}

#[derive(Deserialize)]
#[serde(remote = "BuildBytes", deny_unknown_fields)]
struct Bytes {
    memory_form: u64,
    disk_form: u64,
    stored: u64,
    hierarchy: u64,
    root_pages: u64,
}

#[derive(Deserialize)]
#[serde(remote = "LevelRow", deny_unknown_fields)]
struct Row {
    level: u32,
    triangles: u64,
    clusters: u64,
    groups: u64,
    error_max: f64,
    #[serde(default)]
    measured_error_max: Option<f64>,
}

#[derive(Deserialize)]
#[serde(remote = "BuildSeconds", deny_unknown_fields)]
struct Seconds {
    #[serde(default)]
    leaves: f64,
    build: f64,
    encode: f64,
}

fn rows<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<LevelRow>, D::Error> {
    #[derive(Deserialize)]
    struct One(#[serde(deserialize_with = "Row::deserialize")] LevelRow);
    let rows = Vec::<One>::deserialize(from)?;
    Ok(rows.into_iter().map(|One(row)| row).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{self, BuildOptions};
    use crate::import::Mesh;

    #[test]
    fn a_report_comes_back_as_it_was() {
        let mesh = Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2], [0, 1, 2]],
            triangle_materials: vec![0, 0],
            material_slots: vec![0],
            ..Mesh::default()
        };
        let mut report = build::build(&mesh, &BuildOptions::default())
            .unwrap()
            .report;
        report.warnings.push("a \"line\"".to_owned());
        report.levels_table[0].measured_error_max = Some(0.1);
        report.cluster_fill = 100.0 / 3.0;
        let json = serde_json::to_string(&report).unwrap();
        let back: StoredReport = serde_json::from_str(&json).unwrap();
        assert_eq!(back.0, report);
        let more = json.replacen("{", "{\"unknown\":1,", 1);
        assert!(serde_json::from_str::<StoredReport>(&more).is_err());
    }
}
