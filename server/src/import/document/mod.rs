//! Document: the objects of glTF 2.0 that the import reads, numbers in f64.

mod members;

use serde::de::IgnoredAny;

use members::members;
pub(super) use members::{Amount, Attributes, Index, Name, Tolerant, Whole};

members! {
    /// The whole document.
    struct Root {
        "accessors" accessors: Vec<Tolerant<Accessor>>,
        "animations" animations: Amount,
        "asset" asset: Option<Asset>,
        "bufferViews" buffer_views: Vec<BufferView>,
        "buffers" buffers: Vec<Buffer>,
        "cameras" cameras: Amount,
        "extensionsRequired" extensions_required: Vec<String>,
        "extensionsUsed" extensions_used: Vec<String>,
        "images" images: Vec<Tolerant<Image>>,
        "materials" materials: Vec<Tolerant<Material>>,
        "meshes" meshes: Vec<Mesh>,
        "nodes" nodes: Vec<Tolerant<Node>>,
        "samplers" samplers: Vec<Tolerant<Sampler>>,
        "scene" scene: Option<Index>,
        "scenes" scenes: Vec<Scene>,
        "skins" skins: Vec<Skin>,
        "textures" textures: Vec<Tolerant<Texture>>,
    }

    struct Asset {
        "minVersion" min_version: Option<String>,
        "version" version: Option<String>,
    }

    struct Accessor {
        "bufferView" buffer_view: Option<Index>,
        "byteOffset" byte_offset: Whole,
        "componentType" component_type: Option<Whole>,
        "count" count: Option<Whole>,
        "normalized" normalized: bool,
        "sparse" sparse: Option<Box<Sparse>>,
        "type" kind: Option<String>,
    }

    struct Sparse {
        "count" count: Option<Whole>,
        "indices" indices: SparsePart,
        "values" values: SparsePart,
    }

    struct SparsePart {
        "bufferView" buffer_view: Option<Index>,
        "byteOffset" byte_offset: Whole,
        "componentType" component_type: Option<Whole>,
    }

    struct Buffer {
        "byteLength" byte_length: Option<Whole>,
        "extensions" extensions: Option<Box<Extensions>>,
        "uri" uri: Option<String>,
    }

    struct BufferView {
        "buffer" buffer: Option<Index>,
        "byteLength" byte_length: Option<Whole>,
        "byteOffset" byte_offset: Whole,
        "byteStride" byte_stride: Option<Whole>,
        "extensions" extensions: Option<Box<Extensions>>,
    }

    struct Image {
        "bufferView" buffer_view: Option<Index>,
        "name" name: Name,
        "uri" uri: Option<String>,
    }

    struct Material {
        "alphaCutoff" alpha_cutoff: Option<f64>,
        "alphaMode" alpha_mode: Option<String>,
        "doubleSided" double_sided: bool,
        "emissiveFactor" emissive_factor: [f64; 3],
        "emissiveTexture" emissive_texture: Option<IgnoredAny>,
        "extensions" extensions: Option<Box<Extensions>>,
        "name" name: Name,
        "normalTexture" normal_texture: Option<IgnoredAny>,
        "occlusionTexture" occlusion_texture: Option<IgnoredAny>,
        "pbrMetallicRoughness" surface: MetallicRoughness,
    }

    struct MetallicRoughness {
        "baseColorFactor" base_color_factor: Option<[f64; 4]>,
        "baseColorTexture" base_color_texture: Option<TextureInfo>,
        "metallicFactor" metallic_factor: Option<f64>,
        "metallicRoughnessTexture" metallic_roughness_texture: Option<IgnoredAny>,
        "roughnessFactor" roughness_factor: Option<f64>,
    }

    struct TextureInfo {
        "extensions" extensions: Option<Box<Extensions>>,
        "index" index: Option<Index>,
        "texCoord" uv_set: Option<Index>,
    }

    struct Mesh {
        "name" name: Name,
        "primitives" primitives: Vec<Primitive>,
        "weights" weights: Vec<f64>,
    }

    struct Primitive {
        "attributes" attributes: Attributes,
        "extensions" extensions: Option<Box<Extensions>>,
        "indices" indices: Option<Index>,
        "material" material: Option<Index>,
        "mode" mode: Option<Whole>,
        "targets" targets: Vec<Attributes>,
    }

    struct Node {
        "children" children: Vec<Index>,
        "extensions" extensions: Option<Box<Extensions>>,
        "matrix" matrix: Option<Box<[f64; 16]>>,
        "mesh" mesh: Option<Index>,
        "rotation" rotation: Option<[f64; 4]>,
        "scale" scale: Option<[f64; 3]>,
        "skin" skin: Option<Index>,
        "translation" translation: Option<[f64; 3]>,
        "weights" weights: Vec<f64>,
    }

    struct Sampler {
        "magFilter" mag_filter: Option<Whole>,
        "wrapS" wrap_s: Option<Whole>,
        "wrapT" wrap_t: Option<Whole>,
    }

    struct Scene {
        "name" name: Name,
        "nodes" nodes: Vec<Index>,
    }

    struct Skin {
        "inverseBindMatrices" inverse_bind_matrices: Option<Index>,
        "joints" joints: Vec<Index>,
    }

    struct Texture {
        "extensions" extensions: Option<Box<Extensions>>,
        "sampler" sampler: Option<Index>,
        "source" source: Option<Index>,
    }

    /// The extensions of any object.
    struct Extensions {
        "EXT_mesh_gpu_instancing" instancing: Option<Instancing>,
        "EXT_meshopt_compression" ext_meshopt: Option<Box<Meshopt>>,
        "EXT_texture_avif" avif: Option<TextureSource>,
        "EXT_texture_webp" webp: Option<TextureSource>,
        "KHR_draco_mesh_compression" draco: Option<IgnoredAny>,
        "KHR_materials_emissive_strength" emissive_strength: Option<EmissiveStrength>,
        "KHR_materials_pbrSpecularGlossiness" specular_glossiness: Option<Box<SpecularGlossiness>>,
        "KHR_materials_unlit" unlit: Option<IgnoredAny>,
        "KHR_meshopt_compression" khr_meshopt: Option<Box<Meshopt>>,
        "KHR_node_visibility" visibility: Option<Visibility>,
        "KHR_texture_basisu" basisu: Option<TextureSource>,
        "KHR_texture_transform" texture_transform: Option<Box<TextureTransform>>,
        "MSFT_texture_dds" dds: Option<TextureSource>,
        ..others
    }

    struct Instancing {
        "attributes" attributes: Option<Attributes>,
    }

    /// Of a buffer view, but for `fallback`, which a buffer has.
    struct Meshopt {
        "buffer" buffer: Option<Index>,
        "byteLength" byte_length: Option<Whole>,
        "byteOffset" byte_offset: Whole,
        "byteStride" byte_stride: Option<Whole>,
        "count" count: Option<Whole>,
        "fallback" fallback: bool,
        "filter" filter: Option<String>,
        "mode" mode: Option<String>,
    }

    struct EmissiveStrength {
        "emissiveStrength" strength: Option<f64>,
    }

    struct SpecularGlossiness {
        "diffuseFactor" diffuse_factor: Option<[f64; 4]>,
        "diffuseTexture" diffuse_texture: Option<TextureInfo>,
        "glossinessFactor" glossiness_factor: Option<f64>,
        "specularFactor" specular_factor: Option<[f64; 3]>,
        "specularGlossinessTexture" specular_glossiness_texture: Option<IgnoredAny>,
    }

    struct Visibility {
        "visible" visible: Option<bool>,
    }

    struct TextureSource {
        "source" source: Option<Index>,
    }

    struct TextureTransform {
        "offset" offset: [f64; 2],
        "rotation" rotation: f64,
        "scale" scale: Option<[f64; 2]>,
        "texCoord" uv_set: Option<Index>,
    }
}

impl Accessor {
    /// Elements that it claims, 0 where it does not say.
    pub(super) fn claimed_count(&self) -> u64 {
        self.count.unwrap_or_default().0
    }

    /// The same of the sparse ones.
    pub(super) fn claimed_sparse_count(&self) -> u64 {
        let sparse = self.sparse.as_ref().and_then(|sparse| sparse.count);
        sparse.unwrap_or_default().0
    }
}

impl BufferView {
    /// Bytes that it claims, 0 where it does not say.
    pub(super) fn claimed_bytes(&self) -> u64 {
        self.byte_length.unwrap_or_default().0
    }
}

impl<T> Tolerant<T> {
    /// The object, unless it cannot be read.
    pub(super) fn read(&self) -> Option<&T> {
        self.0.as_ref().ok()
    }
}
