use super::super::super::borders::{FREE, LOCKED};
use super::super::super::steps::{PositionStep, Wanted};
use super::super::super::vertex::{Grids, Vertex};
use super::super::super::{grids, survey};
use super::super::group::Weights;
use super::*;
use crate::build::TriangleTree;
use crate::import::Mesh;

const SIDE: i32 = 24;

/// Squares of 64 steps under two waves of other lengths; the rim stays.
fn waves() -> GroupMesh {
    let mut mesh = GroupMesh::default();
    mesh.welder.clear(((SIDE + 1) * (SIDE + 1)) as usize);
    for y in 0..=SIDE {
        for x in 0..=SIDE {
            let wave = |k: f64| (k * x as f64).sin() * (0.7 * k * y as f64).cos();
            let height = 90.0 * wave(0.3) + 25.0 * wave(1.7);
            let vertex = Vertex {
                position: [64 * x, 64 * y, height as i32],
                ..Vertex::default()
            };
            mesh.welder.number(&vertex, 0);
            let rim = [x, y].iter().any(|&at| at == 0 || at == SIDE);
            mesh.rules.push(if rim { LOCKED } else { FREE });
        }
    }
    for y in 0..SIDE {
        for x in 0..SIDE {
            let a = (y * (SIDE + 1) + x) as u16;
            let [b, c, d] = [a + 1, a + SIDE as u16 + 2, a + SIDE as u16 + 1];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh.first_triangles.push(0);
    mesh.place_positions();
    mesh
}

fn some_grids() -> Grids {
    let mesh = Mesh {
        name: "triangle".into(),
        positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        triangle_materials: vec![0],
        triangles: vec![[0, 1, 2]],
        material_slots: vec![0],
        ..Mesh::default()
    };
    let wanted = Wanted {
        step: PositionStep::default(),
        shared_exponent: None,
    };
    let survey = survey::survey(&mesh).expect("a survey");
    grids("triangle", &survey, wanted, &mut Vec::new()).expect("grids")
}

/// The waves when all has gone that may.
fn collapsed(mesh: &GroupMesh, distance: f32) -> Collapser<0> {
    let mut state = Collapser::<0>::default();
    let weights = Weights {
        normal: 0.0,
        uv: 0.0,
        color: 0.0,
    };
    state.start(mesh, &some_grids(), &weights);
    state.budget.start(mesh, distance);
    state.run(mesh, 200, true);
    state
}

/// Triangles left and the farthest place of the source, units, when all goes that may.
fn run(distance: f32) -> (usize, f64) {
    let mesh = waves();
    let state = collapsed(&mesh, distance);
    let left: Vec<[u32; 3]> = (0..mesh.triangles.len())
        .filter(|&triangle| state.alive[triangle])
        .map(|triangle| {
            mesh.places(state.corners[triangle])
                .map(|place| place as u32)
        })
        .collect();
    let tree = TriangleTree::new(&mesh.positions, &left);
    let away = mesh.positions.iter().map(|at| {
        let squared = tree.distance_squared(at.map(f64::from), -1.0);
        squared.sqrt()
    });
    (left.len(), away.fold(0.0, f64::max))
}

#[test]
fn no_place_goes_farther_than_the_budget() {
    let (free, farthest) = run(f32::INFINITY);
    assert!(free <= 200 && farthest > 0.01, "{free} {farthest}");
    let mut before = usize::MAX;
    for budget in [0.004, 0.006, 0.009, 0.014] {
        let (left, farthest) = run(budget);
        assert!(
            farthest <= 1.0001 * budget as f64 && farthest > 0.5 * budget as f64,
            "{farthest} for {budget}"
        );
        assert!(left < before, "{left} after {before}");
        before = left;
    }
    assert!(before >= free);
}

#[test]
fn every_place_that_goes_has_a_live_triangle_within_the_budget() {
    let mesh = waves();
    let budget = 0.009;
    let state = collapsed(&mesh, budget);
    let mut places = Vec::new();
    for Answered {
        at,
        triangle,
        source,
    } in state.budget.points.answered()
    {
        let Source::Place(place) = source else {
            panic!("no witnesses were given: {source:?}");
        };
        assert_eq!(at, mesh.positions[place as usize]);
        assert!(state.alive[triangle], "place {place}");
        let corners = mesh.places(state.corners[triangle]);
        let corners = corners.map(|own| Vec3::from(mesh.positions[own]).extend(0.0));
        let squared = to_triangles(at, &gather([&corners; 4])).x;
        assert!(squared.sqrt() <= 1.0001 * budget, "place {place}");
        places.push(place);
    }
    places.sort_unstable();
    let gone = (0..mesh.positions.len() as u16).filter(|&place| state.find(place) != place);
    assert_eq!(places, gone.collect::<Vec<_>>());
}

#[test]
fn dear_collapses_are_not_queued_and_cheap_ones_are() {
    let mesh = waves();
    let mut state = collapsed(&mesh, f32::INFINITY);
    let [from, to] = [2 * (SIDE as u16 + 1) + 2, 2 * (SIDE as u16 + 1) + 3];
    let weight: f32 = [from, to]
        .map(|place| state.quadrics[place as usize].weight)
        .iter()
        .sum();
    let mean = 1e-4;
    assert!(!state.is_dear(mean * weight, from, to), "no budget");
    for (budget, is_dear) in [(0.9, true), (1.1, false)] {
        state.budget.start(&mesh, budget * (mean / DEAR).sqrt());
        assert_eq!(state.is_dear(mean * weight, from, to), is_dear, "{budget}");
    }
}

#[test]
fn a_mean_with_corners_of_the_nearest_triangle_is_nearer_by_so_much() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let four = gather([&corners.map(|at| Vec3::from(at).extend(0.0)); 4]);
    // Above the triangle, and beyond an edge of it.
    for at in [[0.2, 0.3, 0.5], [0.9, 0.8, -0.1]] {
        let under = Under {
            squared: to_triangles(at, &four).x,
            triangle: 7,
            corners: [3, 4, 5],
        };
        for (corner, place) in corners.into_iter().zip([3, 4, 5]) {
            let (bound, triangle) = under.shared(place, 2.0).expect("a corner");
            let squared = to_triangles(middle(at, corner), &four).x;
            assert!(
                squared <= 1.0001 * bound && triangle == 7,
                "{squared} {bound}"
            );
        }
        assert!(under.shared(6, 2.0).is_none());
    }
}
