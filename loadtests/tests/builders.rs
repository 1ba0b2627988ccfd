//! The measuring instruments themselves: that what holds is seen to hold, and what is broken is seen.
#![allow(clippy::unwrap_used)] // A failing unwrap is a failing test.

use std::path::Path;
use std::process::Command;

use lodestream_loadtests::build::clusterlod::{Prepared, Preset};
use lodestream_loadtests::build::dag::{ClusterDag, center_metres, source_places};
use lodestream_loadtests::build::edges::SourceBorder;
use lodestream_loadtests::build::groups;
use lodestream_loadtests::build::inputs::Generated;
use lodestream_loadtests::build::rows::Shape;
use lodestream_loadtests::build::stability::{self, Sizes};
use lodestream_server::build::{BuildOptions, BuiltAsset, build};
use lodestream_server::import::Mesh;

fn generated(name: &str) -> (Mesh, BuiltAsset, ClusterDag) {
    let mesh = name.parse::<Generated>().unwrap().mesh();
    let built = build(&mesh, &BuildOptions::default()).unwrap();
    let dag = ClusterDag::of_asset(&built).unwrap();
    (mesh, built, dag)
}

#[test]
fn promises_hold_and_broken_ones_are_seen() {
    let (_, built, mut dag) = generated("torus:12000");
    let step = built.asset.position_grid.step();
    let figures = |dag: &ClusterDag| {
        groups::figures(dag, &groups::measure(dag, usize::MAX, usize::MAX), step)
    };
    let honest = figures(&dag);
    assert!(honest.groups > 5 && honest.measured == honest.groups);
    assert_eq!((honest.unbounded, honest.bounded_share), (0, 1.0));
    assert!(honest.ratio_p50 >= 1.0 && honest.ratio_p95 >= honest.ratio_p50);
    for group in &mut dag.groups {
        group.parent_error_metres *= 0.1;
    }
    let boasting = figures(&dag);
    assert_eq!(boasting.unbounded, boasting.groups);
    assert!(boasting.worst_excess > 1.0);
}

#[test]
fn cracks_are_seen_and_simplified_borders_are_none() {
    for name in ["sphere:12000", "foliage:8000"] {
        let (_, _, dag) = generated(name);
        let border = SourceBorder::new(&dag);
        assert_eq!(border.open.is_empty(), name.starts_with("sphere"));
        // The outline of a leaf that stands for others may lie over one of them.
        let most = border.open.len() as u64 / 1_000;
        for level in 0..dag.levels() {
            let opened = border.opened(&dag.level_cut(level), 1e-4);
            assert!(opened <= most, "{name}: {opened}");
        }
    }
    let (_, _, dag) = generated("sphere:12000");
    let border = SourceBorder::new(&dag);
    let cut = dag.level_cut(2);
    assert!(border.opened(&cut[1..], 0.0) > 10);
    let twice: Vec<u32> = cut.iter().chain(&cut[..1]).copied().collect();
    assert!(border.opened(&twice, 0.0) > 10);
}

/// Both builders' level 0 is the input, and every cut of every level covers it once: as many triangles as its levels say.
#[test]
fn both_builders_are_read_alike() {
    let (mesh, built, ours) = generated("charts:12000");
    let center = center_metres(&built);
    let rival = Prepared::new(&mesh).dag(Preset::Default, center);
    let (places, _) = source_places(&mesh, center);
    assert_eq!(rival.places, places);
    for dag in [&ours, &rival] {
        let shape = Shape::of(dag);
        assert_eq!(shape.source_triangles, mesh.triangles.len() as u64);
        assert_eq!(dag.gather(dag.level_cut(0)).len(), mesh.triangles.len());
        assert_eq!(dag.error_cut(0.0).len() as u64, shape.source_clusters);
        assert_eq!(dag.error_cut(1e30).len() as u64, shape.root_clusters);
        assert!(shape.max_vertices <= 256 && shape.levels >= 5);
        let ladder = dag.ladder(10);
        assert!(ladder.len() <= 10 && ladder.is_sorted());
    }
}

#[test]
fn every_extreme_case_holds() {
    let sizes = Sizes {
        surface: 3000,
        many: 3000,
    };
    let table = stability::table(sizes, "", &BuildOptions::default(), |_| ());
    let rows = table.rows.len() + table.claims.len();
    assert_eq!(table.passed + table.failed, rows);
    assert!(table.rows.len() >= 20);
    for claim in &table.claims {
        assert!(claim.holds, "{claim:?}");
    }
    for row in &table.rows {
        assert!(row.passed(), "{}: {:?}", row.case, row.faults);
    }
}

/// The whole command, its rows of memory from processes of their own included.
#[test]
fn the_command_writes_its_tables() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("builders-test.json");
    let output = Command::new(Path::new(env!("CARGO_BIN_EXE_lodestream-loadtests")))
        .args(["build", "--generate", "torus:3000", "--threads", "1,2"])
        .args(["--runs", "1", "--samples", "20000", "--knobs", "--report"])
        .arg(&report)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
    let text = std::fs::read_to_string(&report).unwrap();
    let study: serde_json::Value = serde_json::from_str(&text).unwrap();
    let rows = study["rows"].as_array().unwrap();
    let builders: Vec<_> = rows
        .iter()
        .map(|row| row["builder"].as_str().unwrap())
        .collect();
    assert_eq!(
        builders,
        ["lodestream", "lodestream", "clusterlod", "clusterlod-rt"]
    );
    for row in rows {
        assert!(row["mtris_per_sec"].as_f64().unwrap() > 0.0);
        assert_eq!(row["root_clusters"], 1);
        if cfg!(target_os = "linux") {
            assert!(row["peak_bytes"].as_u64() >= row["before_bytes"].as_u64());
        }
    }
    assert_eq!(rows[0]["same_bytes"], true);
    assert_eq!(study["errors"].as_array().unwrap().len(), 2);
    assert!(study["equal_error"][0]["levels_at_rms"].as_f64().unwrap() > 0.1);
    assert!(study["knobs"].as_array().unwrap().len() >= 5);
    assert!(said.contains("clusterlod-rt") && said.contains("stored/measured"));

    let page = lodestream_loadtests::report::write(folder.path()).unwrap();
    let page = std::fs::read_to_string(page).unwrap();
    assert!(
        page.contains("Build: against clusterlod") && page.contains("Error against build time")
    );
}
