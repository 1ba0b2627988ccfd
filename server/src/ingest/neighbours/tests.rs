use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};

use super::*;
use crate::import::{Mesh, OpenedMesh};

/// Quads of a tile's side.
const QUADS: u32 = 8;

/// A tile of `width` metres whose heights repeat: each side meets the opposite one of a copy.
fn tile(width: f32) -> Mesh {
    let row = QUADS + 1;
    let at = |index: u32| (index % row, index / row);
    let height = |x: u32, z: u32| ((x % QUADS) * 5 + (z % QUADS) * 3) as f32 * 0.01 * width;
    let positions: Vec<[f32; 3]> = (0..row * row)
        .map(at)
        .map(|(x, z)| {
            let side = |value: u32| value as f32 * width / QUADS as f32;
            [side(x), height(x, z), side(z)]
        })
        .collect();
    let corners = (0..row * row)
        .map(at)
        .filter(|&(x, z)| x < QUADS && z < QUADS);
    let triangles: Vec<[u32; 3]> = corners
        .flat_map(|(x, z)| {
            let a = z * row + x;
            [[a, a + row, a + 1], [a + 1, a + row, a + row + 1]]
        })
        .collect();
    mesh(positions, triangles)
}

fn mesh(positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh {
        triangle_materials: vec![0; triangles.len()],
        positions,
        triangles,
        material_slots: vec![0],
        ..Mesh::default()
    }
}

fn cube(side: f32) -> Mesh {
    let corner = |corner: u8| std::array::from_fn(|axis| (corner >> axis & 1) as f32 * side);
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
    mesh((0..8).map(corner).collect(), faces.to_vec())
}

fn found(meshes: Vec<Mesh>, placed: &[(usize, DAffine3)]) -> Vec<Neighbours> {
    let options = Options {
        steps_are_free: true,
        memory_limit_bytes: None,
    };
    let found = found_with(meshes, placed, &options);
    assert_eq!(found.warnings, Vec::<String>::new());
    found.neighbours
}

fn found_with(meshes: Vec<Mesh>, placed: &[(usize, DAffine3)], options: &Options) -> Found {
    let merged: Vec<MergedMesh> = meshes
        .into_iter()
        .map(|mesh| MergedMesh {
            file: Arc::from(Path::new("test.glb")),
            input: 0,
            material_slots: vec![0],
            triangles: mesh.triangles.len() as u64,
            mesh: OpenedMesh::Loaded(mesh),
        })
        .collect();
    let meshes: Vec<&MergedMesh> = merged.iter().collect();
    let rows = |map: &DAffine3| {
        std::array::from_fn(|row| {
            let linear = map.matrix3.row(row);
            [linear.x, linear.y, linear.z, map.translation[row]]
        })
    };
    let placed = placed.iter();
    let placed = placed.map(|(mesh, map)| Placed::new(*mesh, &rows(map)));
    find(&meshes, placed, options).expect("meshes in memory")
}

fn moved(x: f64, y: f64, z: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(x, y, z))
}

/// Positions of the tile that `keep` takes, in the tile's order.
fn taken(tile: &Mesh, keep: impl Fn(&[f32; 3]) -> bool) -> Vec<[f32; 3]> {
    let mut all: Vec<[f32; 3]> = tile.positions.iter().copied().filter(keep).collect();
    sort(&mut all);
    all
}

fn sort(positions: &mut [[f32; 3]]) {
    positions.sort_by_key(|at| at.map(|value| value.to_bits() as i32));
}

fn fixed(neighbours: &Neighbours) -> Vec<[f32; 3]> {
    let mut fixed = neighbours.fixed.clone();
    sort(&mut fixed);
    fixed
}

#[test]
fn the_common_side_of_two_tiles_is_fixed_and_nothing_else() {
    let own = tile(10.0);
    let mut other = own.clone();
    other.positions.iter_mut().for_each(|at| at[0] += 10.0);
    let identity = DAffine3::IDENTITY;
    let found = found(
        vec![own.clone(), other.clone()],
        &[(0, identity), (1, identity)],
    );
    assert_eq!(fixed(&found[0]), taken(&own, |at| at[0] == 10.0));
    assert_eq!(fixed(&found[1]), taken(&other, |at| at[0] == 10.0));
    assert!(found[0].step_exponent.is_some());
    assert_eq!(found[0].step_exponent, found[1].step_exponent);
}

#[test]
fn tiles_apart_keep_nothing() {
    let tiles = || vec![tile(10.0), tile(10.0)];
    for offset in [10.01, 25.0, -5400e3] {
        let found = found(
            tiles(),
            &[(0, DAffine3::IDENTITY), (1, moved(offset, 0.0, 0.0))],
        );
        assert!(found.iter().all(Neighbours::is_empty), "{offset}");
    }
}

/// Instances of one mesh: far from the origin, turned, mirrored, scaled.
#[test]
fn instances_of_a_tile_fix_the_sides_that_meet() {
    let own = tile(4.0);
    let far = moved(5e6, -3e6, 4.8e6) * DAffine3::from_scale(DVec3::splat(0.5));
    let turned = far * DAffine3::from_quat(DQuat::from_rotation_y(1.1));
    let mirrored = far * DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    for base in [DAffine3::IDENTITY, far, turned, mirrored] {
        let row: Vec<(usize, DAffine3)> = (0..3)
            .map(|index| (0, base * moved(4.0 * index as f64, 0.0, 0.0)))
            .collect();
        let found = found(vec![own.clone()], &row);
        let expected = taken(&own, |at| at[0] == 0.0 || at[0] == 4.0);
        assert_eq!(fixed(&found[0]), expected, "{base:?}");
    }
}

/// A quarter turn brings the side along z to the side along x.
#[test]
fn turned_neighbours_share_a_side() {
    let flat = {
        let mut flat = tile(4.0);
        flat.positions.iter_mut().for_each(|at| at[1] = 0.0);
        flat
    };
    let quarter = DAffine3::from_quat(DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2));
    // (x, z) becomes (z, -x): the tile covers 0..4 and -4..0, and its side x = 0 lies on z = 0.
    let found = found(vec![flat.clone()], &[(0, DAffine3::IDENTITY), (0, quarter)]);
    let expected = taken(&flat, |at| at[0] == 0.0 || at[2] == 0.0);
    assert_eq!(fixed(&found[0]), expected);
}

#[test]
fn surfaces_on_each_other_fix_nothing() {
    let leaf = tile(0.1);
    let mut back = leaf.clone();
    back.triangles
        .iter_mut()
        .for_each(|corners| corners.swap(1, 2));
    let at = moved(3.0, 2.0, 1.0);
    let found = found(vec![leaf, back], &[(0, at), (1, at), (0, at)]);
    assert!(found.iter().all(|neighbours| neighbours.fixed.is_empty()));
}

/// Each second vertex of the finer side lies on one of the coarser side.
/// Two-sided tiles side by side: each side lies on its back and meets two neighbours.
#[test]
fn a_covered_border_that_also_meets_a_neighbour_is_fixed() {
    let front = tile(4.0);
    let mut back = front.clone();
    back.triangles
        .iter_mut()
        .for_each(|corners| corners.swap(1, 2));
    let [here, beside] = [0.0, 4.0].map(|x| moved(x, 0.0, 0.0));
    let placed = [(0, here), (1, here), (0, beside), (1, beside)];
    let found = found(vec![front.clone(), back], &placed);
    let expected = taken(&front, |at| at[0] == 0.0 || at[0] == 4.0);
    assert_eq!(fixed(&found[0]), expected);
    assert_eq!(fixed(&found[1]), expected);
}

#[test]
fn tiles_of_other_fineness_fix_the_vertices_that_both_have() {
    let coarse = tile(8.0);
    let mut fine = tile(4.0);
    // Stretched to the coarse tile's length along z, and flat on both sides.
    fine.positions
        .iter_mut()
        .for_each(|at| *at = [at[0] + 8.0, 0.0, at[2]]);
    let mut flat = coarse.clone();
    flat.positions.iter_mut().for_each(|at| at[1] = 0.0);
    let identity = DAffine3::IDENTITY;
    let found = found(vec![flat, fine], &[(0, identity), (1, identity)]);
    let expected: Vec<[f32; 3]> = (0..=4).map(|index| [8.0, 0.0, index as f32]).collect();
    assert_eq!(fixed(&found[0]), expected);
    assert_eq!(fixed(&found[1]), expected);
}

#[test]
fn closed_meshes_that_touch_share_a_grid_and_move_freely() {
    let bricks: Vec<(usize, DAffine3)> = (0..5)
        .map(|index| (index % 2, moved(0.5 * index as f64, 0.0, 0.0)))
        .collect();
    let mut small = cube(0.5);
    small.positions.iter_mut().for_each(|at| at[1] *= 1e-2);
    let found = found(vec![cube(0.5), small], &bricks);
    assert!(found.iter().all(|neighbours| neighbours.fixed.is_empty()));
    assert!(found[0].step_exponent.is_some());
    assert_eq!(found[0].step_exponent, found[1].step_exponent);
}

/// No lattice holds an offset of 0.613 m: the step is so fine that the joint is below f32.
#[test]
fn odd_offsets_get_a_finer_grid() {
    let exponent = |side: f64| {
        let row: Vec<(usize, DAffine3)> = (0..4)
            .map(|index| (0, moved(side * index as f64, 0.0, 0.0)))
            .collect();
        found(vec![cube(side as f32)], &row)[0].step_exponent
    };
    let whole = exponent(0.5).expect("they touch");
    let odd = exponent(0.613).expect("they touch");
    assert!(odd <= whole - 4, "{odd} {whole}");
    assert!(2f64.powi(odd) <= 0.613 / (1 << 20) as f64);
}

#[test]
fn a_step_of_the_user_is_left_alone() {
    let options = Options {
        steps_are_free: false,
        memory_limit_bytes: None,
    };
    let row = [(0, DAffine3::IDENTITY), (0, moved(4.0, 0.0, 0.0))];
    let found = found_with(vec![tile(4.0)], &row, &options);
    assert_eq!(found.neighbours[0].step_exponent, None);
    assert_eq!(found.neighbours[0].fixed.len(), 2 * (QUADS as usize + 1));
}

#[test]
fn too_little_memory_is_told() {
    let options = Options {
        steps_are_free: true,
        memory_limit_bytes: Some(4 * 72 * 80),
    };
    for (count, words) in [(6, "too many vertices"), (40, "too many to compare")] {
        let row: Vec<(usize, DAffine3)> = (0..count)
            .map(|index| (0, moved(4.0 * index as f64, 0.0, 0.0)))
            .collect();
        let found = found_with(vec![tile(4.0)], &row, &options);
        assert_eq!(found.warnings.len(), 1, "{:?}", found.warnings);
        assert!(found.warnings[0].contains(words), "{:?}", found.warnings);
    }
}

/// All vertices match all others: looks end early.
#[test]
fn many_copies_at_one_place_are_compared() {
    let at = moved(1.0, 2.0, 3.0);
    let copies = vec![(0, at); 2000];
    let found = found(vec![cube(1.0)], &copies);
    assert!(found[0].fixed.is_empty());
}

/// Instances without volume, and huge ones.
#[test]
fn strange_placements_are_taken() {
    let placed = [
        (0, DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0))),
        (0, DAffine3::from_scale(DVec3::splat(1e30))),
        (0, DAffine3::from_scale(DVec3::splat(1e-30))),
        (0, moved(1e300, 0.0, 0.0)),
    ];
    found(vec![tile(1.0)], &placed);
}

/// Each vertex inside the block has seven others at its place.
#[test]
fn a_block_of_touching_instances_shares_a_grid() {
    let side = 24;
    let placed: Vec<(usize, DAffine3)> = (0..side * side * side)
        .map(|at| [at % side, at / side % side, at / side / side])
        .map(|at| at.map(|axis| axis as f64 * 0.5))
        .map(|[x, y, z]| (0, moved(x, y, z)))
        .collect();
    let found = found(vec![cube(0.5)], &placed);
    assert!(found[0].fixed.is_empty());
    assert!(found[0].step_exponent.is_some());
}
