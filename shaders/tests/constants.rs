//! Constants of the WGSL against those of Rust.

mod shader_module;

use std::collections::{BTreeMap, BTreeSet};

use lodestream_format::hierarchy::{Child, Group};
use lodestream_format::strips::mask;
use lodestream_shaders::types::*;
use shader_module::{constants, modules};

fn rust_constants() -> BTreeMap<&'static str, f64> {
    use lodestream_format::cluster::{Attributes, NO_GROUP};
    use lodestream_format::disk_form::{self, header_word, source_word};
    use lodestream_format::hierarchy::{LEAF_FLAG, NO_CHILD, ROOT_ERROR};
    use lodestream_format::limits::HIERARCHY_WIDTH;
    use lodestream_format::memory_form::{self, cluster_word, page_word};
    use lodestream_format::octahedral::NORMAL_BITS;
    use lodestream_shaders::cpu::{
        error_metric, mask_cutoffs, occlusion, prepare, proxy, raster_choice, snap, view, visit,
    };
    use lodestream_shaders::scene_rows::ROW_BYTES;
    use lodestream_shaders::types::NO_MASK_CUTOFFS;

    let whole = [
        ("NOT_INSTALLED", NOT_INSTALLED as usize),
        ("TRIANGLE_BITS", TRIANGLE_BITS as usize),
        ("VIEW_FLAG_REFERENCE", view_flag::REFERENCE as usize),
        ("WORKGROUP_THREADS", view::WORKGROUP_THREADS as usize),
        ("MAX_WORKGROUPS_X", view::MAX_WORKGROUPS_X as usize),
        ("NODE_THREADS", prepare::NODE_THREADS as usize),
        ("RASTER_VERTICES", prepare::RASTER_VERTICES as usize),
        ("HIERARCHY_WIDTH", HIERARCHY_WIDTH),
        ("VIEW_FLAG_OCCLUSION", view_flag::OCCLUSION as usize),
        ("VIEW_FLAG_LATE", view_flag::LATE as usize),
        (
            "MATERIAL_DOUBLE_SIDED",
            material_flag::DOUBLE_SIDED as usize,
        ),
        ("MATERIAL_UNLIT", material_flag::UNLIT as usize),
        ("MATERIAL_MASK", material_flag::MASK as usize),
        ("MATERIAL_NEAREST", material_flag::NEAREST as usize),
        ("MATERIAL_CLAMP_U", material_flag::CLAMP_U as usize),
        ("MATERIAL_CLAMP_V", material_flag::CLAMP_V as usize),
        ("MATERIAL_MIRROR_U", material_flag::MIRROR_U as usize),
        ("MATERIAL_MIRROR_V", material_flag::MIRROR_V as usize),
        ("NO_TEXTURE", NO_TEXTURE as usize),
        ("VIEW_FLAG_HARDWARE", view_flag::HARDWARE as usize),
        ("VIEW_FLAG_MASKED", view_flag::MASKED as usize),
        ("VIEW_FLAG_SECOND_ROUND", view_flag::SECOND_ROUND as usize),
        ("VIEW_FLAG_ORDERED", view_flag::ORDERED as usize),
        ("HIDDEN_FLAG", visit::HIDDEN_FLAG as usize),
        ("WHOLE_INSTANCE", visit::WHOLE_INSTANCE as usize),
        ("REQUEST_WORDS", visit::REQUEST_WORDS),
        ("MOST_TEXELS", occlusion::MOST_TEXELS as usize),
        ("ASSET_ROWS", size_of::<AssetRecord>() / ROW_BYTES),
        ("CHILD_ROWS", size_of::<Child>() / ROW_BYTES),
        ("GROUP_ROWS", size_of::<Group>() / ROW_BYTES),
        ("MATERIAL_ROWS", size_of::<MaterialRecord>() / ROW_BYTES),
        ("PROXY_ROWS", size_of::<ProxyRecord>() / ROW_BYTES),
        ("NO_ASSET", NO_ASSET as usize),
        ("POINT_FLAG", POINT_FLAG as usize),
        ("LEAF_FLAG", LEAF_FLAG as usize),
        ("NO_CHILD", NO_CHILD as usize),
        ("NO_GROUP", NO_GROUP as usize),
        ("NO_MASK_CUTOFFS", NO_MASK_CUTOFFS as usize),
        ("MOST_PRIORITY", error_metric::MOST_PRIORITY as usize),
        ("MAGIC", memory_form::MAGIC as usize),
        ("PAGE_HEADER_WORDS", memory_form::PAGE_HEADER_WORDS),
        ("CLUSTER_HEADER_WORDS", memory_form::CLUSTER_HEADER_WORDS),
        (
            "MATERIAL_TABLE_FLAG",
            memory_form::MATERIAL_TABLE_FLAG as usize,
        ),
        ("STRIP_WORDS_SHIFT", memory_form::STRIP_WORDS_SHIFT as usize),
        ("STRIP_MASK_NEW", mask::NEW),
        ("STRIP_MASK_RESTART", mask::RESTART),
        ("STRIP_MASK_TURN", mask::TURN),
        ("STRIP_MASKS", mask::COUNT),
        ("NORMAL_BITS", NORMAL_BITS as usize),
        ("PAGE_WORD_MAGIC", page_word::MAGIC),
        ("PAGE_WORD_CLUSTER_COUNT", page_word::CLUSTER_COUNT),
        ("PAGE_WORD_WORDS", page_word::WORDS),
        ("PAGE_WORD_ATTRIBUTES", page_word::ATTRIBUTES),
        ("PAGE_WORD_PAGE", page_word::PAGE),
        ("PAGE_WORD_TABLES", page_word::TABLES),
        ("CLUSTER_WORD_COUNTS", cluster_word::COUNTS),
        ("CLUSTER_WORD_ORIGIN", cluster_word::ORIGIN),
        ("CLUSTER_WORD_WIDTHS", cluster_word::WIDTHS),
        ("CLUSTER_WORD_COLOR_WIDTHS", cluster_word::COLOR_WIDTHS),
        ("CLUSTER_WORD_PAYLOAD", cluster_word::PAYLOAD),
        ("CLUSTER_WORD_UV_MIN", cluster_word::UV_MIN),
        ("CLUSTER_WORD_COLOR_MIN", cluster_word::COLOR_MIN),
        ("CLUSTER_WORD_MATERIALS", cluster_word::MATERIALS),
        ("CLUSTER_WORD_CHILD_GROUP", cluster_word::CHILD_GROUP),
        ("CLUSTER_WORD_GROUP", cluster_word::GROUP),
        ("CLUSTER_WORD_EXTENT", cluster_word::EXTENT),
        ("ATTRIBUTE_NORMAL", Attributes::NORMAL as usize),
        ("ATTRIBUTE_UV", Attributes::UV as usize),
        ("ATTRIBUTE_COLOR", Attributes::COLOR as usize),
        ("DISK_HEADER_WORDS", disk_form::HEADER_WORDS),
        ("DISK_COLUMNS", disk_form::COLUMNS),
        ("DISK_FIELDS", disk_form::FIELDS),
        ("DISK_WORD_ATTRIBUTES", header_word::ATTRIBUTES),
        ("DISK_WORD_CLUSTER_COUNT", header_word::CLUSTER_COUNT),
        ("DISK_WORD_PAGE", header_word::PAGE),
        ("DISK_WORD_VERTEX_COUNT", header_word::VERTEX_COUNT),
        ("DISK_WORD_TRIANGLE_COUNT", header_word::TRIANGLE_COUNT),
        ("DISK_WORD_TABLE_WORDS", header_word::TABLE_WORDS),
        ("DISK_WORD_MEMORY_WORDS", header_word::MEMORY_WORDS),
        ("DISK_WORD_PLANE_WIDTHS", header_word::PLANE_WIDTHS),
        (
            "CLUSTER_SPAN_WORDS",
            size_of::<disk_form::ClusterSpan>() / 4,
        ),
        ("DISK_WORD_REPEATED", header_word::REPEATED),
        ("DISK_WORD_INHERITED", header_word::INHERITED),
        ("DISK_WORD_ROUNDS", header_word::ROUNDS),
        ("DISK_WORD_STRIP_WORDS", header_word::STRIP_WORDS),
        ("DISK_ROUND_SHIFT", disk_form::ROUND_SHIFT as usize),
        ("FIELD_NORMAL", disk_form::field::NORMAL),
        ("FIELD_UV", disk_form::field::UV),
        ("FIELD_COLOR", disk_form::field::COLOR),
        ("SOURCE_BEYOND", source_word::BEYOND as usize),
        ("SOURCE_ANEW", source_word::ANEW as usize),
        ("SOURCE_REPEATED", source_word::REPEATED as usize),
        ("SOURCE_INHERITED", source_word::INHERITED as usize),
        ("SOURCE_KIND_SHIFT", source_word::KIND_SHIFT as usize),
        ("SURFACE_BITS", disk_form::SURFACE_BITS as usize),
        ("RESTORE_THREADS", view::RESTORE_THREADS as usize),
        ("TRANSCODE_THREADS", view::WORKGROUP_THREADS as usize),
        ("NORMALS_THREADS", view::WORKGROUP_THREADS as usize),
    ];
    let real = [
        ("MOST_EMISSIVE", proxy::MOST_EMISSIVE),
        ("CLUSTER_SLACK", view::CLUSTER_SLACK),
        ("GROUP_SLACK", view::GROUP_SLACK),
        ("NODE_SLACK", view::NODE_SLACK),
        ("MOST_COMPUTE_PX", raster_choice::MOST_COMPUTE_PX),
        ("LEAST_COMPUTE_NEARS", raster_choice::LEAST_COMPUTE_NEARS),
        ("SUBPIXELS", snap::SUBPIXELS),
        ("MOST_SNAPPED_PX", snap::MOST_SNAPPED_PX),
        ("PROJECTION_SLACK", occlusion::PROJECTION_SLACK),
        ("SNAP_PX", occlusion::SNAP_PX),
        ("DEPTH_SLACK", occlusion::DEPTH_SLACK),
        ("MOST_PX", occlusion::MOST_PX),
        ("ROOT_ERROR", ROOT_ERROR),
        ("LEVEL_SLACK", error_metric::LEVEL_SLACK),
        ("NODE_LEVEL", error_metric::NODE_LEVEL),
        ("SMALLEST_REQUEST_PX", error_metric::SMALLEST_REQUEST_PX),
        ("LARGEST_REQUEST_PX", error_metric::LARGEST_REQUEST_PX),
        ("ROOT_REQUEST_PX", error_metric::ROOT_REQUEST_PX),
        ("PRIORITY_UNITS_A_PX", error_metric::PRIORITY_UNITS_A_PX),
        ("ALPHA_SLACK", mask_cutoffs::ALPHA_SLACK),
        ("VERTEX_ALPHA_SLACK", mask_cutoffs::VERTEX_ALPHA_SLACK),
        ("MASK_SPREAD_PX", mask_cutoffs::MASK_SPREAD_PX),
        ("MASK_NOISE", mask_cutoffs::MASK_NOISE),
        ("CUTOFFS_A_MIP", mask_cutoffs::ENTRIES_A_MIP as f32),
    ];
    let whole = whole.map(|(name, value)| (name, value as f64));
    whole
        .into_iter()
        .chain(real.map(|(name, value)| (name, value as f64)))
        .collect()
}

/// Whether a test of `cpu::light` compares the constant.
fn is_of_light(name: &str) -> bool {
    ["_DIRECTION", "_RADIANCE", "_SRGB"]
        .iter()
        .any(|end| name.ends_with(end))
        || ["METAL_DIFFUSE", "SMALLEST_ROUGHNESS", "LARGEST_SPECULAR"].contains(&name)
}

#[test]
fn constants_are_rusts() {
    let rust = rust_constants();
    let mut met = BTreeSet::new();
    let mut found = BTreeSet::new();
    for (pass, module) in modules() {
        let of_culling = pass.name.starts_with("cull")
            || pass.name.starts_with("prepare")
            || pass.name.starts_with("restore")
            || ["transcode", "compact_requests"].contains(&pass.name);
        for (name, value) in constants(&module) {
            match rust.get(name.as_str()) {
                Some(&expected) if value == Some(expected) => _ = met.insert(name),
                Some(expected) => {
                    _ = found.insert(format!("{name}: {expected} in Rust, {value:?} in WGSL"))
                }
                None if of_culling && !is_of_light(&name) => {
                    _ = found.insert(format!("{name} of {} is compared with nothing", pass.name))
                }
                None => {}
            }
        }
    }
    found.extend(
        rust.keys()
            .filter(|name| !met.contains(**name))
            .map(|name| format!("{name}: in no pass")),
    );
    assert!(found.is_empty(), "\n{found:#?}");
}
