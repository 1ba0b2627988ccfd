//! Import: a model file becomes an [`ImportedScene`] of plain vectors, or an [`OpenedScene`] whose large meshes stay in
//! their files.
//!
//! glTF 2.0 (`.glb`, `.gltf`), one file a stage:
//! `container` (chunks) -> `json` (`document`) -> `features` (extensions) -> `buffers` (`uri`) ->
//! `nodes` -> `accessor` -> `primitive` -> `mesh` (`attributes`, `pose`, `complete`, `normals`) ->
//! `materials`, `images`.
//!
//! Mesh files: `obj` (with its `mtl`), `ply`, `stl`, each one mesh (`plain`): `polygons` cuts their
//! faces, `origin` keeps the shape of what lies far from the origin.
//!
//! `document` only types the JSON, in f64. The `gltf` crate gives the codes and judges exports in a
//! test; its own document is f32 and refuses files for members without a reader. Each index and
//! range is checked here, with its place in the document, before it is followed: no input can
//! panic, loop or allocate beyond what its own
//! bytes account for, or than [`OpenOptions::memory_limit_bytes`]: `allowance` keeps that account,
//! `walk` counts the JSON and `sharing` the accessors. A fault is one error; what is left out is a
//! line in [`ImportedScene::warnings`].
//!
//! # Meshes larger than memory
//!
//! [`open`] with [`OpenOptions::max_mesh_bytes`] leaves a mesh in its file whose arrays would take more than that: it becomes
//! an [`OpenedMesh::Streamed`], a [`MeshSource`] of pieces of at most 2^18 triangles, each with its own vertex array. Files
//! are read by position, a bounded buffer at a time, and never whole.
//!
//! ```no_run
//! use lodestream_server::import::{MeshSource, OpenOptions, open};
//! # fn show() -> Result<(), lodestream_server::import::ImportError> {
//! let scene = open("scan.ply".as_ref(), &OpenOptions::with_max_mesh_bytes(256 << 20))?;
//! for mesh in &scene.meshes {
//!     for index in 0..mesh.piece_count() {
//!         println!("{}: {} triangles", mesh.name(), mesh.piece(index)?.triangles.len());
//!     }
//! }
//! # Ok(())
//! # }
//! ```

mod accessor;
mod allowance;
mod attributes;
mod buffers;
mod color;
mod complete;
mod container;
mod decodable;
mod decompress;
mod document;
mod error;
mod features;
mod file;
mod images;
mod json;
mod materials;
mod mender;
mod mesh;
mod nodes;
mod normals;
mod obj;
mod opened;
mod origin;
mod plain;
mod ply;
mod polygons;
mod pose;
mod primitive;
mod primitive_pieces;
mod rows;
mod scene;
mod sharing;
mod source;
mod stl;
mod text;
mod uri;
mod used;
mod walk;
mod warnings;
mod weld;

#[cfg(test)]
mod tests;

use std::path::Path;

use rayon::prelude::*;

use allowance::Allowance;
use buffers::Buffers;
use document::Root;
use error::Read;
use file::{Extent, InputFile};
use warnings::Warnings;

pub use error::{Fault, ImportError};
pub(crate) use images::dimensions;
pub use opened::{MAX_IMAGE_PIXELS, OpenOptions, OpenedMesh, OpenedScene, StreamedMesh};
pub use scene::{
    AlphaMode, Image, ImportedScene, Instance, Material, MediaType, Mesh, SamplerWrap,
};
pub use source::MeshSource;

/// The document beside the bytes that its views cut out of: what every stage reads.
struct Document<'a> {
    root: &'a Root,
    buffers: &'a Buffers,
    /// Integer positions, normals and unnormalised texture coordinates are allowed.
    quantized: bool,
}

/// Reads the file at `path`, with the buffers, images and material libraries that it names, all into memory.
///
/// A glTF's scene is the file's default one, else its first, else all its root nodes; a file without nodes gives one
/// instance for each of its meshes. An `.obj`, `.ply` or `.stl` gives one mesh. A file without
/// triangles gives an empty scene.
///
/// # Errors
/// One line that names the file, the place in it, what was expected and what was found. External files are read only from
/// the folder of `path` and below it; nothing is ever fetched.
pub fn import(path: &Path) -> Result<ImportedScene, ImportError> {
    open(path, &OpenOptions::default())?.into_imported()
}

/// Reads the file at `path` as [`import`] does, but leaves meshes in their files whose arrays would take more than
/// `options.max_mesh_bytes`.
///
/// # Errors
/// As [`import`]. What is wrong in a streamed mesh shows when its pieces are read.
pub fn open(path: &Path, options: &OpenOptions) -> Result<OpenedScene, ImportError> {
    let in_file = |fault| ImportError::new(path, fault);
    let mut scene = open_file(path, options).map_err(in_file)?;
    for mesh in &mut scene.meshes {
        if let OpenedMesh::Streamed(mesh) = mesh {
            mesh.set_file(path.to_owned());
        }
    }
    Ok(scene)
}

fn open_file(path: &Path, options: &OpenOptions) -> Read<OpenedScene> {
    let file = Extent::file(InputFile::open(path, "file")?);
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let allowance = Allowance::new(folder, options);
    match Format::of(path, &file)? {
        Format::Gltf => read_gltf(&file, &allowance, &name, options),
        Format::Obj => obj::read(&file, &allowance, &name),
        Format::Ply => ply::read(&file, &allowance, &name, options),
        Format::Stl => stl::read(&file, &allowance, &name, options),
    }
}

/// What a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Gltf,
    Obj,
    Ply,
    Stl,
}

impl Format {
    /// By a magic where the file has one, else by its extension, else by what its first bytes look like.
    fn of(path: &Path, file: &Extent) -> Read<Self> {
        const HEAD_BYTES: u64 = 512;
        let head = file.head(HEAD_BYTES)?;
        if head.starts_with(b"glTF") {
            return Ok(Self::Gltf);
        }
        let head = text::without_mark(&head);
        if ply::is_ply(head) {
            return Ok(Self::Ply);
        }
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        Ok(match extension.to_str() {
            Some("glb" | "gltf") => Self::Gltf,
            Some("obj") => Self::Obj,
            Some("ply") => Self::Ply,
            Some("stl") => Self::Stl,
            _ if stl::is_binary(file)? || stl::looks_like_text(head) => Self::Stl,
            _ if obj::looks_like_text(head) => Self::Obj,
            // A JSON object, or something whose error names what it is not.
            _ => Self::Gltf,
        })
    }
}

/// Reads the glTF in `file`; `name` stands in for a scene without a name.
fn read_gltf(
    file: &Extent,
    allowance: &Allowance,
    name: &str,
    options: &OpenOptions,
) -> Read<OpenedScene> {
    let mut warnings = Warnings::default();
    let container = container::split(file, allowance, &mut warnings)?;
    let root = json::parse(&container.json, allowance)?;
    features::check(&root, &mut warnings)?;

    let bin = container.bin.as_ref();
    let buffers = Buffers::open(&root, bin, allowance, &mut warnings)?;
    let document = Document {
        root: &root,
        buffers: &buffers,
        quantized: features::names(&root, features::QUANTIZATION),
    };
    let placed = nodes::place(&document, allowance, &mut warnings)?;
    sharing::check(&document, &placed, allowance)?;
    let built = build_meshes(&document, &placed, allowance, options.max_mesh_bytes)?;

    let mut scene = OpenedScene {
        name: placed.scene_name.clone().unwrap_or_else(|| name.to_owned()),
        ..OpenedScene::default()
    };
    let mut mesh_of_shape = vec![None; placed.shapes.len()];
    let mut default_material = false;
    for (shape, built) in built.into_iter().enumerate() {
        warnings.merge(built.warnings);
        scene.source_triangles += built.source_triangles;
        let Some(mesh) = built.mesh else { continue };
        default_material |= mesh
            .material_slots()
            .iter()
            .any(|&material| material as usize == root.materials.len());
        mesh_of_shape[shape] = Some(scene.meshes.len() as u32);
        scene.meshes.push(mesh);
    }
    // Instances of meshes that hold no triangle go with their mesh, which the warnings name already.
    scene.instances = placed
        .instances
        .into_iter()
        .filter_map(|instance| {
            let mesh = mesh_of_shape[instance.mesh as usize]?;
            Some(Instance { mesh, ..instance })
        })
        .collect();
    (scene.materials, scene.images) =
        materials::read(&document, allowance, default_material, &mut warnings);
    scene.warnings = warnings.into_lines();
    Ok(scene)
}

/// Builds every shape, in their order whatever the thread count; the first fault in that
/// order is the one told. Meshes that would not fit beside the others stay in their files, however
/// small they are.
fn build_meshes(
    document: &Document,
    placed: &nodes::Placed,
    allowance: &Allowance,
    most_mesh_bytes: u64,
) -> Read<Vec<mesh::BuiltMesh>> {
    // Half for meshes that are loaded, half for the normals of those that are loaded at the time.
    let most = allowance.left_bytes() / 2;
    let (mut loaded, mut making, mut batch) = (0u64, 0u64, 0);
    let mut sources = Vec::new();
    for shape in &placed.shapes {
        let need = sharing::Need::of(document, shape.mesh);
        let fits = need.making_bytes <= most && loaded.saturating_add(need.array_bytes) <= most;
        if fits {
            loaded += need.array_bytes;
            making = making.saturating_add(need.making_bytes);
            if making > most {
                (making, batch) = (need.making_bytes, batch + 1);
            }
        }
        sources.push((batch, shape, if fits { most_mesh_bytes } else { 0 }));
    }
    let mut built = Vec::with_capacity(sources.len());
    for beside in sources.chunk_by(|a, b| a.0 == b.0) {
        let some: Vec<Read<mesh::BuiltMesh>> = beside
            .par_iter()
            .map(|&(_, shape, most_bytes)| mesh::build(document, shape, most_bytes))
            .collect();
        for one in some {
            built.push(one?);
        }
    }
    Ok(built)
}
