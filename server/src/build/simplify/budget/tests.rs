use super::super::super::borders::{FREE, LOCKED};
use super::super::super::steps::{PositionStep, Wanted};
use super::super::super::vertex::{Grids, Vertex};
use super::super::super::{grids, survey};
use super::super::group::Weights;
use super::*;
use crate::build::TriangleTree;
use crate::import::Mesh;

const SIDE: i32 = 24;

/// Steps of a square.
const SQUARE: i32 = 64;

/// Squares under a height, each with the slot of its material; the rim stays.
fn field(height: impl Fn(i32, i32) -> i32, slot: impl Fn(i32, i32) -> u16) -> GroupMesh {
    let mut mesh = GroupMesh::default();
    mesh.welder.clear(2 * ((SIDE + 1) * (SIDE + 1)) as usize);
    for y in 0..SIDE {
        for x in 0..SIDE {
            let corner = |mesh: &mut GroupMesh, [x, y]: [i32; 2], slot: u16| {
                let vertex = Vertex {
                    position: [SQUARE * x, SQUARE * y, height(x, y)],
                    ..Vertex::default()
                };
                let number = mesh.welder.number(&vertex, slot) as u16;
                if mesh.rules.len() < mesh.welder.place_count() {
                    let rim = [x, y].iter().any(|&at| at == 0 || at == SIDE);
                    mesh.rules.push(if rim { LOCKED } else { FREE });
                }
                number
            };
            let all = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]];
            let [a, b, c, d] = all.map(|at| corner(&mut mesh, at, slot(x, y)));
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh.first_triangles.push(0);
    mesh.place_positions();
    mesh
}

/// Two waves of other lengths.
fn waves() -> GroupMesh {
    let height = |x: i32, y: i32| {
        let wave = |k: f64| (k * x as f64).sin() * (0.7 * k * y as f64).cos();
        (90.0 * wave(0.3) + 25.0 * wave(1.7)) as i32
    };
    field(height, |_, _| 0)
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

/// A mesh when all has gone that may.
fn collapsed(mesh: &GroupMesh, distance: f32, target: usize) -> Collapser<0> {
    let mut state = Collapser::<0>::default();
    let weights = Weights {
        normal: 0.0,
        uv: 0.0,
        color: 0.0,
    };
    state.start(mesh, &some_grids(), &weights);
    state.budget.start(mesh, distance);
    state.run(mesh, target, true);
    state
}

/// Triangles left then.
fn left(mesh: &GroupMesh, distance: f32, target: usize) -> Vec<[u16; 3]> {
    let state = collapsed(mesh, distance, target);
    let all = state.corners.iter().zip(&state.alive);
    let alive = all.filter(|&(_, &alive)| alive);
    alive.map(|(&corners, _)| corners).collect()
}

fn tree(mesh: &GroupMesh, triangles: &[[u16; 3]]) -> TriangleTree {
    let places = |&own: &[u16; 3]| mesh.places(own).map(|place| place as u32);
    let places: Vec<[u32; 3]> = triangles.iter().map(places).collect();
    TriangleTree::new(&mesh.positions, &places)
}

/// Triangles left and the farthest place of the source, units, when all goes that may.
fn run(distance: f32) -> (usize, f64) {
    let mesh = waves();
    let left = left(&mesh, distance, 200);
    let tree = tree(&mesh, &left);
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

/// A square tube along a line that turns to and fro, a ring every step of it; the ends stay.
fn branch(width: f64) -> GroupMesh {
    const RINGS: i32 = 160;
    const ARM: i32 = 16;
    let mut mesh = GroupMesh::default();
    mesh.welder.clear(4 * RINGS as usize);
    for ring in 0..RINGS {
        let turn = f64::from(ring) * std::f64::consts::PI / f64::from(ARM);
        let at = [
            600.0 * turn.cos(),
            24.0 * f64::from(ring),
            90.0 * (3.1 * turn).sin(),
        ];
        for [side, up] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
            let offset = [0.0, side * width, up * width];
            let vertex = Vertex {
                position: [0, 1, 2].map(|axis| (at[axis] + offset[axis]).round() as i32),
                ..Vertex::default()
            };
            mesh.welder.number(&vertex, 0);
            let is_end = ring == 0 || ring == RINGS - 1;
            mesh.rules.push(if is_end { LOCKED } else { FREE });
        }
    }
    for ring in 0..RINGS - 1 {
        for side in 0..4 {
            let [a, b] = [side, (side + 1) % 4].map(|side| (4 * ring + side) as u16);
            mesh.triangles.extend([[a, b, b + 4], [a, b + 4, a + 4]]);
        }
    }
    mesh.first_triangles.push(0);
    mesh.place_positions();
    mesh
}

#[test]
fn new_triangles_keep_near_the_source() {
    for width in [15.0, 20.0, 25.0] {
        let mesh = branch(width);
        let source = tree(&mesh, &mesh.triangles);
        let budget = 100.0 / mesh.unit;
        let left = left(&mesh, budget, 1);
        assert!(left.len() < mesh.triangles.len() / 2, "{}", left.len());
        let mut farthest = 0.0f64;
        for own in left {
            let [a, b, c] = mesh.places(own).map(|place| mesh.positions[place]);
            for at in [center(&[a, b, c]), middle(a, b), middle(b, c), middle(c, a)] {
                let squared = source.distance_squared(at.map(f64::from), -1.0);
                farthest = farthest.max(squared.sqrt());
            }
        }
        assert!(farthest <= 1.6 * budget as f64, "{width}: {farthest}");
    }
}

#[test]
fn a_stripe_does_not_shrink_from_its_ends() {
    const STRIPE: i32 = SIDE / 2;
    const ALONG: std::ops::Range<i32> = 4..SIDE - 4;
    let slot = |x: i32, y: i32| u16::from(y == STRIPE && ALONG.contains(&x));
    let mesh = field(|_, _| 0, slot);
    // Wider than the stripe, so that its sides may fall together, and less than two squares.
    let budget = 1.2 * SQUARE as f32 / mesh.unit;
    let left = left(&mesh, budget, 1);
    let of_stripe = |own: &&[u16; 3]| mesh.welder.vertices[own[0] as usize].1 == 1;
    let stripe: Vec<[u16; 3]> = left.iter().filter(of_stripe).copied().collect();
    let tree = tree(&mesh, &stripe);
    for x in ALONG.start..=ALONG.end {
        for y in [STRIPE, STRIPE + 1] {
            let at = mesh.local([SQUARE * x, SQUARE * y, 0]).map(f64::from);
            let away = tree.distance_squared(at, -1.0).sqrt();
            assert!(away <= 1.0001 * budget as f64, "{x}: {away} for {budget}");
        }
    }
    assert!(left.len() < mesh.triangles.len() / 2, "{}", left.len());
}

#[test]
fn every_place_that_goes_has_a_live_triangle_within_the_budget() {
    let mesh = waves();
    let budget = 0.009;
    let state = collapsed(&mesh, budget, 200);
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
    let mut state = collapsed(&mesh, f32::INFINITY, 200);
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
