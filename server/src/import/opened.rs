//! Opened scene: like an imported one, but its large meshes stay in their files.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard};

use super::error::Read;
use super::mender::Mender;
use super::scene::{Image, ImportedScene, Instance, Material, Mesh};
use super::source::MeshSource;
use super::used::Used;
use super::warnings::Warnings;
use super::{ImportError, attributes};

/// What a caller of [`open`](super::open) chooses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OpenOptions {
    /// A mesh whose arrays might take more bytes than this, normals included, stays in its file. `.glb`, `.gltf`, binary
    /// `.stl` and binary `.ply` allow that; from `.obj` and from text everything is loaded.
    pub max_mesh_bytes: u64,
    /// Nothing but the file itself is opened. References to other files are refused for geometry,
    /// and left out with a warning for images and material libraries; whether such a file exists is
    /// not looked at.
    pub self_contained: bool,
    /// Most pixels of an image; one with more is left out with a warning. All images may have 16
    /// times as many, or 64 for each of their bytes.
    pub max_image_pixels: u64,
    /// Refuse what would take more memory than this, whatever is read in pieces.
    pub memory_limit_bytes: Option<u64>,
}

/// [`OpenOptions::max_image_pixels`] by default: those of 16,384 x 16,384.
pub const MAX_IMAGE_PIXELS: u64 = 1 << 28;

impl OpenOptions {
    /// Meshes of more bytes stay in their files; all else as by default.
    pub fn with_max_mesh_bytes(max_mesh_bytes: u64) -> Self {
        Self {
            max_mesh_bytes,
            ..Self::default()
        }
    }
}

impl Default for OpenOptions {
    /// Everything is loaded.
    fn default() -> Self {
        Self {
            max_mesh_bytes: u64::MAX,
            self_contained: false,
            max_image_pixels: MAX_IMAGE_PIXELS,
            memory_limit_bytes: None,
        }
    }
}

/// A whole file, as [`ImportedScene`] but for the meshes.
#[derive(Debug, Default)]
pub struct OpenedScene {
    /// See [`ImportedScene::name`].
    pub name: String,
    /// Meshes in the file's order, each with at least one triangle and one instance. A streamed one may turn out to have
    /// only triangles that repeat an index; its pieces are then without triangles.
    pub meshes: Vec<OpenedMesh>,
    /// `mesh` is an index into [`OpenedScene::meshes`].
    pub instances: Vec<Instance>,
    /// See [`ImportedScene::materials`].
    pub materials: Vec<Material>,
    /// See [`ImportedScene::images`].
    pub images: Vec<Image>,
    /// As [`ImportedScene::warnings`], without what only reading the pieces shows: [`StreamedMesh::warnings`] has that.
    pub warnings: Vec<String>,
    /// See [`ImportedScene::source_triangles`]; streamed meshes included.
    pub source_triangles: u64,
}

/// A mesh in memory or in its file.
#[derive(Debug)]
pub enum OpenedMesh {
    /// With all its attributes, normals among them.
    Loaded(Mesh),
    /// Read piece by piece.
    Streamed(StreamedMesh),
}

impl OpenedMesh {
    /// See [`Mesh::material_slots`].
    pub fn material_slots(&self) -> &[u32] {
        match self {
            Self::Loaded(mesh) => &mesh.material_slots,
            Self::Streamed(mesh) => &mesh.material_slots,
        }
    }

    /// Triangles, for a streamed mesh with those that repeat an index and that its pieces leave out.
    pub fn triangle_count(&self) -> u64 {
        match self {
            Self::Loaded(mesh) => mesh.triangles.len() as u64,
            Self::Streamed(mesh) => mesh.triangle_count,
        }
    }

    /// All of the mesh in memory. The pieces of a streamed one stand side by side, the vertices on their borders twice.
    ///
    /// # Errors
    /// What reading a piece says.
    pub fn into_mesh(self) -> Result<Mesh, ImportError> {
        let streamed = match self {
            Self::Loaded(mesh) => return Ok(mesh),
            Self::Streamed(streamed) => streamed,
        };
        let mut whole = Mesh {
            name: streamed.name.clone(),
            material_slots: streamed.material_slots.clone(),
            ..Mesh::default()
        };
        for index in 0..streamed.piece_count() {
            let piece = streamed.read(index)?;
            let base = whole.positions.len() as u32;
            whole.positions.extend(piece.positions);
            extend(&mut whole.normals, piece.normals);
            extend(&mut whole.uvs, piece.uvs);
            extend(&mut whole.colors, piece.colors);
            let moved = |triangle: [u32; 3]| triangle.map(|corner| base + corner);
            whole
                .triangles
                .extend(piece.triangles.into_iter().map(moved));
            whole.triangle_materials.extend(piece.triangle_materials);
        }
        Ok(whole)
    }
}

fn extend<T>(all: &mut Option<Vec<T>>, more: Option<Vec<T>>) {
    if let Some(more) = more {
        all.get_or_insert_default().extend(more);
    }
}

impl MeshSource for OpenedMesh {
    fn name(&self) -> &str {
        match self {
            Self::Loaded(mesh) => &mesh.name,
            Self::Streamed(mesh) => &mesh.name,
        }
    }

    fn material_slot_count(&self) -> usize {
        self.material_slots().len()
    }

    fn piece_count(&self) -> usize {
        match self {
            Self::Loaded(_) => 1,
            Self::Streamed(mesh) => mesh.piece_count(),
        }
    }

    fn piece(&self, index: usize) -> Result<Cow<'_, Mesh>, ImportError> {
        match self {
            Self::Loaded(mesh) => Ok(Cow::Borrowed(mesh)),
            Self::Streamed(mesh) => mesh.piece(index),
        }
    }
}

impl OpenedScene {
    /// Everything in memory.
    ///
    /// # Errors
    /// What reading a streamed mesh says.
    pub fn into_imported(self) -> Result<ImportedScene, ImportError> {
        let meshes: Result<Vec<Mesh>, ImportError> =
            self.meshes.into_iter().map(OpenedMesh::into_mesh).collect();
        Ok(ImportedScene {
            name: self.name,
            meshes: meshes?,
            instances: self.instances,
            materials: self.materials,
            images: self.images,
            warnings: self.warnings,
            source_triangles: self.source_triangles,
        })
    }
}

/// Most triangles of a piece: with their vertices some 30 MB.
pub(super) const PIECE_TRIANGLES: u64 = 1 << 18;

/// Where the pieces of a mesh come from.
pub(super) trait Pieces: Send + Sync {
    fn count(&self) -> usize;

    fn read(&self, index: usize, warnings: &mut Warnings) -> Read<Piece>;
}

/// A piece as its file has it.
pub(super) struct Piece {
    /// Without name and slots; unusable normals have no length.
    pub(super) mesh: Mesh,
    /// Which of the file's vertex arrays its vertices are of.
    pub(super) array: u32,
    /// Its vertices there; `None` where the file has none to speak of.
    pub(super) used: Option<Used>,
}

/// A mesh that stays in its file. It holds open files and offsets, some kilobytes a million triangles.
///
/// A piece has at most 2^18 triangles of the file's list, in its order, and its vertices in the order of first use. Pieces may be
/// read in any order and by many threads at once. Normals stand in the pieces only where all of the mesh has them.
///
/// What a file holds compressed or inline is held in memory.
pub struct StreamedMesh {
    name: String,
    material_slots: Vec<u32>,
    triangle_count: u64,
    file: PathBuf,
    pieces: Box<dyn Pieces>,
    /// Made when the first piece needs it.
    mender: Mutex<Option<Arc<Mender>>>,
    /// By piece: reading one again says the same again.
    notes: Mutex<BTreeMap<usize, Warnings>>,
}

impl StreamedMesh {
    pub(super) fn new(
        name: String,
        material_slots: Vec<u32>,
        triangle_count: u64,
        pieces: Box<dyn Pieces>,
    ) -> Self {
        Self {
            name,
            material_slots,
            triangle_count,
            file: PathBuf::new(),
            pieces,
            mender: Mutex::default(),
            notes: Mutex::default(),
        }
    }

    /// Names the file for errors.
    pub(super) fn set_file(&mut self, file: PathBuf) {
        self.file = file;
    }

    /// See [`Mesh::material_slots`].
    pub fn material_slots(&self) -> &[u32] {
        &self.material_slots
    }

    /// Triangles in the file, with those that repeat an index and that the pieces leave out.
    pub fn triangle_count(&self) -> u64 {
        self.triangle_count
    }

    /// What was left out or changed in the pieces that were read so far, in the mesh's order.
    pub fn warnings(&self) -> Vec<String> {
        let mut all = Warnings::default();
        for notes in self.notes().values() {
            all.merge(notes.clone());
        }
        all.into_lines()
    }

    fn notes(&self) -> MutexGuard<'_, BTreeMap<usize, Warnings>> {
        // Nothing panics while it is held; if something did, the notes were still whole.
        self.notes.lock().unwrap_or_else(|held| held.into_inner())
    }

    /// Other threads that need it wait for it.
    fn mender(&self) -> Read<Arc<Mender>> {
        let mut mender = self.mender.lock().unwrap_or_else(|held| held.into_inner());
        if let Some(mender) = &*mender {
            return Ok(mender.clone());
        }
        let made = Arc::new(Mender::new(&*self.pieces)?);
        *mender = Some(made.clone());
        Ok(made)
    }

    fn read(&self, index: usize) -> Result<Mesh, ImportError> {
        let mut warnings = Warnings::default();
        let mut read = || {
            let mut piece = self.pieces.read(index, &mut warnings)?;
            if Mender::is_needed(&piece) {
                self.mender()?.mend(&mut piece, &mut warnings);
            }
            Ok(piece.mesh)
        };
        let mut mesh = read().map_err(|fault| ImportError::new(&self.file, fault))?;
        mesh.name.clone_from(&self.name);
        mesh.material_slots.clone_from(&self.material_slots);
        if !warnings.is_empty() {
            self.notes().insert(index, warnings);
        }
        Ok(mesh)
    }
}

impl MeshSource for StreamedMesh {
    fn name(&self) -> &str {
        &self.name
    }

    fn material_slot_count(&self) -> usize {
        self.material_slots.len()
    }

    fn piece_count(&self) -> usize {
        self.pieces.count()
    }

    fn piece(&self, index: usize) -> Result<Cow<'_, Mesh>, ImportError> {
        self.read(index).map(Cow::Owned)
    }
}

impl fmt::Debug for StreamedMesh {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter
            .debug_struct("StreamedMesh")
            .field("name", &self.name)
            .field("file", &self.file)
            .field("triangle_count", &self.triangle_count)
            .field("piece_count", &self.pieces.count())
            .finish_non_exhaustive()
    }
}

/// Bytes of a mesh's arrays in memory, normals included: they are made where they are not there.
pub(super) fn array_bytes(vertices: u64, triangles: u64, with: attributes::Present) -> u64 {
    let vertex_bytes = 24 + 8 * u64::from(with.uvs) + 4 * u64::from(with.colors);
    let triangle_bytes = 12 + 2;
    vertices
        .saturating_mul(vertex_bytes)
        .saturating_add(triangles.saturating_mul(triangle_bytes))
}
