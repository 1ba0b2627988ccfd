// The one refinement predicate. Needs the bindings `view`, `scene` and `page_table`.
#import error_metric
#import scene

// Whether all pages of a group are installed; `page_base` is its asset's first page.
fn group_installed(group: Group, page_base: u32) -> bool {
    for (var part = 0u; part < group.part_count; part++) {
        if page_table[page_base + group.first_page + part] == NOT_INSTALLED {
            return false;
        }
    }
    return true;
}

fn group_projected_px(group: Group, instance: InstanceRecord, level: f32) -> f32 {
    return projected_error_px(view, instance, group.lod_center, group.lod_radius, group.parent_error_metres, level);
}

// Whether the clusters of a group replace what is coarser.
fn refine(group: Group, instance: InstanceRecord, page_base: u32) -> bool {
    let projected_px = group_projected_px(group, instance, f32(group.level));
    return error_wanted(view, group.parent_error_metres, projected_px) && group_installed(group, page_base);
}
