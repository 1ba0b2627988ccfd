//! Several imported files as one scene: everything appended, indices moved, equal images once.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lodestream_format::ContentHash;
use lodestream_format::scene::{AlphaMode, Material, MediaType, TextureUse, Wrap};

use crate::import::{self, OpenedMesh, OpenedScene};

/// All inputs.
#[derive(Debug, Default)]
pub(super) struct Merged {
    pub meshes: Vec<MergedMesh>,
    /// Index into `meshes`, and the rows of world from object.
    pub instances: Vec<(usize, [[f64; 4]; 3])>,
    pub materials: Vec<Material>,
    pub images: Vec<MergedImage>,
    pub source_triangles: u64,
    pub warnings: Vec<String>,
    image_known: HashMap<ContentHash, u32>,
}

/// A mesh of the merged scene.
#[derive(Debug)]
pub(super) struct MergedMesh {
    pub file: Arc<Path>,
    /// Index of the file among the inputs.
    pub input: u32,
    /// Slot to index into [`Merged::materials`]; those of `mesh` itself count in its file.
    pub material_slots: Vec<u32>,
    pub triangles: u64,
    pub mesh: OpenedMesh,
}

/// An image file.
#[derive(Debug)]
pub(super) struct MergedImage {
    pub bytes: Vec<u8>,
    pub media_type: MediaType,
    pub width: u32,
    pub height: u32,
}

impl Merged {
    /// Appends what `file`, the input of index `input`, holds.
    pub(super) fn add(&mut self, file: &Path, input: u32, scene: OpenedScene) {
        let first_mesh = self.meshes.len();
        let first_material = self.materials.len() as u32;
        let images: Vec<u32> = scene.images.into_iter().map(|i| self.image(i)).collect();
        self.materials
            .extend(scene.materials.into_iter().map(|m| material(m, &images)));
        let file_of: Arc<Path> = PathBuf::from(file).into();
        self.meshes.extend(scene.meshes.into_iter().map(|mesh| {
            MergedMesh {
                file: Arc::clone(&file_of),
                input,
                material_slots: mesh
                    .material_slots()
                    .iter()
                    .map(|slot| slot + first_material)
                    .collect(),
                triangles: mesh.triangle_count(),
                mesh,
            }
        }));
        self.instances
            .extend(scene.instances.iter().map(|instance| {
                let map = instance.world_from_object;
                let rows = std::array::from_fn(|row| {
                    let linear = map.matrix3.row(row);
                    [linear.x, linear.y, linear.z, map.translation[row]]
                });
                (first_mesh + instance.mesh as usize, rows)
            }));
        self.source_triangles += scene.source_triangles;
        self.warn(file, &scene.warnings);
    }

    /// Appends what reading the pieces of a mesh has shown.
    pub(super) fn warn_of(&mut self, mesh: &MergedMesh) {
        if let OpenedMesh::Streamed(streamed) = &mesh.mesh {
            self.warn(&mesh.file, &streamed.warnings());
        }
    }

    fn warn(&mut self, file: &Path, lines: &[String]) {
        // Published with the scene: the folder on the ingesting machine is nobody's business.
        let name = file.file_name().unwrap_or(file.as_os_str()).display();
        self.warnings
            .extend(lines.iter().map(|line| format!("{name}: {line}")));
    }

    fn image(&mut self, image: import::Image) -> u32 {
        let hash = ContentHash::of(&image.bytes);
        *self.image_known.entry(hash).or_insert_with(|| {
            self.images.push(MergedImage {
                media_type: match image.media_type {
                    import::MediaType::Png => MediaType::Png,
                    import::MediaType::Jpeg => MediaType::Jpeg,
                },
                bytes: image.bytes,
                width: image.width,
                height: image.height,
            });
            self.images.len() as u32 - 1
        })
    }
}

fn material(from: import::Material, images: &[u32]) -> Material {
    let wrap = |wrap| match wrap {
        import::SamplerWrap::Repeat => Wrap::Repeat,
        import::SamplerWrap::Clamp => Wrap::Clamp,
        import::SamplerWrap::Mirror => Wrap::Mirror,
    };
    let base_color = from
        .base_color_image
        .and_then(|image| images.get(image as usize))
        .map(|&texture| TextureUse {
            texture,
            wrap: [wrap(from.wrap_u), wrap(from.wrap_v)],
            nearest: from.nearest,
            uv_transform: from
                .uv_transform
                .map_or(TextureUse::IDENTITY, |[a, b, c, d, e, f]| {
                    [[a, b, c], [d, e, f]]
                }),
        });
    Material {
        name: from.name,
        base_color_factor: from.base_color_factor,
        base_color,
        emissive_factor: from.emissive_factor,
        metallic: from.metallic,
        roughness: from.roughness,
        alpha_mode: match from.alpha_mode {
            import::AlphaMode::Opaque => AlphaMode::Opaque,
            import::AlphaMode::Mask(cutoff) => AlphaMode::Mask { cutoff },
            import::AlphaMode::Blend => AlphaMode::Blend,
        },
        double_sided: from.double_sided,
        unlit: from.unlit,
    }
}
