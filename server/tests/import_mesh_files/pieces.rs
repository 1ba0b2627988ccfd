//! Large files are read in pieces.

use std::path::Path;

use lodestream_server::import::{MeshSource, OpenOptions, OpenedMesh, import, open};

use super::{Body, binary_stl, corners};

/// A grid of 400 by 500 quads, some of them as two triangles, one corner as a pentagon: more than one piece.
fn grid_ply(folder: &Path) -> std::path::PathBuf {
    const WIDE: i32 = 400;
    const HIGH: i32 = 500;
    let mut body = Body::new("binary_little_endian");
    for y in 0..=HIGH {
        for x in 0..=WIDE {
            body.f32(x as f32);
            body.f32(y as f32);
            body.f32(((x * 7 + y * 13) % 17) as f32 * 0.1);
            [x as u8, y as u8, 9].into_iter().for_each(|it| body.u8(it));
        }
    }
    let mut faces = 0;
    let mut face = |body: &mut Body, corners: &[i32]| {
        body.u8(corners.len() as u8);
        corners.iter().for_each(|&it| body.i32(it));
        faces += 1;
    };
    for y in 0..HIGH {
        for x in 0..WIDE {
            let a = y * (WIDE + 1) + x;
            let [b, c, d] = [a + 1, a + WIDE + 2, a + WIDE + 1];
            match (x + y) % 3 {
                0 => face(&mut body, &[a, b, c, d]),
                1 => face(&mut body, &[a, b, c, d, d]),
                _ => {
                    face(&mut body, &[a, b, c]);
                    face(&mut body, &[a, c, d]);
                }
            }
        }
    }
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n",
        (WIDE + 1) * (HIGH + 1)
    );
    let path = folder.join("grid.ply");
    let bytes = [header.into_bytes(), body.bytes].concat();
    std::fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn large_mesh_files_are_read_in_pieces() {
    let folder = tempfile::tempdir().unwrap();
    let ply = grid_ply(folder.path());
    let whole = import(&ply).unwrap();
    let stl = folder.path().join("grid.stl");
    std::fs::write(&stl, binary_stl("grid", &corners(&whole))).unwrap();
    for path in [ply, stl] {
        let whole = import(&path).unwrap();
        let options = OpenOptions::with_max_mesh_bytes(1 << 20);
        let opened = open(&path, &options).unwrap();
        let OpenedMesh::Streamed(mesh) = &opened.meshes[0] else {
            panic!("{} is loaded", path.display());
        };
        assert_eq!(mesh.triangle_count(), whole.source_triangles);
        assert_eq!(opened.source_triangles, whole.source_triangles);
        assert!(mesh.piece_count() >= 2);
        for index in 0..mesh.piece_count() {
            let piece = mesh.piece(index).unwrap();
            assert!(piece.triangles.len() <= 1 << 18);
            // Vertices stand in the order of first use.
            let mut next = 0;
            for &corner in piece.triangles.iter().flatten() {
                assert!(corner <= next);
                next = next.max(corner + 1);
            }
            assert_eq!(next as usize, piece.positions.len());
        }
        let whole_colors = whole.meshes[0].colors.clone();
        let streamed = opened.into_imported().unwrap();
        assert_eq!(corners(&streamed), corners(&whole));
        let mesh = &streamed.meshes[0];
        assert!(mesh.normals.is_none());
        if let Some(expected) = whole_colors {
            let colors = mesh.colors.as_ref().unwrap();
            let pairs = mesh.triangles.iter().zip(&whole.meshes[0].triangles);
            for (a, b) in pairs.flat_map(|(a, b)| a.iter().zip(b)) {
                assert_eq!(colors[*a as usize], expected[*b as usize]);
            }
        }
    }
}
