//! Features: which extensions the file needs, and what of it this reader leaves out.

use gltf::json::Root;
use gltf::json::mesh::Mode;
use gltf::json::validation::Checked;

use super::error::{Read, unsupported};
use super::warnings::Warnings;

pub(super) const QUANTIZATION: &str = "KHR_mesh_quantization";
pub(super) const INSTANCING: &str = "EXT_mesh_gpu_instancing";
const READ: &[&str] = &[
    QUANTIZATION,
    INSTANCING,
    "KHR_texture_transform",
    "KHR_materials_unlit",
    "KHR_materials_emissive_strength",
];

/// Whether the file lists the extension as used or required.
pub(super) fn names(root: &Root, extension: &str) -> bool {
    let mut listed = root.extensions_used.iter().chain(&root.extensions_required);
    listed.any(|it| it == extension)
}

/// Refuses a file that needs what this reader lacks; notes the rest.
pub(super) fn check(root: &Root, warnings: &mut Warnings) -> Read<()> {
    for (at, extension) in root.extensions_required.iter().enumerate() {
        if READ.contains(&extension.as_str()) {
            continue;
        }
        let advice = match extension.as_str() {
            "KHR_draco_mesh_compression"
            | "EXT_meshopt_compression"
            | "KHR_meshopt_compression" => "export the file without mesh compression",
            _ => "export the file without requiring it",
        };
        let place = format!("extensionsRequired[{at}]");
        let what = format!("the required extension {extension}");
        return Err(unsupported(place, what, advice));
    }
    for (at, extension) in root.extensions_used.iter().enumerate() {
        if !READ.contains(&extension.as_str()) {
            let what = format!("optional extension {extension} not read");
            warnings.add(what, 1, &format!("extensionsUsed[{at}]"));
        }
    }
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
