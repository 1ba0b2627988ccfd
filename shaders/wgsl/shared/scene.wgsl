// Records of the scene that never change, in one buffer: rows of four words, as scene_rows.rs lays
// them out. Assets come first. Needs the bindings `view` and `scene`.
#import types

const ASSET_ROWS: u32 = 4u;
const CHILD_ROWS: u32 = 3u;
const GROUP_ROWS: u32 = 3u;
const MATERIAL_ROWS: u32 = 5u;

fn load_asset(index: u32) -> AssetRecord {
    let row = index * ASSET_ROWS;
    let bases = scene[row];
    let low = scene[row + 1u];
    let high = scene[row + 2u];
    let last = scene[row + 3u];
    return AssetRecord(
        bases.x,
        bases.y,
        bases.z,
        bases.w,
        bitcast<vec3<f32>>(low.xyz),
        bitcast<f32>(low.w),
        bitcast<vec3<f32>>(high.xyz),
        bitcast<f32>(high.w),
        last.x,
        last.y,
        last.z,
        last.w,
    );
}

// A child (0..8) of a node; `node` counts over all assets.
fn load_child(node: u32, child: u32) -> Child {
    let row = view.node_row + (node * 8u + child) * CHILD_ROWS;
    let sphere = scene[row];
    let low = scene[row + 1u];
    let high = scene[row + 2u];
    return Child(
        bitcast<vec3<f32>>(sphere.xyz),
        bitcast<f32>(sphere.w),
        bitcast<vec3<f32>>(low.xyz),
        bitcast<f32>(low.w),
        bitcast<vec3<f32>>(high.xyz),
        high.w,
    );
}

fn load_group(index: u32) -> Group {
    let row = view.group_row + index * GROUP_ROWS;
    let sphere = scene[row];
    let parts = scene[row + 1u];
    let counts = scene[row + 2u];
    return Group(
        bitcast<vec3<f32>>(sphere.xyz),
        bitcast<f32>(sphere.w),
        bitcast<f32>(parts.x),
        parts.y,
        parts.z,
        parts.w,
        counts.x,
        counts.y,
        counts.z,
        counts.w,
    );
}

// Two parts a row.
fn load_part(index: u32) -> Part {
    let row = scene[view.part_row + index / 2u];
    let pair = select(row.xy, row.zw, index % 2u == 1u);
    return Part(pair.x, pair.y);
}

// Scene material of a slot. Four slots a row.
fn load_material_slot(index: u32) -> u32 {
    let row = scene[view.slot_row + index / 4u];
    return row[index % 4u];
}

fn load_material(index: u32) -> MaterialRecord {
    let row = view.material_row + index * MATERIAL_ROWS;
    let emissive = scene[row + 1u];
    let u = scene[row + 2u];
    let v = scene[row + 3u];
    let last = scene[row + 4u];
    return MaterialRecord(
        bitcast<vec4<f32>>(scene[row]),
        bitcast<vec3<f32>>(emissive.xyz),
        bitcast<f32>(emissive.w),
        bitcast<vec3<f32>>(u.xyz),
        u.w,
        bitcast<vec3<f32>>(v.xyz),
        v.w,
        bitcast<f32>(last.x),
        bitcast<f32>(last.y),
        last.z,
        last.w,
    );
}

fn load_texture_record(index: u32) -> TextureRecord {
    let row = scene[view.texture_row + index];
    return TextureRecord(row.x, row.y, row.z, row.w);
}
