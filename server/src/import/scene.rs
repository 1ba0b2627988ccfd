//! The imported scene: plain vectors, nothing of the file's format left. The conventions are glTF's: right-handed, +Y up,
//! metres, `v` down.

use glam::DAffine3;

/// A name of the file's, cut where it is longer than any name should be: names are published and
/// quoted.
pub(super) fn short_name(name: &str) -> String {
    const MOST_CHARS: usize = 256;
    match name.char_indices().nth(MOST_CHARS) {
        None => name.to_owned(),
        Some((end, _)) => format!("{}…", &name[..end]),
    }
}

/// A whole file: meshes once, and where they stand.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImportedScene {
    /// The scene's name in the file, else the file's name without its extension.
    pub name: String,
    /// Meshes with at least one triangle and at least one instance, in the file's order. Shared ones stand here once.
    pub meshes: Vec<Mesh>,
    /// In the order of a depth-first walk over the nodes.
    pub instances: Vec<Instance>,
    /// The file's materials in the file's order; glTF's default material follows where a primitive names none.
    pub materials: Vec<Material>,
    /// The images that a material's base colour uses, each once.
    pub images: Vec<Image>,
    /// What was left out or changed, one line a kind, with the amount and the first place.
    pub warnings: Vec<String>,
    /// Triangles of [`ImportedScene::meshes`] as the file has them, each mesh counted once: with the triangles of lists that
    /// repeat an index (kept out of [`Mesh::triangles`]), without those that only stitch strips and fans.
    pub source_triangles: u64,
}

/// One mesh: the primitives of a glTF mesh merged over one vertex array, or all of a mesh file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// The file's name for it, else `mesh_N`.
    pub name: String,
    /// Object space, finite. Every vertex is used by a triangle.
    pub positions: Vec<[f32; 3]>,
    /// Unit length; as long as `positions`. Made where the file has none, so `None` only in a mesh without triangles and in the
    /// pieces of a [`StreamedMesh`](super::StreamedMesh).
    pub normals: Option<Vec<[f32; 3]>>,
    /// `TEXCOORD_0`, finite, as long as `positions`; `None` where no primitive has it.
    pub uvs: Option<Vec<[f32; 2]>>,
    /// `COLOR_0` as linear RGBA, 255 is 1; as long as `positions`; `None` where no primitive has it.
    pub colors: Option<Vec<[u8; 4]>>,
    /// Counter-clockwise, three different indices into the vertex arrays. The area may be zero.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle its index into `material_slots`.
    pub triangle_materials: Vec<u16>,
    /// Slot to index into [`ImportedScene::materials`]; each material at most once.
    pub material_slots: Vec<u32>,
}

/// A mesh at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Index into [`ImportedScene::meshes`].
    pub mesh: u32,
    /// Finite; may mirror, shear, or be singular.
    pub world_from_object: DAffine3,
}

/// A surface: glTF's metallic-roughness model with its base-colour texture.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The file's name for it; may be empty.
    pub name: String,
    /// Linear RGBA in 0..=1, times the texture and the vertex colour.
    pub base_color_factor: [f32; 4],
    /// sRGB with linear alpha; index into [`ImportedScene::images`].
    pub base_color_image: Option<u32>,
    /// How `u` beyond 0..1 is read.
    pub wrap_u: SamplerWrap,
    /// How `v` beyond 0..1 is read.
    pub wrap_v: SamplerWrap,
    /// Magnify without filtering.
    pub nearest: bool,
    /// Rows `[a, b, c, d, e, f]`: `u' = a u + b v + c`, `v' = d u + e v + f`.
    pub uv_transform: Option<[f32; 6]>,
    /// What alpha means.
    pub alpha_mode: AlphaMode,
    /// Back faces are seen.
    pub double_sided: bool,
    /// Base colour as is, without light.
    pub unlit: bool,
    /// Linear RGB, already times the emissive strength; may exceed 1.
    pub emissive_factor: [f32; 3],
    /// 0..=1.
    pub metallic: f32,
    /// 0..=1.
    pub roughness: f32,
}

impl Default for Material {
    /// glTF's default material.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color_factor: [1.0; 4],
            base_color_image: None,
            wrap_u: SamplerWrap::Repeat,
            wrap_v: SamplerWrap::Repeat,
            nearest: false,
            uv_transform: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            unlit: false,
            emissive_factor: [0.0; 3],
            metallic: 1.0,
            roughness: 1.0,
        }
    }
}

/// Texture addressing beyond 0..1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SamplerWrap {
    /// Tiles.
    #[default]
    Repeat,
    /// Holds the edge texel.
    Clamp,
    /// Tiles, every other one mirrored.
    Mirror,
}

/// What a material's alpha means.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Nothing.
    #[default]
    Opaque,
    /// Seen where alpha is at least this cutoff.
    Mask(f32),
    /// Blended over what is behind.
    Blend,
}

/// An encoded image, as it stands in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// By its content, not by what the file says.
    pub media_type: MediaType,
    /// The PNG or JPEG file.
    pub bytes: Vec<u8>,
    /// From the image's header; at least 1.
    pub width: u32,
    /// From the image's header; at least 1.
    pub height: u32,
}

/// Encodings of [`Image::bytes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MediaType {
    /// `image/png`
    Png,
    /// `image/jpeg`
    Jpeg,
}

impl MediaType {
    /// The registered name, as in HTTP.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Jpeg => "image/jpeg",
        }
    }
}
