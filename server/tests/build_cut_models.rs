//! Cuts of real models: 250 random (camera, residency) pairs each, a thousand in all.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod build_support;

use std::path::Path;
use std::time::Instant;

use build_support::cut::ReadAsset;
use lodestream_server::build::{BuildOptions, build};
use lodestream_server::import::import;

const PAIRS: usize = 250;

/// Every mesh of the model is built and its cuts are checked; the pairs are spread over the meshes.
fn check_model(name: &str) {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/models");
    let path = Path::new(folder).join(name);
    if !path.exists() {
        println!("SKIPPED {name}: the models are not here");
        return;
    }
    let scene = import(&path).unwrap();
    let pairs = PAIRS.div_ceil(scene.meshes.len());
    let mut total = (0, 0, 0);
    for mesh in &scene.meshes {
        let start = Instant::now();
        let built = build(mesh, &BuildOptions::default()).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        let read = ReadAsset::new(&built);
        read.check_monotone();
        let drawn = read.check_random_cuts(pairs, 3);
        let report = &built.report;
        let roots = read.hierarchy.groups.iter().filter(|group| group.is_root());
        println!(
            "{name} {:?}: {} triangles, {} levels, {} clusters ({:.1} a cluster), {} groups, {} pages ({} root), root triangles {}, \
             moved {}, stored {:.2} B a triangle, built in {seconds:.2} s; {pairs} cuts, {drawn} clusters drawn",
            mesh.name,
            report.triangles,
            report.levels,
            report.clusters,
            report.cluster_fill,
            report.groups,
            report.pages,
            built.asset.root_page_count,
            roots.map(|group| group.triangle_count as u64).sum::<u64>(),
            report.groups_with_moved_open_edges,
            report.bytes.stored as f64 / report.triangles as f64,
        );
        report.warnings.iter().for_each(|line| println!("  {line}"));
        total = (total.0 + pairs, total.1 + drawn, total.2 + report.triangles);
    }
    assert!(total.0 >= PAIRS);
    println!(
        "{name}: {} cuts of {} triangles without a crack, {} clusters drawn",
        total.0, total.2, total.1
    );
}

#[test]
fn cuts_of_spot() {
    check_model("spot.glb");
}

#[test]
fn cuts_of_stanford_bunny() {
    check_model("stanford_bunny.glb");
}

#[test]
fn cuts_of_japanese_maple() {
    check_model("japanese_maple.glb");
}

#[test]
fn cuts_of_pathological() {
    check_model("pathological.glb");
}

/// Not a bound by construction alone: the distance is measured against the source.
#[test]
fn errors_of_stanford_bunny() {
    let path = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../shared/models/stanford_bunny.glb"
    ));
    if !path.exists() {
        println!("SKIPPED stanford_bunny.glb: the models are not here");
        return;
    }
    for mesh in &import(path).unwrap().meshes {
        let read = ReadAsset::new(&build(mesh, &BuildOptions::default()).unwrap());
        for (stored, measured) in read.check_errors() {
            println!(
                "stored {stored:.3e} m, measured {measured:.3e} m, ratio {:.2}",
                stored / measured
            );
        }
    }
}
