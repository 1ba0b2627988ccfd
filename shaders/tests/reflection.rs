//! WGSL against Rust by reflection: the layout of every struct that crosses the bus, and the pass
//! table.

mod shader_module;

use std::collections::{BTreeMap, BTreeSet};

use lodestream_format::hierarchy::{Child, Group, Part};
use lodestream_shaders::passes::{
    ALL, Access, MAX_STORAGE_BUFFERS, MAX_WORKGROUP_BYTES, MAX_WORKGROUP_THREADS, PoolAccess,
};
use lodestream_shaders::types::*;
use naga::{AddressSpace, StorageAccess};
use shader_module::{Field, Kind, Layout, Member, modules, structs};

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
            texture_row,
            proxy_row,
            spare
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
            proxy
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
            drawn_count,
            hardware_count,
            compute_count,
            hardware_drawn,
            compute_drawn,
            draws,
            early_count,
            point_count
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
            mean_texel
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
