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

/// Triangles left and the farthest place of the source, units, when all goes that may.
fn run(distance: f32) -> (usize, f64) {
    let mesh = waves();
    let mut state = Collapser::<0>::default();
    let weights = Weights {
        normal: 0.0,
        uv: 0.0,
        color: 0.0,
    };
    state.start(&mesh, &some_grids(), &weights);
    state.budget.start(&mesh, distance);
    state.run(&mesh, 200, true);
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
