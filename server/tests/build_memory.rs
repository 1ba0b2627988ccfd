//! A build through the disk, and of a source in pieces, is the build in memory.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod build_support;

use std::borrow::Cow;

use build_support::meshes;
use lodestream_server::build::{
    BuildOptions, BuildSite, BuiltAsset, Neighbours, Pack, build, build_at, decode_pages,
};
use lodestream_server::import::{ImportError, Mesh, MeshSource};

/// The bytes depend neither on where clusters wait between the stages nor on how the source is cut into pieces.
#[test]
fn bytes_do_not_depend_on_memory() {
    /// Runs of a mesh's triangles, each over the vertices that it uses.
    struct Cut<'a>(&'a Mesh, usize);

    impl MeshSource for Cut<'_> {
        fn name(&self) -> &str {
            &self.0.name
        }

        fn material_slot_count(&self) -> usize {
            self.0.material_slots.len()
        }

        fn piece_count(&self) -> usize {
            self.0.triangles.len().div_ceil(self.1)
        }

        fn piece(&self, index: usize) -> Result<Cow<'_, Mesh>, ImportError> {
            let Self(mesh, length) = self;
            let range = index * length..mesh.triangles.len().min((index + 1) * length);
            let mut used: Vec<u32> = mesh.triangles[range.clone()].concat();
            used.sort_unstable();
            used.dedup();
            let number = |vertex: u32| used.binary_search(&vertex).unwrap() as u32;
            fn of<T: Copy>(all: &[T], used: &[u32]) -> Vec<T> {
                used.iter().map(|&vertex| all[vertex as usize]).collect()
            }
            Ok(Cow::Owned(Mesh {
                name: String::new(),
                positions: of(&mesh.positions, &used),
                normals: mesh.normals.as_ref().map(|all| of(all, &used)),
                uvs: mesh.uvs.as_ref().map(|all| of(all, &used)),
                colors: mesh.colors.as_ref().map(|all| of(all, &used)),
                triangles: mesh.triangles[range.clone()]
                    .iter()
                    .map(|corners| corners.map(number))
                    .collect(),
                triangle_materials: mesh.triangle_materials[range].to_vec(),
                material_slots: mesh.material_slots.clone(),
            }))
        }
    }

    let folder = tempfile::tempdir().unwrap();
    // More than one bucket and more than one chunk of clusters.
    for mesh in [meshes::torus(900, 160), meshes::two_material_box(60)] {
        let site = BuildSite {
            scratch: Some(folder.path()),
            ..BuildSite::default()
        };
        let options = BuildOptions::default();
        let whole = build(&mesh, &options).unwrap();
        let through_disk = build_at(&mesh, &options, &Neighbours::default(), site).unwrap();
        let in_pieces =
            build_at(Cut(&mesh, 7_919), &options, &Neighbours::default(), site).unwrap();
        for other in [&through_disk, &in_pieces] {
            assert_eq!(whole.asset_bytes, other.asset_bytes, "{}", mesh.name);
            let frames = |built: &BuiltAsset| {
                let forms = decode_pages(built).unwrap();
                forms
                    .iter()
                    .map(|form| form.words().to_vec())
                    .collect::<Vec<_>>()
            };
            assert_eq!(frames(&whole), frames(other));
        }
        assert!(matches!(through_disk.pack, Pack::File(_)));
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
