use std::f64::consts::TAU;

use super::super::neighbours::{FixedPlaces, Neighbours};
use super::super::steps::{PositionStep, Wanted};
use super::super::store::Store;
use super::super::{dag::Plan, grids, leaves, scatter, survey};
use super::*;
use crate::build::{Placement, TriangleTree};
use crate::import::Mesh;

/// Columns and rows of quads over points of a square.
fn sheet(columns: u32, rows: u32, at: impl Fn(f64, f64) -> [f64; 3]) -> Mesh {
    let corners = (0..=rows).flat_map(|y| (0..=columns).map(move |x| (x, y)));
    let positions = corners.map(|(x, y)| {
        let point = at(x as f64 / columns as f64, y as f64 / rows as f64);
        point.map(|value| value as f32)
    });
    let quads = (0..rows).flat_map(|y| (0..columns).map(move |x| y * (columns + 1) + x));
    let triangles: Vec<[u32; 3]> = quads
        .flat_map(|a| {
            let [b, c, d] = [a + 1, a + columns + 2, a + columns + 1];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    Mesh {
        name: "sheet".into(),
        positions: positions.collect(),
        normals: None,
        uvs: None,
        colors: None,
        triangle_materials: vec![0; triangles.len()],
        triangles,
        material_slots: vec![0],
    }
}

/// Hills, and smaller ones on them.
fn bumpy() -> Mesh {
    sheet(140, 140, |x, y| {
        let hills = 0.08 * (9.0 * x).sin() * (7.0 * y).cos();
        let rough = 0.004 * (83.0 * x + 31.0 * y).sin() * (71.0 * y - 23.0 * x).cos();
        [x, y, hills + rough]
    })
}

/// All levels of a mesh.
fn grown(mesh: &Mesh) -> (Dag, Grids) {
    let survey = survey::survey(mesh).expect("survey");
    let wanted = Wanted {
        step: PositionStep::default(),
        shared_exponent: None,
    };
    let grids = grids("sheet", &survey, wanted, &mut Vec::new()).expect("grids");
    let mut blocks = Store::new(None).expect("store");
    let buckets = scatter::scatter(mesh, &survey, &grids, &mut blocks).expect("buckets");
    let mut dag = Dag::new(Store::new(None).expect("store"));
    leaves::leaves(&buckets, &mut blocks, |clusters| {
        dag.add(clusters, NO_GROUP).map(|_| ())
    })
    .expect("leaves");
    let plan = Plan {
        grids: &grids,
        placement: Placement::Optimal,
        fixed: &FixedPlaces::new(&Neighbours::default(), &grids),
        on_triangles: &|_| (),
    };
    dag.grow(plan).expect("levels");
    (dag, grids)
}

/// Triangles of some clusters, grid steps.
fn triangles(dag: &Dag, clusters: impl Iterator<Item = u32>) -> Vec<[[f32; 3]; 3]> {
    let (mut positions, mut corners) = (Vec::new(), Vec::new());
    let mut all = Vec::new();
    for cluster in clusters {
        dag.shape(cluster, &mut positions, &mut corners)
            .expect("a cluster");
        let corner = |vertex: u8| positions[vertex as usize].map(|index: i32| index as f32);
        all.extend(corners.iter().map(|&[a, b, c, _]| [a, b, c].map(corner)));
    }
    all
}

fn tree(triangles: &[[[f32; 3]; 3]]) -> TriangleTree {
    let numbers: Vec<[u32; 3]> = (0..triangles.len() as u32)
        .map(|triangle| [0, 1, 2].map(|corner| 3 * triangle + corner))
        .collect();
    TriangleTree::new(triangles.as_flattened(), &numbers)
}

fn source(dag: &Dag) -> TriangleTree {
    let all = 0..dag.clusters.len() as u32;
    let leaves = all.filter(|&cluster| dag.clusters[cluster as usize].child_group == NO_GROUP);
    tree(&triangles(dag, leaves))
}

/// Groups with a replacement, and its triangles.
fn replaced(dag: &Dag) -> impl Iterator<Item = (&[u32], f64, Vec<[[f32; 3]; 3]>)> {
    let groups = (0..).zip(&dag.groups);
    groups.filter_map(move |(number, group)| {
        let all = 0..dag.clusters.len() as u32;
        let own = all.filter(move |&own| dag.clusters[own as usize].child_group == number);
        let new = triangles(dag, own);
        let error_metres = group.surface_metres as f64;
        (!new.is_empty()).then_some((&group.members[..], error_metres, new))
    })
}

#[test]
fn a_distance_is_never_below_the_true_one_and_near_it() {
    let (dag, grids) = grown(&bumpy());
    let source = source(&dag);
    let samples = Samples {
        unit: (1 << 22) as f32,
        ..Samples::default()
    };
    let metres_a_unit = samples.unit as f64 * grids.step_metres();
    let (mut groups, mut deepest) = (0, 0);
    for (members, error_metres, new) in replaced(&dag) {
        let known = (error_metres / metres_a_unit) as f32;
        let below = Below {
            dag: &dag,
            members,
            samples: &samples,
            metres_a_unit,
        };
        let mut back = Back {
            useful: USEFUL * known,
            fine: FINE * known,
            ..Back::default()
        };
        back.start(below);
        for corners in new.iter().step_by(5) {
            let center = closely(*corners).nth(9).expect("a point");
            let at = center.map(|value| value / samples.unit);
            let units = at.map(|value| (value * samples.unit) as f64);
            let expected = source.distance_squared(units, -1.0).sqrt() as f32 / samples.unit;
            let found = back.distance(below, at, f32::INFINITY, 0.0).expect("found");
            let most = (expected + 2.0 * FINE * known) / (1.0 - NEARER);
            assert!(found >= expected - 1e-6, "{found} for {expected}");
            assert!(
                found <= most + 1e-6,
                "{found} for {expected}, at most {most}"
            );
        }
        groups += 1;
        deepest = deepest.max(dag.clusters[members[0] as usize].level);
    }
    assert!(
        groups > 20 && deepest > 4,
        "{groups} groups, level {deepest}"
    );
}

#[test]
fn no_point_of_a_replacement_is_farther_from_the_source_than_its_error() {
    let (dag, grids) = grown(&bumpy());
    let source = source(&dag);
    for (_, error_metres, new) in replaced(&dag) {
        let mut worst = 0.0f64;
        for at in new.iter().step_by(2).flat_map(|corners| closely(*corners)) {
            worst = worst.max(source.distance_squared(at.map(f64::from), worst));
        }
        let worst_metres = worst.sqrt() * grids.step_metres();
        assert!(
            worst_metres <= error_metres,
            "{worst_metres} over {error_metres}"
        );
    }
}

#[test]
fn a_bridge_over_a_hole_is_as_far_as_its_middle_is_from_the_rim() {
    // A ring: every point of it is near the bridge's corners, but not the bridge to the ring.
    const RIM: f64 = 0.5;
    let (dag, grids) = grown(&sheet(512, 24, |x, y| {
        let (sine, cosine) = (TAU * x).sin_cos();
        let radius = RIM + 0.1 * y;
        [
            radius * cosine,
            radius * sine,
            0.002 * (40.0 * TAU * x).sin(),
        ]
    }));
    let root = dag.groups.last().expect("a root");
    let known_metres = 0.02 * RIM;
    let unit = (1 << 22) as f32;
    let units = |metres: f64| (metres / grids.step_metres()) as f32 / unit;
    let corner = |turn: f64| {
        let (sine, cosine) = (TAU * turn).sin_cos();
        [units(RIM * cosine), units(RIM * sine), 0.0]
    };
    let corners = [corner(0.0), corner(1.0 / 3.0), corner(2.0 / 3.0)];
    let samples = Samples {
        points: vec![Sample {
            at: [0.0; 3],
            most: units(10.0),
            triangle: 0,
        }],
        triangles: vec![corners],
        unit,
        ..Samples::default()
    };
    let mut back = Back::default();
    let found = back
        .measure(&dag, &grids, &root.members, &samples, known_metres)
        .expect("measured");
    let most = (RIM + USEFUL as f64 * known_metres) * STEP_MARGIN;
    assert!((RIM..most).contains(&found), "{found}");
    // A distance that is known to be larger needs no proof.
    let found = back
        .measure(&dag, &grids, &root.members, &samples, 2.0 * RIM)
        .expect("measured");
    assert_eq!(found, 0.0);
}
