//! A mesh beside others: its rounding is stated, the shared border stays, the grid is shared.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod build_support;

use build_support::Random;
use build_support::cut::ReadAsset;
use build_support::meshes::{self, plain};
use lodestream_format::hierarchy::ROOT_ERROR;
use lodestream_server::build::{
    BuildOptions, BuildSite, BuiltAsset, Neighbours, PositionStep, build, build_at,
};
use lodestream_server::import::Mesh;

fn beside(mesh: &Mesh, neighbours: &Neighbours) -> (BuiltAsset, ReadAsset) {
    let options = BuildOptions::default();
    let built = build_at(mesh, &options, neighbours, BuildSite::default()).unwrap();
    let read = ReadAsset::new(&built);
    read.check_monotone();
    (built, read)
}

/// Those positions of a terrain over the unit square that lie on sides which `side` takes.
fn side_of(mesh: &Mesh, side: impl Fn(&[f32; 3]) -> bool) -> Vec<[f32; 3]> {
    mesh.positions.iter().copied().filter(side).collect()
}

#[test]
fn a_fixed_border_stays_at_every_level() {
    let mesh = meshes::terrain(96);
    let ends = |value: f32| value == 0.0 || value == 1.0;
    let fixed = side_of(&mesh, |[x, _, z]| ends(*x) || ends(*z));
    let neighbours = Neighbours {
        fixed,
        ..Neighbours::default()
    };
    let (built, read) = beside(&mesh, &neighbours);
    assert!(built.report.levels > 3, "{} levels", built.report.levels);
    // No replacement moves an open edge: every cut has the border of the source.
    assert!(read.moved_edges().iter().all(|sums| sums.is_empty()));
    let roots = read.uniform_refinement(ROOT_ERROR / 2.0);
    let coarsest = read.triangles(read.drawn(&roots).into_iter()).len();
    assert!(coarsest < mesh.triangles.len() / 8, "{coarsest} triangles");
    let (_, alone) = beside(&mesh, &Neighbours::default());
    assert!(alone.moved_edges().iter().any(|sums| !sums.is_empty()));
}

#[test]
fn the_rest_of_the_border_still_simplifies() {
    let mesh = meshes::terrain(96);
    let neighbours = Neighbours {
        fixed: side_of(&mesh, |[x, ..]| *x == 0.0),
        ..Neighbours::default()
    };
    let (built, read) = beside(&mesh, &neighbours);
    let grid = built.asset.position_grid;
    let on_side = |place: u32| {
        let local = read.places[place as usize][0] as f64;
        local + built.asset.center_q[0] as f64 * grid.step() == 0.0
    };
    let side_edges = |sums: &build_support::cut::Sums| -> Vec<((u32, u32), i64)> {
        let mut edges: Vec<_> = sums.iter().map(|(&edge, &sum)| (edge, sum)).collect();
        edges.retain(|&((a, b), _)| on_side(a) && on_side(b));
        edges.sort_unstable();
        edges
    };
    let expected = side_edges(&read.source_sums());
    assert_eq!(expected.len(), 96);
    let mut random = Random(7);
    for _ in 0..40 {
        let installed = read.random_residency(&mut random);
        let refine = read.random_refinement(&mut random, &installed);
        let found = read.sums_of(read.drawn(&refine).into_iter());
        assert_eq!(side_edges(&found), expected);
    }
    assert!(read.moved_edges().iter().any(|sums| !sums.is_empty()));
}

#[test]
fn the_grid_of_the_neighbours_is_taken_as_far_as_the_mesh_spans_it() {
    let mesh = meshes::terrain(16);
    let step_of = |step_exponent| {
        let neighbours = Neighbours {
            step_exponent,
            ..Neighbours::default()
        };
        beside(&mesh, &neighbours)
            .0
            .asset
            .position_grid
            .step_exponent
    };
    assert_eq!(step_of(Some(-19)), -19);
    assert_eq!(
        step_of(Some(-60)),
        -22,
        "2^23 steps at most, and both ends round"
    );
    let chosen = BuildOptions {
        position_step: PositionStep::Metres(0.25),
        ..BuildOptions::default()
    };
    let shared = Neighbours {
        step_exponent: Some(-19),
        ..Neighbours::default()
    };
    let built = build_at(&mesh, &chosen, &shared, BuildSite::default()).unwrap();
    assert_eq!(
        built.asset.position_grid.step_exponent, -2,
        "the user's wins"
    );
}

/// Sides of a box, metres; a box far from the origin of its object; a sliver.
#[test]
fn every_error_counts_the_rounding_of_the_source() {
    let cases: [([f32; 3], [f32; 3]); 4] = [
        ([5.013, 5.007, 5.021], [0.0; 3]),
        ([0.613, 2.743, 0.1], [0.0; 3]),
        ([2.0, 3.0, 4.0], [7e4, -3e5, 11.0]),
        ([1e-3, 1e3, 7e-7], [0.3; 3]),
    ];
    for (sides, at) in cases {
        let corners: Vec<[f32; 3]> = (0..8u8)
            .map(|corner| {
                std::array::from_fn(|axis| {
                    at[axis]
                        + if corner >> axis & 1 == 1 {
                            sides[axis]
                        } else {
                            0.0
                        }
                })
            })
            .collect();
        let faces = [
            [0, 2, 1],
            [1, 2, 3],
            [4, 5, 6],
            [5, 7, 6],
            [0, 1, 4],
            [1, 5, 4],
            [2, 6, 3],
            [3, 6, 7],
            [0, 4, 2],
            [2, 4, 6],
            [1, 3, 5],
            [3, 7, 5],
        ];
        let mesh = plain("box", corners.clone(), faces.to_vec());
        let built = build(&mesh, &BuildOptions::default()).unwrap();
        let grid = built.asset.position_grid;
        assert_eq!(built.report.levels_table[0].error_max, grid.rounding());
        let extent = sides.into_iter().fold(0.0, f32::max) as f64;
        assert!(
            grid.step() <= extent / 16384.0,
            "{} of {extent}",
            grid.step()
        );
        let read = ReadAsset::new(&built);
        for corner in corners {
            let away = |place: &[f32; 3]| -> f64 {
                let axis = |axis: usize| {
                    let middle = built.asset.center_q[axis] as f64 * grid.step();
                    (place[axis] as f64 + middle - corner[axis] as f64).powi(2)
                };
                (0..3).map(axis).sum::<f64>().sqrt()
            };
            let nearest = read.places.iter().map(away).fold(f64::INFINITY, f64::min);
            assert!(
                nearest <= grid.rounding(),
                "{nearest} of {}",
                grid.rounding()
            );
        }
    }
    let coarse = BuildOptions {
        position_step: PositionStep::Metres(1.0 / 64.0),
        ..BuildOptions::default()
    };
    let built = build(meshes::terrain(64), &coarse).unwrap();
    let read = ReadAsset::new(&built);
    let rounding = 0.75f64.sqrt() / 64.0;
    let errors = read
        .hierarchy
        .groups
        .iter()
        .map(|group| group.parent_error_metres);
    assert!(errors.clone().count() > 1);
    assert!(errors.into_iter().all(|error| error as f64 >= rounding));
}
