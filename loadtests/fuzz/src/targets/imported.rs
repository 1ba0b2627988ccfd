//! What an import promises of the scene that it gives, whatever the file.

use std::path::PathBuf;

use lodestream_server::import::{ImportedScene, Mesh, MeshSource, OpenOptions, import, open};

use super::input::folder;

/// Imports a file of this name and these bytes, whole and in pieces.
pub fn import_file(name: &str, bytes: &[u8]) {
    let file: PathBuf = folder("import").join(name);
    std::fs::write(&file, bytes).expect("writes");
    let whole = import(&file);
    match &whole {
        Ok(scene) => check(scene),
        // One line, that names the file first.
        Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
    }
    // As an upload is read: nothing beside it, and little memory.
    let bounded = OpenOptions {
        self_contained: true,
        memory_limit_bytes: Some(16 << 20),
        ..OpenOptions::with_max_mesh_bytes(2 << 20)
    };
    match open(&file, &bounded) {
        Ok(scene) => assert!(scene.warnings.len() <= 101),
        Err(error) => assert!(error.to_string().chars().count() < 1000, "{error}"),
    }
    let pieces = OpenOptions::with_max_mesh_bytes(0);
    let opened = match open(&file, &pieces) {
        Ok(opened) => opened,
        // The vertices of a mesh whose triangles all repeat an index are not looked at when it is
        // read whole: a list says so, a strip leaves a mesh without triangles.
        Err(error) => {
            let unread = |scene: &ImportedScene| {
                let warnings = scene.warnings.concat();
                warnings.contains("repeated index") || warnings.contains("without triangles")
            };
            assert!(
                whole.map_or(true, |scene| unread(&scene)),
                "only whole: {error}"
            );
            return;
        }
    };
    let Ok(whole) = whole else {
        // What is wrong shows when pieces are read, or only when all of the mesh is.
        for mesh in &opened.meshes {
            let _ = (0..mesh.piece_count()).try_for_each(|it| mesh.piece(it).map(|_| ()));
        }
        return;
    };
    assert_eq!(opened.source_triangles, whole.source_triangles);
    let mut triangles = 0;
    for mesh in &opened.meshes {
        for index in 0..mesh.piece_count() {
            let piece = mesh.piece(index).expect("whole it can be read");
            check_mesh(&piece, mesh.material_slot_count());
            triangles += piece.triangles.len();
        }
    }
    let own: usize = whole.meshes.iter().map(|mesh| mesh.triangles.len()).sum();
    assert_eq!(triangles, own);
}

fn check(scene: &ImportedScene) {
    for mesh in &scene.meshes {
        assert!(!mesh.triangles.is_empty());
        check_mesh(mesh, mesh.material_slots.len());
        let mut slots = mesh.material_slots.clone();
        slots.sort_unstable();
        slots.dedup();
        assert_eq!(slots.len(), mesh.material_slots.len());
        assert!(
            slots
                .iter()
                .all(|&it| (it as usize) < scene.materials.len())
        );
        let normals = mesh.normals.as_ref().expect("made where there are none");
        for normal in normals {
            let length = normal.iter().map(|it| it * it).sum::<f32>().sqrt();
            assert!((length - 1.0).abs() < 1e-3, "{normal:?}");
        }
        let mut used = vec![false; mesh.positions.len()];
        for &corner in mesh.triangles.iter().flatten() {
            used[corner as usize] = true;
        }
        assert!(used.iter().all(|&it| it));
    }
    for instance in &scene.instances {
        assert!((instance.mesh as usize) < scene.meshes.len());
        assert!(instance.world_from_object.is_finite());
    }
    for material in &scene.materials {
        let image = material.base_color_image;
        assert!(image.is_none_or(|it| (it as usize) < scene.images.len()));
        let factors = material
            .base_color_factor
            .iter()
            .chain([&material.metallic, &material.roughness]);
        assert!(factors.copied().all(|it| (0.0..=1.0).contains(&it)));
    }
    assert!(scene.images.iter().all(|it| it.width > 0 && it.height > 0));
    let listed: usize = scene.meshes.iter().map(|it| it.triangles.len()).sum();
    assert!(scene.source_triangles >= listed as u64);
    assert!(scene.warnings.iter().all(|line| !line.contains('\n')));
}

fn check_mesh(mesh: &Mesh, slots: usize) {
    let count = mesh.positions.len();
    let lengths = [
        mesh.normals.as_ref().map(Vec::len),
        mesh.uvs.as_ref().map(Vec::len),
        mesh.colors.as_ref().map(Vec::len),
    ];
    assert!(lengths.into_iter().flatten().all(|it| it == count));
    assert!(mesh.positions.iter().flatten().all(|it| it.is_finite()));
    assert!(mesh.uvs.iter().flatten().flatten().all(|it| it.is_finite()));
    for &[a, b, c] in &mesh.triangles {
        assert!(a != b && b != c && c != a);
        assert!((a.max(b).max(c) as usize) < count);
    }
    assert_eq!(mesh.triangle_materials.len(), mesh.triangles.len());
    let material = |&slot: &u16| usize::from(slot) < slots.max(1);
    assert!(mesh.triangle_materials.iter().all(material));
}
