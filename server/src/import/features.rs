//! Features: which extensions the file needs, and what of it this reader leaves out.

use super::decompress;
use super::document::{Primitive, Root, Tolerant};
use super::error::{Read, short, unsupported};
use super::warnings::Warnings;

pub(super) const QUANTIZATION: &str = "KHR_mesh_quantization";
pub(super) const INSTANCING: &str = "EXT_mesh_gpu_instancing";
pub(super) const SPECULAR_GLOSSINESS: &str = "KHR_materials_pbrSpecularGlossiness";
const READ: &[&str] = &[
    QUANTIZATION,
    INSTANCING,
    decompress::NAMES[0],
    decompress::NAMES[1],
    "KHR_texture_transform",
    "KHR_materials_unlit",
    "KHR_materials_emissive_strength",
    SPECULAR_GLOSSINESS,
    "KHR_node_visibility",
];
const DRACO: &str = "KHR_draco_mesh_compression";
/// Kinds of extensions, as they stand behind the vendor's prefix, that change how surfaces look,
/// how they are lit, or how a scene behaves, and never their shape: a file that requires one is
/// read without it. Other words may follow a kind.
const HARMLESS_KINDS: &[&str] = &[
    "animation_",
    "articulations",
    "audio",
    "bim_data",
    "blend",
    "camera_",
    "collider",
    "collision_shapes",
    "components",
    "displaymapping",
    "environment",
    "feature_metadata",
    "geometry_metadata",
    "haptic",
    "hubs",
    "image_based_lighting",
    "image_ortho",
    "implicit_shapes",
    "instance_features",
    "interactivity",
    "lightmap",
    "lights",
    "lights_",
    "link",
    "lod",
    "material_",
    "materials_",
    "media",
    "mesh_features",
    "mesh_manifold",
    "mesh_primitive_edge_visibility",
    "metadata",
    "ngon_encoding",
    "node_constraint",
    "node_hoverability",
    "node_selectability",
    "normal_map_convention",
    "packing_",
    "personality",
    "physics",
    "primitive_outline",
    "seat",
    "single_root",
    "spawn_point",
    "springBone",
    "stk_metadata",
    "structural_metadata",
    "tags",
    "techniques_webgl",
    "temporal_light_traits",
    "texture_",
    "textureInfo",
    "tilt_brush_material",
    "vehicle",
    "vrm",
    "VRM",
    "xmp",
];

/// Whether surfaces keep their shape without the extension.
fn is_harmless(extension: &str) -> bool {
    // `VRM` has no vendor.
    let kind = extension.split_once('_').map_or(extension, |it| it.1);
    HARMLESS_KINDS.iter().any(|harmless| {
        let rest = kind.strip_prefix(harmless);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('_') || harmless.ends_with('_'))
    })
}

/// Whether the file lists the extension as used or required.
pub(super) fn names(root: &Root, extension: &str) -> bool {
    let mut listed = root.extensions_used.iter().chain(&root.extensions_required);
    listed.any(|it| it == extension)
}

/// Refuses a file that needs what this reader lacks; notes the rest.
pub(super) fn check(root: &Root, warnings: &mut Warnings) -> Read<()> {
    for (at, extension) in root.extensions_required.iter().enumerate() {
        let extension = extension.as_str();
        let place = format!("extensionsRequired[{at}]");
        if READ.contains(&extension) {
            continue;
        }
        if is_harmless(extension) {
            note(extension, &place, warnings);
            continue;
        }
        let advice = match extension {
            DRACO => "decompress the file first, or export it without mesh compression",
            _ => "export the file without requiring it",
        };
        let what = format!("the required extension {}", short(extension));
        return Err(unsupported(place, what, advice));
    }
    for (at, extension) in root.extensions_used.iter().enumerate() {
        // Draco beside plain data costs nothing; `check_primitive` refuses it where the plain data is not there.
        if !READ.contains(&extension.as_str()) && extension != DRACO {
            note(extension, &format!("extensionsUsed[{at}]"), warnings);
        }
    }
    for (what, amount) in [
        ("animations", root.animations.0),
        ("cameras", root.cameras.0),
    ] {
        warnings.add(format!("{what} left out"), amount, what);
    }
    Ok(())
}

/// Notes an extension that is not read; a material and the lists of the document give one line.
pub(super) fn note(extension: &str, place: &str, warnings: &mut Warnings) {
    warnings.add(format!("extension {} left out", short(extension)), 1, place);
}

/// Refuses a primitive whose data is only there compressed by Draco.
pub(super) fn check_primitive(
    root: &Root,
    primitive: &Primitive,
    place: &str,
    warnings: &mut Warnings,
) -> Read<()> {
    let extensions = primitive.extensions.as_ref();
    if extensions.is_none_or(|it| it.draco.is_none()) {
        return Ok(());
    }
    let accessors = primitive.attributes.0.values().chain(&primitive.indices);
    let is_plain = |index: usize| {
        let accessor = root.accessors.get(index).and_then(Tolerant::read);
        accessor.is_none_or(|it| it.buffer_view.is_some() || it.sparse.is_some())
    };
    let mut indices = accessors.map(|accessor| accessor.value());
    if indices.all(is_plain) {
        let what = format!("{DRACO} left out, the plain data beside it read");
        warnings.add(what, 1, place);
        return Ok(());
    }
    let advice = "decompress the file first, or export it without mesh compression";
    Err(unsupported(place, DRACO, advice))
}
