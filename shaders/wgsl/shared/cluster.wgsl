// Random access into a cluster in the page pool, as memory_form::ClusterView has it. Needs `load_pool`.
#import memory_form
#import strips

struct Cluster {
    // First word of the page in the pool.
    page_word: u32,
    attributes: u32,
    counts: u32,
    widths: u32,
    // Smallest grid index of each axis.
    origin_q: vec3<i32>,
    color_widths: u32,
    // Largest less smallest grid index.
    extent_q: vec3<u32>,
    materials: u32,
    uv_min: vec2<i32>,
    color_min: u32,
    child_group: u32,
    group: u32,
    strips: Strips,
    // First word of the vertex records in the pool.
    vertex_word: u32,
    vertex_bits: u32,
}

// Cluster number `cluster` of the page that begins at pool word `page_word`.
fn load_cluster(page_word: u32, cluster: u32) -> Cluster {
    let first = page_word + PAGE_HEADER_WORDS + cluster * CLUSTER_HEADER_WORDS;
    var c: Cluster;
    c.page_word = page_word;
    c.attributes = load_pool(page_word + PAGE_WORD_ATTRIBUTES);
    c.counts = load_pool(first + CLUSTER_WORD_COUNTS);
    c.widths = load_pool(first + CLUSTER_WORD_WIDTHS);
    c.origin_q = vec3<i32>(
        bitcast<i32>(load_pool(first + CLUSTER_WORD_ORIGIN)),
        bitcast<i32>(load_pool(first + CLUSTER_WORD_ORIGIN + 1u)),
        bitcast<i32>(load_pool(first + CLUSTER_WORD_ORIGIN + 2u)),
    );
    c.color_widths = load_pool(first + CLUSTER_WORD_COLOR_WIDTHS);
    c.extent_q = vec3<u32>(
        load_pool(first + CLUSTER_WORD_EXTENT),
        load_pool(first + CLUSTER_WORD_EXTENT + 1u),
        load_pool(first + CLUSTER_WORD_EXTENT + 2u),
    );
    c.materials = load_pool(first + CLUSTER_WORD_MATERIALS);
    c.uv_min = vec2<i32>(
        bitcast<i32>(load_pool(first + CLUSTER_WORD_UV_MIN)),
        bitcast<i32>(load_pool(first + CLUSTER_WORD_UV_MIN + 1u)),
    );
    c.color_min = load_pool(first + CLUSTER_WORD_COLOR_MIN);
    c.child_group = load_pool(first + CLUSTER_WORD_CHILD_GROUP);
    c.group = load_pool(first + CLUSTER_WORD_GROUP);
    let payload_word = page_word + load_pool(first + CLUSTER_WORD_PAYLOAD);
    c.strips = strips_at(payload_word, triangle_count_of(c.counts), index_bits_of(c.counts));
    c.vertex_word = payload_word + strip_words_of(c.widths);
    c.vertex_bits = vertex_bits_of(c.attributes, c.widths, c.color_widths);
    return c;
}

fn cluster_triangle_count(c: Cluster) -> u32 {
    return triangle_count_of(c.counts);
}

fn cluster_vertex_count(c: Cluster) -> u32 {
    return vertex_count_of(c.counts);
}

fn cluster_level(c: Cluster) -> u32 {
    return level_of(c.counts);
}

// `count` (0..=31) bits at bit `first` after pool word `base`. The second word is read only where the field reaches it:
// the last field of the pool ends with the pool.
fn load_bits(base: u32, first: u32, count: u32) -> u32 {
    if count == 0u {
        return 0u;
    }
    let word = base + first / 32u;
    let shift = first % 32u;
    var value = load_pool(word) >> shift;
    if shift + count > 32u {
        value |= load_pool(word + 1u) << (32u - shift);
    }
    return value & ((1u << count) - 1u);
}

fn cluster_field(c: Cluster, vertex: u32, before: u32, bits: u32) -> u32 {
    return load_bits(c.vertex_word, vertex * c.vertex_bits + before, bits);
}

fn load_strip_word(word: u32) -> u32 {
    return load_pool(word);
}

// Vertex indices of a triangle.
fn cluster_triangle(c: Cluster, triangle: u32) -> vec3<u32> {
    return strip_triangle(c.strips, triangle);
}

// Local position, metres. Integers first: grid indices stay below 2^24, so that every step of the way is exact.
fn cluster_position_local(c: Cluster, vertex: u32, position_step: f32) -> vec3<f32> {
    let x = width_of(c.widths, 0u);
    let y = width_of(c.widths, 1u);
    let offset = vec3<u32>(
        cluster_field(c, vertex, 0u, x),
        cluster_field(c, vertex, x, y),
        cluster_field(c, vertex, x + y, width_of(c.widths, 2u)),
    );
    return vec3<f32>(c.origin_q + vec3<i32>(offset)) * position_step;
}

// Smallest corner of the cluster's box, local metres, exact.
fn cluster_aabb_min(c: Cluster, position_step: f32) -> vec3<f32> {
    return vec3<f32>(c.origin_q) * position_step;
}

// Largest corner of the cluster's box, local metres, exact.
fn cluster_aabb_max(c: Cluster, position_step: f32) -> vec3<f32> {
    return vec3<f32>(c.origin_q + vec3<i32>(c.extent_q)) * position_step;
}

fn cluster_has_normals(c: Cluster) -> bool {
    return (c.attributes & ATTRIBUTE_NORMAL) != 0u;
}

fn cluster_has_uvs(c: Cluster) -> bool {
    return (c.attributes & ATTRIBUTE_UV) != 0u;
}

fn cluster_has_colors(c: Cluster) -> bool {
    return (c.attributes & ATTRIBUTE_COLOR) != 0u;
}

fn sign_not_zero(value: f32) -> f32 {
    return select(-1.0, 1.0, value >= 0.0);
}

// A stored pair to a unit vector (octahedral::decode).
fn decode_octahedral(pair: vec2<u32>) -> vec3<f32> {
    let largest = f32((1u << NORMAL_BITS) - 1u);
    let uv = vec2<f32>(pair) / largest * 2.0 - 1.0;
    let z = 1.0 - abs(uv.x) - abs(uv.y);
    let fold = max(-z, 0.0);
    let x = uv.x - fold * sign_not_zero(uv.x);
    let y = uv.y - fold * sign_not_zero(uv.y);
    let length = sqrt(x * x + y * y + z * z);
    return vec3<f32>(x / length, y / length, z / length);
}

// Local unit normal of a vertex; only where `cluster_has_normals`.
fn cluster_normal(c: Cluster, vertex: u32) -> vec3<f32> {
    let before = position_bits_of(c.widths);
    return decode_octahedral(vec2<u32>(
        cluster_field(c, vertex, before, NORMAL_BITS),
        cluster_field(c, vertex, before + NORMAL_BITS, NORMAL_BITS),
    ));
}

// Texture coordinates of a vertex on the texture grid; only where `cluster_has_uvs`. Take differences before scaling
// where precision matters: the integers are exact, f32 of them need not be.
fn cluster_uv_q(c: Cluster, vertex: u32) -> vec2<i32> {
    let before = bits_before_uv(c.attributes, c.widths);
    let u = width_of(c.widths, 3u);
    return c.uv_min + vec2<i32>(vec2<u32>(
        cluster_field(c, vertex, before, u),
        cluster_field(c, vertex, before + u, width_of(c.widths, 4u)),
    ));
}

// Texture coordinates of a vertex, texture widths; only where `cluster_has_uvs`.
fn cluster_uv(c: Cluster, vertex: u32, uv_step: f32) -> vec2<f32> {
    return vec2<f32>(cluster_uv_q(c, vertex)) * uv_step;
}

// Stored RGBA of a vertex as 0..=1; only where `cluster_has_colors`.
fn cluster_color(c: Cluster, vertex: u32) -> vec4<f32> {
    var before = bits_before_color(c.attributes, c.widths);
    var color: vec4<f32>;
    for (var channel = 0u; channel < 4u; channel++) {
        let bits = color_width_of(c.color_widths, channel);
        let smallest = (c.color_min >> (8u * channel)) & 0xffu;
        color[channel] = f32(smallest + cluster_field(c, vertex, before, bits)) / 255.0;
        before += bits;
    }
    return color;
}

// The asset's material slot of a triangle.
fn cluster_material_slot(c: Cluster, triangle: u32) -> u32 {
    if (c.counts & MATERIAL_TABLE_FLAG) != 0u {
        let table = c.page_word + c.materials;
        let ranges = load_pool(table);
        var last = 0u;
        for (var range = 1u; range <= ranges; range++) {
            let word = load_pool(table + range);
            last += word >> 16u;
            if triangle < last {
                return word & 0xffffu;
            }
        }
        return 0u;
    }
    let first = ((c.materials >> 18u) & 0x7fu) + 1u;
    let second = first + (c.materials >> 25u);
    let shift = select(select(12u, 6u, triangle < second), 0u, triangle < first);
    return (c.materials >> shift) & 0x3fu;
}
