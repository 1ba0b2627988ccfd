//! A crown of leaves, boxes and a held part, thinned, against distances by brute force in f64.

use glam::DVec3;
use lodestream_format::cluster::Attributes;
use lodestream_format::grid::Grid;

use super::super::super::borders::{FREE, LOCKED};
use super::super::super::cluster::ClusterView;
use super::super::super::vertex::{Grids, Vertex};
use super::super::collapse::Collapser;
use super::super::group::GroupMesh;
use super::fit::nearest;
use super::{Corners, Limits, Thinner, corners, sums};

/// Grid steps of the crown's radius.
const CROWN: f64 = 60_000.0;
/// Grid steps of a leaf.
const LEAF: f64 = 3_000.0;
const LEAVES: usize = 160;
const BOXES: usize = 24;

/// Numbers from -1 to 1, the same at every run.
struct Random(u32);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(self.0 >> 8) / f64::from(1 << 23) - 1.0
    }

    fn vector(&mut self) -> DVec3 {
        loop {
            let at = DVec3::new(self.next(), self.next(), self.next());
            if (0.01..=1.0).contains(&at.length_squared()) {
                return at;
            }
        }
    }
}

/// Vertices and triangles of a cluster, its material, and what may be done to its vertices.
struct Piece {
    vertices: Vec<Vertex>,
    triangles: Vec<[u8; 4]>,
    materials: [[u16; 2]; 1],
    rule: u8,
}

/// A bent leaf of two by two quads, or a box, somewhere in the crown.
fn piece(random: &mut Random, is_box: bool, rule: u8) -> Piece {
    let middle = random.vector() * CROWN;
    let along = random.vector().normalize();
    let across = along.cross(random.vector()).normalize();
    let up = along.cross(across);
    let place = |s: f64, t: f64, u: f64| {
        let at = middle + (along * s + across * t + up * u) * LEAF;
        Vertex {
            position: at.round().as_ivec3().to_array(),
            ..Vertex::default()
        }
    };
    let mut triangles: Vec<[u8; 4]> = Vec::new();
    let mut quad = |a: u8, b: u8, c: u8, d: u8| triangles.extend([[a, b, c, 0], [a, c, d, 0]]);
    let vertices = match is_box {
        true => {
            quad(0, 2, 3, 1);
            quad(4, 5, 7, 6);
            quad(0, 1, 5, 4);
            quad(2, 6, 7, 3);
            quad(0, 4, 6, 2);
            quad(1, 3, 7, 5);
            let side = |k: usize, bit: usize| f64::from((k >> bit & 1) as u32) - 0.5;
            (0..8)
                .map(|k| place(side(k, 0), 0.5 * side(k, 1), 0.5 * side(k, 2)))
                .collect()
        }
        false => {
            for first in [0, 1, 3, 4] {
                quad(first, first + 1, first + 4, first + 3);
            }
            let leaf = |k: u32| {
                let (s, t) = (f64::from(k % 3) - 1.0, f64::from(k / 3) - 1.0);
                place(0.5 * t, 0.3 * s, 0.1 * s.abs())
            };
            (0..9).map(leaf).collect()
        }
    };
    Piece {
        materials: [[u16::from(is_box), triangles.len() as u16]],
        vertices,
        triangles,
        rule,
    }
}

fn crown() -> GroupMesh {
    let mut random = Random(7);
    let mut pieces: Vec<Piece> = Vec::new();
    for number in 0..LEAVES + BOXES {
        let rule = if number % 20 == 0 { LOCKED } else { FREE };
        pieces.push(piece(&mut random, number >= LEAVES, rule));
    }
    let rules: Vec<Vec<u8>> = pieces
        .iter()
        .map(|piece| vec![piece.rule; piece.vertices.len()])
        .collect();
    let clusters = pieces.iter().zip(&rules).map(|(piece, rules)| {
        let view = ClusterView {
            vertices: &piece.vertices,
            triangles: &piece.triangles,
            border: &[],
            materials: &piece.materials,
            witnesses: &[],
        };
        (view, &rules[..])
    });
    let mut mesh = GroupMesh::default();
    mesh.gather(clusters);
    mesh
}

fn surface(mesh: &GroupMesh, keep: impl Fn(&[u16; 3]) -> bool) -> Vec<Corners> {
    let own = mesh.triangles.iter().filter(|own| keep(own));
    own.map(|&own| corners(mesh, own)).collect()
}

/// Largest distance of points spread over some triangles to others.
fn farthest(from: &[Corners], to: &[Corners], steps: u32) -> f64 {
    let mut most = 0.0f64;
    for &[a, b, c] in from {
        for i in 0..=steps {
            for j in 0..=steps - i {
                let (u, v) = (
                    f64::from(i) / f64::from(steps),
                    f64::from(j) / f64::from(steps),
                );
                let at = a * (1.0 - u - v) + b * u + c * v;
                most = most.max(nearest(at, to).0);
            }
        }
    }
    most.sqrt()
}

fn slot_of(mesh: &GroupMesh, own: &[u16; 3]) -> u16 {
    mesh.welder.vertices[own[0] as usize].1
}

/// Directed edges between places that no opposite edge meets.
fn open_edges(mesh: &GroupMesh, slot: u16) -> usize {
    let mut edges: Vec<(usize, usize)> = Vec::new();
    for own in mesh
        .triangles
        .iter()
        .filter(|own| slot_of(mesh, own) == slot)
    {
        let [a, b, c] = mesh.places(*own);
        edges.extend([(a, b), (b, c), (c, a)]);
    }
    let opposite = |&&(a, b): &&(usize, usize)| !edges.contains(&(b, a));
    edges.iter().filter(opposite).count()
}

fn limits(budget: f64, members: &[f32]) -> Limits<'_> {
    Limits {
        budget,
        members,
        target: 1,
    }
}

/// Three rounds, each with twice the distance.
fn thinned(mesh: &mut GroupMesh, mut after: impl FnMut(&GroupMesh, f64)) {
    let mut thinner = Thinner::default();
    let (mut budget, mut members) = (0.04, 0.0);
    for _ in 0..3 {
        thinner.start(mesh, f64::INFINITY);
        thinner.thin(mesh, &limits(budget, &[members]), Attributes::default());
        assert!(thinner.lost <= budget);
        after(mesh, budget);
        (members, budget) = (budget as f32, 2.0 * budget);
    }
}

#[test]
fn a_crown_gets_thinner_within_the_budget_and_keeps_its_area() {
    let mut mesh = crown();
    let source = surface(&mesh, |_| true);
    let areas = [0, 1].map(|slot| sums(&surface(&mesh, |own| slot_of(&mesh, own) == slot)).0);
    let mut counts = vec![mesh.triangles.len()];
    let source_mesh = crown();
    thinned(&mut mesh, |mesh, budget| {
        let new = surface(mesh, |_| true);
        // Two grid steps for rounding, and what lies between the samples of the way back.
        let rounding = 2.0 / f64::from(mesh.unit);
        let to_new = farthest(&source, &new, 3);
        assert!(to_new <= 1.02 * budget + rounding, "{to_new} for {budget}");
        let to_source = farthest(&new, &source, 6);
        assert!(
            to_source <= 1.1 * budget + rounding,
            "{to_source} for {budget}"
        );
        for slot in [0, 1] {
            let of_slot = |own: &[u16; 3]| slot_of(mesh, own) == slot;
            let area = sums(&surface(mesh, of_slot)).0 / areas[slot as usize];
            assert!((area - 1.0).abs() < 0.05, "material {slot}: {area}");
        }
        assert_eq!(open_edges(mesh, 1), 0, "a closed part opened");
        counts.push(mesh.triangles.len());
    });
    assert!(counts[3] < counts[0] / 2, "{counts:?}");
    // Locked parts: the same triangles at the same places.
    let locked = |mesh: &GroupMesh| {
        surface(mesh, |&own| {
            mesh.places(own)
                .iter()
                .all(|&place| mesh.rules[place] == LOCKED)
        })
    };
    assert_eq!(locked(&mesh), locked(&source_mesh));
}

#[test]
fn a_crown_gets_thin_the_same_way_twice() {
    let mut results = [crown(), crown()];
    for mesh in &mut results {
        thinned(mesh, |_, _| ());
    }
    let [first, second] = results;
    assert_eq!(first.triangles, second.triangles);
    assert_eq!(first.positions, second.positions);
    assert_eq!(first.witnesses, second.witnesses);
}

#[test]
fn parts_get_back_the_area_that_collapses_took() {
    let mut mesh = crown();
    let grid = Grid::new(0).expect("a step of one metre");
    let grids = Grids {
        attributes: Attributes::default(),
        position: grid,
        uv: grid,
        center_q: [0; 3],
        uv_base: [0; 2],
    };
    let weights = mesh.weights(&grids, mesh.typical_edge(&mesh.triangles));
    let mut thinner = Thinner::default();
    thinner.start(&mesh, f64::INFINITY);
    let mut state = Collapser::<0>::default();
    state.start(&mesh, &grids, &weights);
    let area = |mesh: &GroupMesh, state: &Collapser<0>| {
        let all = state.corners.iter().zip(&state.alive);
        let live = all.filter(|&(_, &alive)| alive);
        sums(&live.map(|(&own, _)| corners(mesh, own)).collect::<Vec<_>>()).0
    };
    let before = area(&mesh, &state);
    state.budget.start(&mesh, f32::INFINITY);
    state.run(&mesh, mesh.triangles.len() / 2, true);
    let collapsed = area(&mesh, &state) / before;
    assert!(collapsed < 0.9, "nothing to give back: {collapsed}");
    thinner.regrow(&mut mesh, &state, &limits(0.05, &[]));
    let grown = area(&mesh, &state) / before;
    assert!((grown - 1.0).abs() < 0.05, "{grown} after {collapsed}");
}

#[test]
fn no_budget_moves_nothing() {
    let mut mesh = crown();
    let before = surface(&mesh, |_| true);
    let mut thinner = Thinner::default();
    thinner.start(&mesh, f64::INFINITY);
    thinner.thin(&mut mesh, &limits(0.0, &[]), Attributes::default());
    assert_eq!(surface(&mesh, |_| true), before);
}
