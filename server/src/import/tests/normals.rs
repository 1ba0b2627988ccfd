//! Normals made for shapes whose normals are known.

use glam::Vec3;
use serde_json::json;

use super::File;

/// Corners of the unit cube and its twelve triangles, counter-clockwise from outside.
fn cube() -> (Vec<[f32; 3]>, Vec<u16>) {
    let corner = |at: u8| [at & 1, at >> 1 & 1, at >> 2].map(f32::from);
    let sides: [[u16; 4]; 6] = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let triangles = sides
        .iter()
        .flat_map(|&[a, b, c, d]| [a, b, c, a, c, d])
        .collect();
    ((0..8).map(corner).collect(), triangles)
}

#[test]
fn a_cube_gets_24_vertices_with_its_side_normals() {
    let (positions, triangles) = cube();
    let mut file = File::new();
    let position = file.floats(&positions);
    let indices = file.indices(&triangles);
    file.primitive(json!({"attributes": {"POSITION": position}, "indices": indices}));
    let scene = file.scene();
    let mesh = &scene.meshes[0];
    assert_eq!(mesh.positions.len(), 24);
    let normals = mesh.normals.as_ref().unwrap();
    for (triangle, side) in mesh.triangles.iter().zip((0..12).map(|at| at / 2)) {
        let expected = [-Vec3::Z, Vec3::Z, -Vec3::Y, Vec3::Y, -Vec3::X, Vec3::X][side];
        for &vertex in triangle {
            assert_eq!(Vec3::from(normals[vertex as usize]), expected);
        }
    }
}

/// A ring of `sides` quads around the Z axis.
fn ring(sides: u16) -> File {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for side in 0..sides {
        let (y, x) = (f64::from(side) / f64::from(sides) * std::f64::consts::TAU).sin_cos();
        positions.extend([[x as f32, y as f32, 0.0], [x as f32, y as f32, 1.0]]);
        let [a, b] = [2 * side, 2 * ((side + 1) % sides)];
        triangles.extend([a, b, b + 1, a, b + 1, a + 1]);
    }
    let mut file = File::new();
    let position = file.floats(&positions);
    let indices = file.indices(&triangles);
    file.primitive(json!({"attributes": {"POSITION": position}, "indices": indices}));
    file
}

#[test]
fn edges_below_40_degrees_are_smooth_and_those_above_sharp() {
    // 10 sides meet at 36 degrees, 8 at 45.
    let smooth = ring(10).scene().meshes.remove(0);
    assert_eq!(smooth.positions.len(), 20);
    for (position, normal) in smooth.positions.iter().zip(smooth.normals.unwrap()) {
        // Angle weights make the cut of the quads invisible: exactly outward.
        let outward = Vec3::new(position[0], position[1], 0.0);
        assert!(
            outward.distance(normal.into()) < 1e-6,
            "{position:?} {normal:?}"
        );
    }
    assert_eq!(ring(8).scene().meshes[0].positions.len(), 32);
}

#[test]
fn a_fan_too_large_to_compare_by_pairs_agrees_with_geometry() {
    // A flat disc of 1000 triangles below a cone of as many, sharing one rim: both have fans beyond EXACT_VALENCE.
    let mut positions = vec![[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]];
    let mut triangles = Vec::new();
    for side in 0..1000u16 {
        let (y, x) = (f64::from(side) / 1000.0 * std::f64::consts::TAU).sin_cos();
        positions.push([x as f32, y as f32, 0.0]);
        let [a, b] = [side + 2, (side + 1) % 1000 + 2];
        triangles.extend([0, b, a, 1, a, b]);
    }
    let mut file = File::new();
    let position = file.floats(&positions);
    let indices = file.indices(&triangles);
    file.primitive(json!({"attributes": {"POSITION": position}, "indices": indices}));
    let scene = file.scene();
    let mesh = &scene.meshes[0];
    let normals = mesh.normals.as_ref().unwrap();
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|it| Vec3::from(mesh.positions[it as usize]));
        let face = (b - a).cross(c - a).normalize();
        for &vertex in triangle {
            let (cos, at) = (face.dot(normals[vertex as usize].into()), vertex as usize);
            // At the apex a face averages its neighbours within the crease angle, plus a cell's width.
            let least = if mesh.positions[at][2] > 1.0 {
                0.9
            } else {
                0.999
            };
            assert!(cos > least, "{cos} at {:?}", mesh.positions[at]);
        }
    }
}

#[test]
fn slivers_and_far_coordinates_keep_their_normals() {
    for (offset, size, height) in [
        (0.0, 1.0, 1e-6),
        (1e7, 64.0, 64.0),
        (0.0, 1e30, 1e30),
        (0.0, 1e-38, 1e-38),
    ] {
        let mut file = File::new();
        let position = file.floats(&[
            [offset, offset, offset],
            [offset + size, offset, offset],
            [offset, offset, offset + height],
        ]);
        file.primitive(json!({"attributes": {"POSITION": position}}));
        let mesh = file.scene().meshes.remove(0);
        assert_eq!(
            mesh.normals.unwrap(),
            [[0.0, -1.0, 0.0]; 3],
            "{offset} {size} {height}"
        );
    }
}

#[test]
fn triangles_without_area_stay_and_borrow_a_normal() {
    let mut file = File::new();
    let position = file.floats(&[
        [0.0; 3],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [2.0, 0.0, 0.0],
        [3.0, 0.0, 0.0],
    ]);
    let indices = file.indices(&[0, 1, 2, 1, 3, 4]);
    file.primitive(json!({"attributes": {"POSITION": position}, "indices": indices}));
    let mesh = file.scene().meshes.remove(0);
    assert_eq!(mesh.triangles.len(), 2);
    assert_eq!(mesh.positions.len(), 5);
    assert_eq!(mesh.normals.unwrap(), [[0.0, 0.0, 1.0]; 5]);
}

#[test]
fn the_thread_count_changes_nothing() {
    let file = ring(20_000);
    let scene_with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| file.scene())
    };
    assert_eq!(scene_with(1), scene_with(4));
}
