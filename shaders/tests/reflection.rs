//! WGSL against Rust by reflection: the layout of every struct that crosses the bus, the pass table, the constants.

mod shader_module;

use std::collections::{BTreeMap, BTreeSet};

use lodestream_format::hierarchy::{Child, Group, Part};
use lodestream_format::strips::mask;
use lodestream_shaders::passes::{
    ALL, Access, MAX_STORAGE_BUFFERS, MAX_WORKGROUP_BYTES, MAX_WORKGROUP_THREADS, PoolAccess,
};
use lodestream_shaders::types::*;
use naga::{AddressSpace, StorageAccess};
use shader_module::{Field, Kind, Layout, Member, constants, modules, structs};

/// A Rust struct as the GPU has to see it.
macro_rules! layout {
    ($type:ident { $($field:ident),* $(,)? }) => {{
        fn kind<F: Field>(_: impl Fn(&$type) -> &F) -> Kind { F::KIND }
        fn size<F>(_: impl Fn(&$type) -> &F) -> usize { size_of::<F>() }
        (stringify!($type), Layout {
            size: size_of::<$type>(),
            members: vec![$(Member {
                name: stringify!($field).to_owned(),
                offset: std::mem::offset_of!($type, $field),
                size: size(|value: &$type| &value.$field),
                kind: kind(|value: &$type| &value.$field),
            }),*],
        })
    }};
}

fn rust_structs() -> BTreeMap<&'static str, Layout> {
    BTreeMap::from([
        layout!(View {
            clip_from_rel,
            planes_in_rel,
            eye_high,
            pixel_error_px,
            eye_low,
            pixels_at_one_metre,
            forward,
            near_metres,
            size_px,
            instance_count,
            page_count,
            shade_mode,
            flags,
            node_capacity,
            cluster_capacity,
            request_capacity,
            corner_secant,
            node_row,
            group_row,
            part_row,
            slot_row,
            material_row,
            texture_row
        }),
        layout!(InstanceRecord {
            translation_high,
            asset,
            translation_low,
            max_scale,
            linear_x,
            mirrored,
            linear_y,
            spare_0,
            linear_z,
            spare_1
        }),
        layout!(AssetRecord {
            node_base,
            group_base,
            part_base,
            page_base,
            aabb_min,
            position_step,
            aabb_max,
            uv_step,
            attributes,
            material_base,
            spare
        }),
        layout!(Child {
            lod_center,
            lod_radius,
            aabb_min,
            max_parent_error_metres,
            aabb_max,
            reference
        }),
        layout!(Group {
            lod_center,
            lod_radius,
            parent_error_metres,
            first_part,
            part_count,
            first_page,
            level,
            cluster_count,
            triangle_count,
            spare
        }),
        layout!(Part {
            first_cluster,
            cluster_count
        }),
        layout!(NodeItem { instance, node }),
        layout!(ClusterItem {
            instance,
            page,
            cluster,
            page_word
        }),
        layout!(RequestRecord {
            page,
            error_px,
            priority
        }),
        layout!(Counters {
            node_count,
            next_node_count,
            candidate_count,
            visible_count,
            request_count,
            instances_drawn,
            nodes_visited,
            triangles_drawn,
            node_count_max,
            rounding_px_bits,
            node_half,
            rejected_nodes,
            rejected_clusters,
            hidden_instances,
            hidden_nodes,
            hidden_clusters,
            first_candidate,
            last_candidate,
            retested_clusters,
            drawn_count,
            hardware_count,
            compute_count,
            hardware_drawn,
            compute_drawn,
            draws,
            early_count
        }),
        layout!(IndirectArgs {
            nodes,
            first_hardware,
            clusters,
            first_compute,
            raster,
            compute,
            compute_count
        }),
        layout!(TranscodeJob {
            disk_word,
            span_word,
            pool_word,
            tables_word,
            parents_word,
            restored_word
        }),
        layout!(MaterialRecord {
            base_color,
            emissive,
            alpha_cutoff,
            uv_row_u,
            texture,
            uv_row_v,
            flags,
            metallic,
            roughness,
            mask_cutoffs,
            spare
        }),
        layout!(TextureRecord {
            first_word,
            width,
            height,
            mip_count
        }),
    ])
}

/// What differs: the Rust fields must tile the struct, and each WGSL member lie in the field of its name (one field may be
/// several members: `nodes` is `nodes_x`, `nodes_y`, `nodes_z`), with the same kind of number.
fn differences(name: &str, rust: &Layout, wgsl: &Layout) -> Vec<String> {
    let mut found = Vec::new();
    if rust.size != wgsl.size {
        found.push(format!(
            "{name}: {} bytes in Rust, {} in WGSL",
            rust.size, wgsl.size
        ));
    }
    let mut end = 0;
    for field in &rust.members {
        if field.offset != end {
            found.push(format!(
                "{name}: a gap or a field not named here before {}",
                field.name
            ));
        }
        end = field.offset + field.size;
        let inside = |member: &&Member| {
            member.offset < field.offset + field.size && member.offset + member.size > field.offset
        };
        let members: Vec<_> = wgsl.members.iter().filter(inside).collect();
        let named = members.iter().all(|member| {
            (member.name == field.name || member.name.starts_with(&format!("{}_", field.name)))
                && member.kind == field.kind
        });
        let covered: usize = members.iter().map(|member| member.size).sum();
        let inside = members.iter().all(|member| {
            member.offset >= field.offset
                && member.offset + member.size <= field.offset + field.size
        });
        if !named || !inside || covered != field.size {
            found.push(format!(
                "{name}.{}: {field:?} in Rust, {members:?} in WGSL",
                field.name
            ));
        }
    }
    if end != rust.size {
        found.push(format!("{name}: {end} of {} bytes have a name", rust.size));
    }
    found
}

#[test]
fn structs_lie_alike() {
    let rust = rust_structs();
    let mut found = Vec::new();
    let mut met = BTreeSet::new();
    for (pass, module) in modules() {
        for (name, wgsl, crosses) in structs(&module) {
            match rust.get(name.as_str()) {
                Some(layout) => {
                    found.extend(differences(&name, layout, &wgsl));
                    met.insert(name);
                }
                None if crosses => found.push(format!(
                    "{}: {name} crosses the bus and has no Rust struct",
                    pass.name
                )),
                None => {}
            }
        }
    }
    for name in rust.keys().filter(|name| !met.contains(**name)) {
        found.push(format!("{name}: in no pass"));
    }
    found.dedup();
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

#[test]
fn a_moved_field_is_found() {
    let rust = rust_structs();
    let group = &rust["Group"];
    let mut moved = group.clone();
    moved.members.swap(3, 4);
    let offset = moved.members[3].offset;
    moved.members[3].offset = moved.members[4].offset;
    moved.members[4].offset = offset;
    assert!(differences("Group", group, group).is_empty());
    assert_eq!(differences("Group", group, &moved).len(), 2);
}

#[test]
fn bindings_are_those_of_the_table() {
    let mut found = Vec::new();
    for (pass, module) in modules() {
        let mut bound = BTreeMap::new();
        for (_, variable) in module.global_variables.iter() {
            let Some(binding) = variable.binding else {
                continue;
            };
            let name = variable.name.clone().unwrap_or_default();
            if binding.group != 0 {
                found.push(format!(
                    "{}: {name} is in group {}",
                    pass.name, binding.group
                ));
            }
            let access = match variable.space {
                AddressSpace::Uniform => Some(Access::Uniform),
                AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => {
                    Some(Access::Write)
                }
                AddressSpace::Storage { .. } => Some(Access::Read),
                _ => None,
            };
            bound.insert(binding.binding as usize, (name, access));
        }
        let pool_access = match pass.pool {
            PoolAccess::None => None,
            PoolAccess::Read => Some(Access::Read),
            PoolAccess::Write => Some(Access::Write),
        };
        let pools = pool_access.into_iter().flat_map(|access| {
            (0..shader_module::POOL.count).map(move |index| (format!("pool_{index}"), Some(access)))
        });
        let fixed = pass.bindings.iter();
        let expected: Vec<_> = fixed
            .map(|binding| (binding.name.to_owned(), Some(binding.access)))
            .chain(pools)
            .collect();
        let declared: Vec<_> = bound.values().cloned().collect();
        if declared != expected || !bound.keys().copied().eq(0..expected.len()) {
            found.push(format!(
                "{}: {expected:?} in the table, {bound:?} in WGSL",
                pass.name
            ));
        }
    }
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

/// Each stage keeps to the limits that every WebGPU adapter has, with one binding of the pool.
#[test]
fn passes_keep_to_the_limits_of_webgpu() {
    for (pass, module) in modules() {
        let pool = u32::from(pass.pool != PoolAccess::None);
        let buffers = pass.storage_buffers() + pool;
        assert!(
            buffers <= MAX_STORAGE_BUFFERS,
            "{}: {buffers} storage buffers",
            pass.name
        );
        let mut layouter = naga::proc::Layouter::default();
        layouter
            .update(module.to_ctx())
            .expect("naga lays out what it parsed");
        let shared = module.global_variables.iter();
        let bytes: u32 = shared
            .filter(|(_, variable)| variable.space == AddressSpace::WorkGroup)
            .map(|(_, variable)| layouter[variable.ty].size)
            .sum();
        assert!(
            bytes <= MAX_WORKGROUP_BYTES,
            "{}: {bytes} bytes of workgroup memory",
            pass.name
        );
        for entry in &module.entry_points {
            let threads: u32 = entry.workgroup_size.iter().product();
            assert!(threads <= MAX_WORKGROUP_THREADS, "{}", entry.name);
        }
    }
}

#[test]
fn entry_points_are_those_of_the_table() {
    let known: BTreeSet<&str> = ALL
        .iter()
        .flat_map(|pass| pass.entry_points)
        .copied()
        .collect();
    for (pass, module) in modules() {
        let there: BTreeSet<&str> = module
            .entry_points
            .iter()
            .map(|entry| entry.name.as_str())
            .collect();
        assert!(
            pass.entry_points.iter().all(|name| there.contains(name)),
            "{}: {there:?}",
            pass.name
        );
        assert!(
            there.is_subset(&known),
            "{}: {there:?} has one that no pass names",
            pass.name
        );
    }
}

fn rust_constants() -> BTreeMap<&'static str, f64> {
    use lodestream_format::cluster::{Attributes, NO_GROUP};
    use lodestream_format::disk_form::{self, header_word, source_word};
    use lodestream_format::hierarchy::{LEAF_FLAG, NO_CHILD, ROOT_ERROR};
    use lodestream_format::limits::HIERARCHY_WIDTH;
    use lodestream_format::memory_form::{self, cluster_word, page_word};
    use lodestream_format::octahedral::NORMAL_BITS;
    use lodestream_shaders::cpu::{
        error_metric, mask_cutoffs, occlusion, prepare, raster_choice, snap, view, visit,
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
        ("HIDDEN_FLAG", visit::HIDDEN_FLAG as usize),
        ("WHOLE_INSTANCE", visit::WHOLE_INSTANCE as usize),
        ("REQUEST_WORDS", visit::REQUEST_WORDS),
        ("MOST_TEXELS", occlusion::MOST_TEXELS as usize),
        ("ASSET_ROWS", size_of::<AssetRecord>() / ROW_BYTES),
        ("CHILD_ROWS", size_of::<Child>() / ROW_BYTES),
        ("GROUP_ROWS", size_of::<Group>() / ROW_BYTES),
        ("MATERIAL_ROWS", size_of::<MaterialRecord>() / ROW_BYTES),
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
                None if of_culling => {
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

#[test]
fn workgroups_are_as_large_as_the_host_dispatches_for() {
    for (pass, module) in modules() {
        for entry in module
            .entry_points
            .iter()
            .filter(|entry| pass.entry_points.contains(&entry.name.as_str()))
        {
            let threads: u32 = entry.workgroup_size.iter().product();
            let expected = match pass.name {
                name if name.starts_with("prepare") => 1,
                "restore" => lodestream_shaders::cpu::view::RESTORE_THREADS,
                name if name.starts_with("cull")
                    || ["restore_normals", "transcode", "compact_requests"].contains(&name) =>
                {
                    64
                }
                _ => continue,
            };
            assert_eq!(threads, expected, "{}", pass.name);
        }
    }
}
