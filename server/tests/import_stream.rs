//! Streaming: a mesh read in pieces is the loaded one, triangle by triangle.

// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use lodestream_server::import::{
    ImportedScene, Mesh, MeshSource, OpenOptions, OpenedMesh, OpenedScene, import, open,
};
use serde_json::json;

const MODELS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/models");

/// All that a triangle's corner says.
type Corner = (
    [f32; 3],
    Option<[f32; 2]>,
    Option<[u8; 4]>,
    Option<[f32; 3]>,
);

/// The corners of every triangle, and its material.
fn triangles(mesh: &Mesh) -> impl Iterator<Item = ([Corner; 3], u32)> {
    let corner = |vertex: u32| {
        let at = vertex as usize;
        (
            mesh.positions[at],
            mesh.uvs.as_ref().map(|it| it[at]),
            mesh.colors.as_ref().map(|it| it[at]),
            mesh.normals.as_ref().map(|it| it[at]),
        )
    };
    let material = |slot: u16| mesh.material_slots[usize::from(slot)];
    let slots = mesh.triangle_materials.iter();
    let triangles = mesh.triangles.iter().zip(slots);
    triangles.map(move |(triangle, &slot)| (triangle.map(corner), material(slot)))
}

fn streamed_count(scene: &OpenedScene) -> usize {
    let streamed = |mesh: &&OpenedMesh| matches!(mesh, OpenedMesh::Streamed(_));
    scene.meshes.iter().filter(streamed).count()
}

/// Compares, and says how many meshes were streamed.
fn compare(path: &Path, max_mesh_bytes: u64) -> usize {
    let name = path.display();
    let loaded: ImportedScene = import(path).unwrap();
    let opened = open(path, &OpenOptions::with_max_mesh_bytes(max_mesh_bytes)).unwrap();
    let streamed = streamed_count(&opened);
    assert_eq!(opened.name, loaded.name);
    assert_eq!(opened.source_triangles, loaded.source_triangles, "{name}");
    assert_eq!(opened.materials, loaded.materials, "{name}");
    assert_eq!(opened.instances, loaded.instances, "{name}");
    assert_eq!(opened.images, loaded.images, "{name}");
    assert_eq!(opened.meshes.len(), loaded.meshes.len(), "{name}");
    for (source, loaded) in opened.meshes.iter().zip(&loaded.meshes) {
        assert_eq!(source.name(), loaded.name);
        let mut expected = triangles(loaded);
        for index in 0..source.piece_count() {
            let piece = source.piece(index).unwrap();
            if matches!(source, OpenedMesh::Streamed(_)) {
                check_piece(&piece);
            }
            for (found, material) in triangles(&piece) {
                let (mut expected, expected_material) = expected.next().unwrap();
                if piece.normals.is_none() {
                    expected.iter_mut().for_each(|corner| corner.3 = None);
                }
                assert_eq!(found, expected, "{name} {}", loaded.name);
                assert_eq!(material, expected_material, "{name} {}", loaded.name);
            }
        }
        assert!(
            expected.next().is_none(),
            "{name} {} ends early",
            loaded.name
        );
    }
    streamed
}

fn check_piece(piece: &Mesh) {
    assert!(piece.triangles.len() <= 1 << 18);
    assert_eq!(piece.triangles.len(), piece.triangle_materials.len());
    let mut next = 0;
    for &corner in piece.triangles.iter().flatten() {
        assert!(corner <= next, "vertices in the order of first use");
        next = next.max(corner + 1);
    }
    assert_eq!(next as usize, piece.positions.len(), "every vertex in use");
}

#[test]
fn models_read_in_pieces_are_the_loaded_ones() {
    if !Path::new(MODELS).exists() {
        println!("SKIPPED: {MODELS} is absent");
        return;
    }
    for (name, max_mesh_bytes) in [
        ("spot.glb", 0),
        ("flight_helmet.glb", 100_000),
        ("pathological.glb", 0),
        ("kicad_board.glb", 1 << 20),
        ("jacksboro_terrain.glb", 1 << 20),
        ("stanford_dragon.glb", 1 << 20),
        ("bad/ext_meshopt.glb", 0),
        ("bad/ext_quantized.glb", 0),
        ("bad/ok_sparse.glb", 0),
        ("bad/ok_sparse_no_base.glb", 0),
        ("bad/ok_interleaved.glb", 0),
        ("bad/ok_triangle_strip.glb", 0),
        ("bad/ok_triangle_fan.glb", 0),
        ("bad/ok_no_indices.glb", 0),
        ("bad/ok_external.gltf", 0),
        ("bad/ok_two_buffers.glb", 0),
        ("bad/ok_repeated_index.glb", 0),
    ] {
        let streamed = compare(&Path::new(MODELS).join(name), max_mesh_bytes);
        assert!(
            streamed > 0,
            "{name} has no mesh above {max_mesh_bytes} bytes"
        );
    }
}

const WIDE: u32 = 600;
const HIGH: u32 = 500;

/// A sheet of 600 000 triangles, more than two pieces, in a .gltf with a .bin beside it. `shuffled`: its triangles stand
/// in an order that has nothing to do with that of its vertices. `holes`: some of its normals have no length.
fn sheet(folder: &Path, shuffled: bool, holes: bool) -> PathBuf {
    let row = WIDE + 1;
    let mut vertices = Vec::new();
    for y in 0..=HIGH {
        for x in 0..row {
            let z = ((x * 31 + y * 17) % 101) as f32 * 0.01;
            let (u, v) = (x as f32 / 600.0, y as f32 / 500.0);
            // Not of unit length, so that reading changes them.
            let normal = match holes && (x + y) % 29 == 0 {
                true => [0.0; 3],
                false => [z, 1.0, 2.0],
            };
            vertices.extend([x as f32, y as f32, z]);
            vertices.extend(normal);
            vertices.extend([u, v]);
        }
    }
    let mut triangles = Vec::new();
    for y in 0..HIGH {
        for x in 0..WIDE {
            let a = y * row + x;
            triangles.extend([[a, a + 1, a + row], [a + row, a + 1, a + row + 1]]);
        }
    }
    if shuffled {
        let count = triangles.len() as u64;
        // 7919 is a prime and divides no count here: every triangle comes once.
        let order = (0..count).map(|at| (at * 7919 % count) as usize);
        triangles = order.map(|at| triangles[at]).collect();
    }
    let mut bin: Vec<u8> = bytemuck::cast_slice(&vertices).to_vec();
    let index_offset = bin.len();
    bin.extend(bytemuck::cast_slice::<_, u8>(&triangles));
    let vertex_count = vertices.len() / 8;
    let accessor = |offset: usize, kind: &str| json!({"bufferView": 0, "byteOffset": offset, "componentType": 5126, "type": kind, "count": vertex_count});
    let document = json!({
        "asset": {"version": "2.0"}, "nodes": [{"mesh": 0}],
        "meshes": [{"name": "sheet", "primitives": [{
            "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}, "indices": 3,
        }]}],
        "accessors": [
            accessor(0, "VEC3"), accessor(12, "VEC3"), accessor(24, "VEC2"),
            {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": triangles.len() * 3},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": index_offset, "byteStride": 32},
            {"buffer": 0, "byteOffset": index_offset, "byteLength": bin.len() - index_offset},
        ],
        "buffers": [{"uri": "sheet.bin", "byteLength": bin.len()}],
    });
    std::fs::write(folder.join("sheet.bin"), bin).unwrap();
    let path = folder.join("sheet.gltf");
    std::fs::write(&path, document.to_string()).unwrap();
    path
}

#[test]
fn pieces_of_one_large_primitive_are_the_loaded_mesh() {
    for shuffled in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let path = sheet(folder.path(), shuffled, false);
        assert_eq!(compare(&path, 1 << 20), 1);
        assert_eq!(compare(&path, u64::MAX), 0);
        let opened = open(&path, &OpenOptions::with_max_mesh_bytes(1 << 20)).unwrap();
        let OpenedMesh::Streamed(mesh) = &opened.meshes[0] else {
            panic!("loaded");
        };
        assert_eq!(mesh.piece_count(), 3);
        assert_eq!(mesh.triangle_count(), 600_000);
        let notes = mesh.warnings();
        assert!(notes.is_empty(), "{notes:?}");
        mesh.piece(1).unwrap();
        mesh.piece(1).unwrap();
        let notes = mesh.warnings();
        assert!(
            notes[0].starts_with("normals brought to unit length: "),
            "{notes:?}"
        );
        assert!(
            notes[0].ends_with("(at meshes[0].primitives[0])"),
            "{notes:?}"
        );
    }
}

/// Unusable normals are made from all triangles around them, those of other pieces included.
#[test]
fn normals_of_no_length_are_mended_over_all_pieces() {
    let folder = tempfile::tempdir().unwrap();
    let path = sheet(folder.path(), true, true);
    assert_eq!(compare(&path, 0), 1);
    let opened = open(&path, &OpenOptions::with_max_mesh_bytes(0)).unwrap();
    let OpenedMesh::Streamed(mesh) = &opened.meshes[0] else {
        panic!("loaded");
    };
    mesh.piece(2).unwrap();
    let notes = mesh.warnings();
    let mended = notes
        .iter()
        .any(|it| it.starts_with("normals of no length made anew: "));
    assert!(mended, "{notes:?}");
}

#[test]
fn vertices_between_pieces_are_bit_by_bit_equal() {
    let folder = tempfile::tempdir().unwrap();
    let path = sheet(folder.path(), false, false);
    let opened = open(&path, &OpenOptions::with_max_mesh_bytes(0)).unwrap();
    let pieces: Vec<_> = (0..2)
        .map(|at| opened.meshes[0].piece(at).unwrap())
        .collect();
    let vertices = |piece: &Mesh| {
        let normals = piece.normals.clone().unwrap();
        let both = piece.positions.clone().into_iter().zip(normals);
        both.map(|(position, normal)| (position.map(f32::to_bits), normal.map(f32::to_bits)))
            .collect::<std::collections::HashMap<_, _>>()
    };
    let (first, second) = (vertices(&pieces[0]), vertices(&pieces[1]));
    let shared: Vec<_> = first
        .iter()
        .filter(|it| second.contains_key(it.0))
        .collect();
    assert!(shared.len() > WIDE as usize / 2, "{}", shared.len());
    assert!(
        shared
            .iter()
            .all(|(position, normal)| second[*position] == **normal)
    );
}

/// What is wrong in a streamed mesh is said when its piece is read, with the file and the place.
#[test]
fn faults_of_a_piece_name_file_and_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = sheet(folder.path(), false, false);
    let bin = folder.path().join("sheet.bin");
    let whole = std::fs::read(&bin).unwrap();
    let options = OpenOptions::with_max_mesh_bytes(0);
    let mut bytes = whole.clone();
    let last = bytes.len() - 4;
    bytes[last..].copy_from_slice(&u32::MAX.to_le_bytes());
    std::fs::write(&bin, &bytes).unwrap();
    let scene = open(&path, &options).unwrap();
    assert!(scene.meshes[0].piece(0).is_ok());
    let error = scene.meshes[0].piece(2).unwrap_err().to_string();
    assert!(
        error.contains("sheet.gltf: meshes[0].primitives[0].indices (accessor 3)"),
        "{error}"
    );
    assert!(
        error.contains("the restart value, at element 1799999"),
        "{error}"
    );
    assert!(import(&path).is_err());

    let mut bytes = whole.clone();
    bytes[4..8].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(&bin, &bytes).unwrap();
    let scene = open(&path, &options).unwrap();
    let error = scene.meshes[0].piece(0).unwrap_err().to_string();
    assert!(
        error.contains("attributes.POSITION (accessor 0): expected finite numbers"),
        "{error}"
    );
    assert!(
        scene.meshes[0]
            .piece(3)
            .unwrap_err()
            .to_string()
            .contains("a piece below 3")
    );

    // The file becomes shorter after it was opened.
    let scene = open(&path, &options).unwrap();
    std::fs::write(&bin, &whole[..whole.len() / 2]).unwrap();
    let error = scene.meshes[0].piece(2).unwrap_err().to_string();
    assert!(
        error.contains("cannot read") && error.contains("sheet.bin"),
        "{error}"
    );
    let error = open(&path, &options).unwrap_err().to_string();
    assert!(error.contains("buffers[0]: expected byteLength"), "{error}");
}
