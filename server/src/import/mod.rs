//! Import: a glTF 2.0 file (`.glb` or `.gltf`) becomes an [`ImportedScene`] of plain vectors.
//!
//! The way of the data, one file a stage:
//! `container` (chunks) -> `json` (document) -> `features` (extensions) -> `buffers` (`uri`) ->
//! `accessor` -> `primitive` -> `mesh` (`attributes`, `normals`) -> `nodes`, `materials`, `images`.
//!
//! The `gltf` crate only types the JSON. It trusts every index and range in it, so each one is checked here,
//! with its place in the document, before it is followed: no input can panic, loop or allocate beyond what its own
//! bytes account for. What cannot be read is one error; what is left out is a line in [`ImportedScene::warnings`].

mod accessor;
mod attributes;
mod buffers;
mod container;
mod error;
mod features;
mod images;
mod json;
mod materials;
mod mesh;
mod nodes;
mod normals;
mod primitive;
mod scene;
mod source;
mod uri;
mod warnings;

#[cfg(test)]
mod tests;

use std::path::Path;

use gltf::json::Root;
use rayon::prelude::*;

use buffers::Buffers;
use error::{Read, cannot_read};
use warnings::Warnings;

pub use error::{Fault, ImportError};
pub use scene::{
    AlphaMode, Image, ImportedScene, Instance, Material, MediaType, Mesh, SamplerWrap,
};
pub use source::MeshSource;

/// The document beside the bytes that its views cut out of: what every stage reads.
struct Document<'a> {
    root: &'a Root,
    buffers: &'a Buffers<'a>,
    /// Integer positions, normals and unnormalised texture coordinates are allowed.
    quantized: bool,
}

/// Reads the glTF file at `path`, with its buffers and images.
///
/// The scene is the file's default one, else its first, else all its root nodes; a file without nodes gives one
/// instance for each of its meshes. A file without triangles gives an empty scene.
///
/// # Errors
/// One line that names the file, the place in it, what was expected and what was found. External files are read only from
/// the folder of `path` and below it; nothing is ever fetched.
pub fn import(path: &Path) -> Result<ImportedScene, ImportError> {
    let in_file = |fault| ImportError::new(path, fault);
    let bytes = std::fs::read(path).map_err(|cause| in_file(cannot_read("file", path, &cause)))?;
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    read(&bytes, folder, &name).map_err(in_file)
}

/// Reads the glTF in `bytes`; `folder` holds its external files, `name` stands in for a scene without a name.
fn read(bytes: &[u8], folder: &Path, name: &str) -> Read<ImportedScene> {
    let mut warnings = Warnings::default();
    let container = container::split(bytes, &mut warnings)?;
    let root = json::parse(container.json)?;
    features::check(&root, &mut warnings)?;

    let buffers = Buffers::load(&root, container.bin, folder)?;
    let document = Document {
        root: &root,
        buffers: &buffers,
        quantized: features::names(&root, features::QUANTIZATION),
    };
    let placed = nodes::place(&document, &mut warnings)?;
    mesh::check_sharing(&document, &placed)?;
    let built = build_meshes(&document, &placed)?;

    let mut scene = ImportedScene {
        name: placed.scene_name.clone().unwrap_or_else(|| name.to_owned()),
        ..ImportedScene::default()
    };
    let mut mesh_of_source = vec![None; root.meshes.len()];
    let mut default_material = false;
    for (source, built) in built {
        warnings.merge(built.warnings);
        scene.source_triangles += built.source_triangles;
        let Some(mesh) = built.mesh else { continue };
        default_material |= mesh
            .material_slots
            .iter()
            .any(|&material| material as usize == root.materials.len());
        mesh_of_source[source] = Some(scene.meshes.len() as u32);
        scene.meshes.push(mesh);
    }
    // Instances of meshes that hold no triangle go with their mesh, which the warnings name already.
    scene.instances = placed
        .instances
        .into_iter()
        .filter_map(|instance| {
            let mesh = mesh_of_source[instance.mesh as usize]?;
            Some(Instance { mesh, ..instance })
        })
        .collect();
    (scene.materials, scene.images) =
        materials::read(&document, folder, default_material, &mut warnings)?;
    scene.warnings = warnings.into_lines();
    Ok(scene)
}

/// Builds every placed mesh, in the file's order whatever the thread count; the first fault in that order is the one told.
fn build_meshes(
    document: &Document,
    placed: &nodes::Placed,
) -> Read<Vec<(usize, mesh::BuiltMesh)>> {
    let sources: Vec<usize> = (0..document.root.meshes.len())
        .filter(|&source| placed.mesh_used[source])
        .collect();
    let built: Vec<Read<mesh::BuiltMesh>> = sources
        .par_iter()
        .map(|&source| mesh::build(document, source))
        .collect();
    sources
        .into_iter()
        .zip(built)
        .map(|(source, built)| Ok((source, built?)))
        .collect()
}
