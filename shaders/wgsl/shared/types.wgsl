// Structs that cross the bus: names, sizes and offsets as in src/types.rs (tests/reflection.rs compares them).
// vec3 never appears in an array stride's way: three scalars and a fourth make sixteen bytes.

struct View {
    clip_from_rel: mat4x4<f32>,
    planes_in_rel: array<vec4<f32>, 5>,
    eye_high: vec3<f32>,
    pixel_error_px: f32,
    eye_low: vec3<f32>,
    pixels_at_one_metre: f32,
    forward: vec3<f32>,
    near_metres: f32,
    size_px: vec2<u32>,
    instance_count: u32,
    page_count: u32,
    shade_mode: u32,
    flags: u32,
    node_capacity: u32,
    cluster_capacity: u32,
    request_capacity: u32,
    corner_secant: f32,
    node_row: u32,
    group_row: u32,
    part_row: u32,
    slot_row: u32,
    material_row: u32,
    texture_row: u32,
    proxy_row: u32,
    spare_0: u32,
    spare_1: u32,
    spare_2: u32,
}

struct InstanceRecord {
    translation_high: vec3<f32>,
    asset: u32,
    translation_low: vec3<f32>,
    max_scale: f32,
    linear_x: vec3<f32>,
    mirrored: u32,
    linear_y: vec3<f32>,
    spare_0: u32,
    linear_z: vec3<f32>,
    proxy: u32,
}

struct AssetRecord {
    node_base: u32,
    group_base: u32,
    part_base: u32,
    page_base: u32,
    aabb_min: vec3<f32>,
    position_step: f32,
    aabb_max: vec3<f32>,
    uv_step: f32,
    attributes: u32,
    material_base: u32,
    spare_0: u32,
    spare_1: u32,
}

struct Child {
    lod_center: vec3<f32>,
    lod_radius: f32,
    aabb_min: vec3<f32>,
    max_parent_error_metres: f32,
    aabb_max: vec3<f32>,
    reference: u32,
}

struct Group {
    lod_center: vec3<f32>,
    lod_radius: f32,
    parent_error_metres: f32,
    first_part: u32,
    part_count: u32,
    first_page: u32,
    level: u32,
    cluster_count: u32,
    triangle_count: u32,
    spare: u32,
}

struct Part {
    first_cluster: u32,
    cluster_count: u32,
}

struct NodeItem {
    instance: u32,
    node: u32,
}

struct ClusterItem {
    instance: u32,
    page: u32,
    cluster: u32,
    page_word: u32,
}

struct RequestRecord {
    page: u32,
    error_px: f32,
    priority: u32,
}

struct Counters {
    node_count: atomic<u32>,
    next_node_count: atomic<u32>,
    candidate_count: atomic<u32>,
    visible_count: atomic<u32>,
    request_count: atomic<u32>,
    instances_drawn: atomic<u32>,
    nodes_visited: atomic<u32>,
    triangles_drawn: atomic<u32>,
    node_count_max: atomic<u32>,
    rounding_px_bits: atomic<u32>,
    node_half: u32,
    rejected_nodes: atomic<u32>,
    rejected_clusters: atomic<u32>,
    hidden_instances: atomic<u32>,
    hidden_nodes: atomic<u32>,
    hidden_clusters: atomic<u32>,
    first_candidate: u32,
    last_candidate: u32,
    drawn_count: u32,
    hardware_count: atomic<u32>,
    compute_count: atomic<u32>,
    hardware_drawn: u32,
    compute_drawn: u32,
    draws: u32,
    early_count: u32,
    point_count: atomic<u32>,
}

struct IndirectArgs {
    nodes_x: u32,
    nodes_y: u32,
    nodes_z: u32,
    first_hardware: u32,
    clusters_x: u32,
    clusters_y: u32,
    clusters_z: u32,
    first_compute: u32,
    raster_vertices: u32,
    raster_instances: u32,
    raster_first_vertex: u32,
    raster_first_instance: u32,
    compute_x: u32,
    compute_y: u32,
    compute_z: u32,
    compute_count: u32,
}

struct TranscodeJob {
    disk_word: u32,
    span_word: u32,
    pool_word: u32,
    tables_word: u32,
    parents_word: u32,
    restored_word: u32,
}

struct MaterialRecord {
    base_color: vec4<f32>,
    emissive: vec3<f32>,
    alpha_cutoff: f32,
    uv_row_u: vec3<f32>,
    texture: u32,
    uv_row_v: vec3<f32>,
    flags: u32,
    metallic: f32,
    roughness: f32,
    mask_cutoffs: u32,
    mean_texel: u32,
}

struct TextureRecord {
    first_word: u32,
    width: u32,
    height: u32,
    mip_count: u32,
}
