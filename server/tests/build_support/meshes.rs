//! Procedural meshes, one a difficulty.

use lodestream_server::import::Mesh;

use super::Random;

type Point = [f32; 3];

/// A mesh of positions and triangles with one material.
pub fn plain(name: &str, positions: Vec<Point>, triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh {
        name: name.into(),
        normals: Some(normals(&positions, &triangles)),
        positions,
        uvs: None,
        colors: None,
        triangle_materials: vec![0; triangles.len()],
        triangles,
        material_slots: vec![0],
    }
}

fn normals(positions: &[Point], triangles: &[[u32; 3]]) -> Vec<Point> {
    let mut sums = vec![glam::Vec3::ZERO; positions.len()];
    for corners in triangles {
        let [a, b, c] = corners.map(|index| glam::Vec3::from(positions[index as usize]));
        let normal = (b - a).cross(c - a).normalize_or_zero();
        corners
            .iter()
            .for_each(|&index| sums[index as usize] += normal);
    }
    sums.iter()
        .map(|sum| sum.try_normalize().unwrap_or(glam::Vec3::Z).into())
        .collect()
}

/// Vertices `(column, row)` of a grid of `columns` x `rows` quads as triangles; wraps where asked.
fn quads(columns: u32, rows: u32, wrap: [bool; 2]) -> Vec<[u32; 3]> {
    let width = columns + u32::from(!wrap[0]);
    let height = rows + u32::from(!wrap[1]);
    let at = |x: u32, y: u32| (y % height) * width + x % width;
    let mut triangles = Vec::new();
    for y in 0..rows {
        for x in 0..columns {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    triangles
}

/// A closed torus without seams; bumps make it more than two curvatures.
pub fn torus(columns: u32, rows: u32) -> Mesh {
    let mut positions = Vec::new();
    for y in 0..rows {
        for x in 0..columns {
            let (u, v) = (turn(x, columns), turn(y, rows));
            let minor = 0.3 + 0.02 * (7.0 * u).sin() * (5.0 * v).cos();
            let major = 1.0 + minor * v.cos();
            positions.push([major * u.cos(), major * u.sin(), minor * v.sin()].map(|x| x as f32));
        }
    }
    plain("torus", positions, quads(columns, rows, [true, true]))
}

fn turn(index: u32, count: u32) -> f64 {
    std::f64::consts::TAU * index as f64 / count as f64
}

/// A sphere of `n` x `n` quads a cube face, welded by place, `radius` metres about `center`.
pub fn sphere(n: u32, radius: f64, center: [f64; 3]) -> Mesh {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    let mut known = std::collections::HashMap::new();
    for face in 0..6u32 {
        let (axis, sign) = ((face / 2) as usize, if face % 2 == 0 { 1.0 } else { -1.0 });
        let mut index = Vec::new();
        for y in 0..=n {
            for x in 0..=n {
                let mut key = [0i64; 3];
                key[axis] = sign as i64 * n as i64;
                key[(axis + 1) % 3] = 2 * x as i64 - n as i64;
                key[(axis + 2) % 3] = (2 * y as i64 - n as i64) * sign as i64;
                index.push(*known.entry(key).or_insert_with(|| {
                    let direction = glam::DVec3::from(key.map(|k| k as f64)).normalize();
                    let point = direction * radius + glam::DVec3::from(center);
                    positions.push(point.to_array().map(|x| x as f32));
                    positions.len() as u32 - 1
                }));
            }
        }
        triangles.extend(
            quads(n, n, [false, false])
                .iter()
                .map(|t| t.map(|i| index[i as usize])),
        );
    }
    plain("sphere", positions, triangles)
}

/// A hilly square with an open border and texture coordinates.
pub fn terrain(n: u32) -> Mesh {
    let mut positions = Vec::new();
    let mut uvs = Vec::new();
    for y in 0..=n {
        for x in 0..=n {
            let (u, v) = (x as f64 / n as f64, y as f64 / n as f64);
            let height = 0.05 * (9.0 * u).sin() * (7.0 * v).cos() + 0.01 * (40.0 * u * v).sin();
            positions.push([u as f32, height as f32, v as f32]);
            uvs.push([u as f32, v as f32]);
        }
    }
    let mut mesh = plain("terrain", positions, quads(n, n, [false, false]));
    mesh.uvs = Some(uvs);
    mesh
}

/// A closed box of `n` x `n` quads a face: normals and texture coordinates break at every side, and two materials meet.
pub fn two_material_box(n: u32) -> Mesh {
    let mut mesh = Mesh {
        name: "box".into(),
        material_slots: vec![4, 2],
        ..Mesh::default()
    };
    let (mut normals, mut uvs, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    for face in 0..6usize {
        let (axis, sign) = (face / 2, if face % 2 == 0 { 1.0f32 } else { -1.0 });
        let first = mesh.positions.len() as u32;
        for y in 0..=n {
            for x in 0..=n {
                let (u, v) = (x as f32 / n as f32, y as f32 / n as f32);
                let mut position = [0.0; 3];
                position[axis] = sign;
                position[(axis + 1) % 3] = 2.0 * u - 1.0;
                position[(axis + 2) % 3] = (2.0 * v - 1.0) * sign;
                mesh.positions.push(position);
                let mut normal = [0.0; 3];
                normal[axis] = sign;
                normals.push(normal);
                uvs.push([u + face as f32, v]);
                colors.push([(255.0 * u) as u8, (255.0 * v) as u8, 0, 255]);
            }
        }
        for (index, triangle) in quads(n, n, [false, false]).iter().enumerate() {
            mesh.triangles.push(triangle.map(|i| first + i));
            // The border between the materials runs round the sides and across faces.
            let half = index as u32 % (2 * n) < n;
            mesh.triangle_materials
                .push(u16::from(face >= 3) ^ u16::from(half && face == 0));
        }
    }
    (mesh.normals, mesh.uvs, mesh.colors) = (Some(normals), Some(uvs), Some(colors));
    mesh
}

/// Loose tetrahedra of random size.
pub fn tetrahedra(count: u32) -> Mesh {
    let mut random = Random(7);
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for index in 0..count {
        let center: [f64; 3] = std::array::from_fn(|_| random.between(-10.0, 10.0));
        let size = random.between(0.05, 0.3);
        for corner in [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]] {
            positions.push(std::array::from_fn(|axis| {
                (center[axis] + size * corner[axis] as f64) as f32
            }));
        }
        let faces = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        triangles.extend(faces.map(|face| face.map(|i: u32| 4 * index + i)));
    }
    plain("tetrahedra", positions, triangles)
}

/// Open quads at random places: no coarser form exists unless their borders move.
pub fn cards(count: u32) -> Mesh {
    let mut random = Random(9);
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for index in 0..count {
        let mut vector = || glam::DVec3::from(std::array::from_fn(|_| random.between(-1.0, 1.0)));
        let (center, a, b) = (8.0 * vector(), 0.1 * vector(), 0.1 * vector());
        for corner in [
            center - a - b,
            center + a - b,
            center + a + b,
            center - a + b,
        ] {
            positions.push(corner.to_array().map(|x| x as f32));
        }
        triangles.extend([[0, 1, 2], [0, 2, 3]].map(|face| face.map(|i: u32| 4 * index + i)));
    }
    plain("cards", positions, triangles)
}

/// The same surface with three vertices of its own for each triangle, flat normals.
pub fn unwelded(mesh: &Mesh) -> Mesh {
    let corners = mesh.triangles.iter().flatten();
    let positions = corners
        .map(|&index| mesh.positions[index as usize])
        .collect();
    let triangles = (0..mesh.triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
    plain("unwelded", positions, triangles.collect())
}

/// A square of triangles a million times as long as high.
pub fn slivers(n: u32) -> Mesh {
    let mut mesh = terrain(n);
    mesh.name = "slivers".into();
    mesh.positions
        .iter_mut()
        .for_each(|position| position[0] *= 1e-6);
    mesh
}

/// `count` triangles round one vertex.
pub fn hub(count: u32) -> Mesh {
    let mut positions = vec![[0.0, 0.0, 0.2]];
    positions.extend((0..count).map(|i| {
        let (sin, cos) = turn(i, count).sin_cos();
        [cos as f32, sin as f32, 0.0]
    }));
    let triangles = (0..count)
        .map(|i| [0, 1 + i, 1 + (i + 1) % count])
        .collect();
    plain("hub", positions, triangles)
}

/// `mesh` with every position mapped.
pub fn mapped(mesh: &Mesh, name: &str, map: impl Fn(f32) -> f32) -> Mesh {
    let mut mesh = mesh.clone();
    mesh.name = name.into();
    mesh.positions
        .iter_mut()
        .flatten()
        .for_each(|value| *value = map(*value));
    mesh
}
