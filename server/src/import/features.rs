//! Features: which extensions the file needs, and what of it this reader leaves out.

use gltf::json::Root;
use gltf::json::mesh::{Mode, Primitive};
use gltf::json::validation::Checked;

use super::decompress;
use super::error::{Read, short, unsupported};
use super::warnings::Warnings;

pub(super) const QUANTIZATION: &str = "KHR_mesh_quantization";
pub(super) const INSTANCING: &str = "EXT_mesh_gpu_instancing";
const READ: &[&str] = &[
    QUANTIZATION,
    INSTANCING,
    decompress::NAMES[0],
    decompress::NAMES[1],
    "KHR_texture_transform",
    "KHR_materials_unlit",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
];
const DRACO: &str = "KHR_draco_mesh_compression";
/// They change how a surface looks and never its shape, so that a file which requires them is read without them;
/// `materials` notes each use.
pub(super) const LOOKS: &[&str] = &[
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_variants",
    "KHR_materials_volume",
];

/// Whether the file lists the extension as used or required.
pub(super) fn names(root: &Root, extension: &str) -> bool {
    let mut listed = root.extensions_used.iter().chain(&root.extensions_required);
    listed.any(|it| it == extension)
}

/// Refuses a file that needs what this reader lacks; notes the rest.
pub(super) fn check(root: &Root, warnings: &mut Warnings) -> Read<()> {
    for (at, extension) in root.extensions_required.iter().enumerate() {
        let extension = extension.as_str();
        if READ.contains(&extension) || LOOKS.contains(&extension) {
            continue;
        }
        let advice = match extension {
            DRACO => "decompress the file first, or export it without mesh compression",
            _ => "export the file without requiring it",
        };
        let place = format!("extensionsRequired[{at}]");
        let what = format!("the required extension {}", short(extension));
        return Err(unsupported(place, what, advice));
    }
    for (at, extension) in root.extensions_used.iter().enumerate() {
        let extension = extension.as_str();
        // Draco beside plain data costs nothing; `check_primitive` refuses it where the plain data is not there.
        let quiet = [READ, LOOKS, &[DRACO]]
            .iter()
            .any(|it| it.contains(&extension));
        if !quiet {
            let what = format!("optional extension {} not read", short(extension));
            warnings.add(what, 1, &format!("extensionsUsed[{at}]"));
        }
    }
    let variants = root.extensions.as_ref().map(|it| &it.others);
    let variants = variants.and_then(|it| it.get("KHR_materials_variants"));
    warnings.add(
        "KHR_materials_variants left out, primitives show their first material",
        u64::from(variants.is_some()),
        "extensions",
    );
    let left_out = |warnings: &mut Warnings, what: &str, amount: usize| {
        warnings.add(format!("{what} left out"), amount as u64, what);
    };
    left_out(warnings, "animations", root.animations.len());
    left_out(warnings, "cameras", root.cameras.len());
    warnings.add(
        "skins left out, meshes stand in their bind pose",
        root.skins.len() as u64,
        "skins",
    );
    Ok(())
}

/// Refuses a primitive whose data is only there compressed by Draco.
pub(super) fn check_primitive(
    root: &Root,
    primitive: &Primitive,
    place: &str,
    warnings: &mut Warnings,
) -> Read<()> {
    let extensions = primitive.extensions.as_ref().map(|it| &it.others);
    if !extensions.is_some_and(|it| it.contains_key(DRACO)) {
        return Ok(());
    }
    let accessors = primitive.attributes.values().chain(&primitive.indices);
    let is_plain = |index: usize| {
        let accessor = root.accessors.get(index);
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

/// The name of a primitive's mode where it has no triangles.
pub(super) fn mode_without_triangles(mode: Checked<Mode>) -> Option<&'static str> {
    match mode {
        Checked::Valid(Mode::Points) => Some("POINTS"),
        Checked::Valid(Mode::Lines) => Some("LINES"),
        Checked::Valid(Mode::LineLoop) => Some("LINE_LOOP"),
        Checked::Valid(Mode::LineStrip) => Some("LINE_STRIP"),
        _ => None,
    }
}
