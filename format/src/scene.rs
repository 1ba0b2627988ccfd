//! A scene: instances, materials and textures over assets.

use bincode::Decode;
use bincode::de::Decoder;
use bincode::error::DecodeError;

use crate::error::{FormatError, ensure};
use crate::hash::ContentHash;
use crate::instances::{InstanceSteps, PackedInstances};
use crate::message;

const MAGIC: [u8; 4] = *b"LSS2";

/// An asset as a scene uses it.
#[derive(Debug, Clone, PartialEq, bincode::Encode, bincode::Decode)]
pub struct SceneAsset {
    /// The mesh's name in the source file.
    pub name: String,
    /// The [`crate::Asset`] object.
    pub asset: ContentHash,
    /// Index into [`Scene::materials`] of each material slot.
    pub materials: Vec<u32>,
    /// Steps on which its instances may lie.
    pub steps: InstanceSteps,
}

/// An asset placed in the world.
#[derive(Debug, Clone, PartialEq)]
pub struct Instance {
    /// Index into [`Scene::assets`].
    pub asset: u32,
    /// Affine map, row-major 3 x 4, metres. Any linear part, mirrored or singular too.
    pub world_from_object: [[f64; 4]; 3],
}

/// How a texture coordinate outside [0, 1) is brought back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, bincode::Encode, bincode::Decode)]
pub enum Wrap {
    /// Fractional part.
    #[default]
    Repeat,
    /// Nearest edge.
    Clamp,
    /// Forth and back.
    Mirror,
}

/// How alpha is used.
#[derive(Debug, Clone, Copy, PartialEq, Default, bincode::Encode, bincode::Decode)]
pub enum AlphaMode {
    /// Ignored.
    #[default]
    Opaque,
    /// Visible where alpha reaches the cutoff.
    Mask {
        /// Smallest visible alpha.
        cutoff: f32,
    },
    /// Blended over what lies behind.
    Blend,
}

/// A texture as a material uses it.
#[derive(Debug, Clone, PartialEq, bincode::Encode, bincode::Decode)]
pub struct TextureUse {
    /// Index into [`Scene::textures`].
    pub texture: u32,
    /// Wrapping of u and v.
    pub wrap: [Wrap; 2],
    /// Whether magnification takes the nearest texel.
    pub nearest: bool,
    /// Rows of the affine map from stored to looked-up coordinates.
    pub uv_transform: [[f32; 3]; 2],
}

impl TextureUse {
    /// The identity of [`TextureUse::uv_transform`].
    pub const IDENTITY: [[f32; 3]; 2] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
}

/// Metallic-roughness material of glTF, as far as it is drawn.
#[derive(Debug, Clone, PartialEq, bincode::Encode, bincode::Decode)]
pub struct Material {
    /// Name in the source file.
    pub name: String,
    /// Linear RGBA factor.
    pub base_color_factor: [f32; 4],
    /// sRGB base-colour texture.
    pub base_color: Option<TextureUse>,
    /// Linear RGB.
    pub emissive_factor: [f32; 3],
    /// 0..=1.
    pub metallic: f32,
    /// 0..=1.
    pub roughness: f32,
    /// Use of alpha.
    pub alpha_mode: AlphaMode,
    /// Whether back faces are lit as fronts.
    pub double_sided: bool,
    /// Whether the base colour is shown without light.
    pub unlit: bool,
}

/// Encoding of a texture object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bincode::Encode, bincode::Decode)]
pub enum MediaType {
    /// image/png
    Png,
    /// image/jpeg
    Jpeg,
}

/// A texture: an image file as an object of its own.
#[derive(Debug, Clone, PartialEq, Eq, bincode::Encode, bincode::Decode)]
pub struct Texture {
    /// The image file.
    pub object: ContentHash,
    /// Bytes of the image file.
    pub bytes: u64,
    /// Its encoding.
    pub media_type: MediaType,
    /// Width, texels.
    pub width: u32,
    /// Height, texels.
    pub height: u32,
}

/// Everything that a viewer needs beside the assets themselves.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// Assets, each once.
    pub assets: Vec<SceneAsset>,
    /// Placements. Those that the builder orders follow a curve through space: each run of 64 is
    /// near each other.
    pub instances: Vec<Instance>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Textures.
    pub textures: Vec<Texture>,
    /// Triangles of the source file's meshes, each mesh once.
    pub source_triangles: u64,
    /// What the import left out, one line each.
    pub warnings: Vec<String>,
}

impl Scene {
    /// The object's bytes; hash them for its name.
    pub fn encode(&self) -> Result<Vec<u8>, FormatError> {
        let stored = (
            &self.assets,
            PackedInstances::new(&self.assets, &self.instances)?,
            &self.materials,
            &self.textures,
            self.source_triangles,
            &self.warnings,
        );
        message::encode(MAGIC, stored)
    }

    /// Reads and checks a scene object.
    pub fn decode(bytes: &[u8]) -> Result<Self, FormatError> {
        Self::decode_within(bytes, u64::MAX)
    }

    /// Reads and checks a scene object that may take `memory_bytes` with its message.
    pub fn decode_within(bytes: &[u8], memory_bytes: u64) -> Result<Self, FormatError> {
        let StoredScene(mut scene, packed) = message::decode(MAGIC, bytes, memory_bytes)?;
        scene.check()?;
        let taken_bytes = scene.memory_bytes().saturating_add(packed.memory_bytes());
        let left_bytes = memory_bytes.saturating_sub(taken_bytes);
        scene.instances = packed.unpack(&scene.assets, left_bytes)?;
        Ok(scene)
    }

    /// Bytes that it takes in memory.
    pub fn memory_bytes(&self) -> u64 {
        let assets = self.assets.iter();
        let names = assets.map(|used| used.name.len() + size_of_val(&used.materials[..]));
        let materials = self.materials.iter().map(|material| material.name.len());
        let warnings = self.warnings.iter().map(String::len);
        let lists = size_of_val(&self.assets[..])
            + size_of_val(&self.instances[..])
            + size_of_val(&self.materials[..])
            + size_of_val(&self.textures[..])
            + size_of_val(&self.warnings[..]);
        (lists + names.sum::<usize>() + materials.sum::<usize>() + warnings.sum::<usize>()) as u64
    }

    fn check(&self) -> Result<(), FormatError> {
        let below = |at: String, count: usize, index: u32| {
            ensure(
                (index as usize) < count,
                &at,
                format_args!("below {count}"),
                index,
            )
        };
        for (index, asset) in self.assets.iter().enumerate() {
            for &material in &asset.materials {
                below(
                    format!("scene asset {index} material"),
                    self.materials.len(),
                    material,
                )?;
            }
            asset.steps.check(index)?;
        }
        for (index, material) in self.materials.iter().enumerate() {
            if let Some(texture) = &material.base_color {
                below(
                    format!("scene material {index} texture"),
                    self.textures.len(),
                    texture.texture,
                )?;
            }
            let numbers = material
                .base_color_factor
                .iter()
                .chain(&material.emissive_factor);
            ensure(
                numbers.copied().all(f32::is_finite),
                format_args!("scene material {index} factors"),
                "finite numbers",
                "another",
            )?;
        }
        Ok(())
    }
}

/// A scene without its instances, and these packed.
struct StoredScene(Scene, PackedInstances);

impl<Context> Decode<Context> for StoredScene {
    fn decode<D: Decoder<Context = Context>>(decoder: &mut D) -> Result<Self, DecodeError> {
        let assets = list(decoder)?;
        let packed = PackedInstances::decode(decoder)?;
        decoder.claim_bytes_read(packed.memory_bytes() as usize)?;
        let scene = Scene {
            assets,
            instances: Vec::new(),
            materials: list(decoder)?,
            textures: list(decoder)?,
            source_triangles: Decode::decode(decoder)?,
            warnings: list(decoder)?,
        };
        Ok(Self(scene, packed))
    }
}

/// A list whose memory stays counted: bincode alone takes it off its limit once the list is read,
/// and each list of a scene could then fill the whole limit.
fn list<Context, T: Decode<Context> + 'static, D: Decoder<Context = Context>>(
    decoder: &mut D,
) -> Result<Vec<T>, DecodeError> {
    let list: Vec<T> = Decode::decode(decoder)?;
    decoder.claim_bytes_read(size_of_val(&list[..]))?;
    Ok(list)
}
