// Differences of normals to normals, a workgroup a cluster (x) of a page (y): what is expected is the direction of the cluster's
// surface at the vertex. Only for pages with normals.
#import staged_form
#import strips

@group(0) @binding(2) var<storage, read_write> restored: array<u32>;

const NORMALS_THREADS: u32 = 64u;
// Bits of a position that a triangle's normal is worked out with.
const SURFACE_BITS: u32 = 14u;

// Three for each vertex: the sum of the normals of its triangles, as long as twice their areas, modulo 2^32.
var<workgroup> sums: array<atomic<i32>, 768>;
// Third corners of the triangles: what most others are made of.
var<workgroup> thirds: array<u32, 128>;

fn load_strip_word(word: u32) -> u32 {
    return staging[word];
}

// Position of the vertex whose x lies in a word of `restored`, and whose y and z lie `vertices` words further each.
fn place(word: u32, vertices: u32, shift: u32) -> vec3<i32> {
    return vec3<i32>(vec3(restored[word], restored[word + vertices], restored[word + 2u * vertices]) >> vec3(shift));
}

// As strip_triangle, with what other threads have found.
fn corners_of(strips: Strips, triangle: u32) -> vec3<u32> {
    let third = thirds[triangle];
    if strip_has(strips, triangle, STRIP_MASK_RESTART) {
        return vec3(strip_edge(strips, triangle), third);
    }
    let turns = strip_has(strips, triangle, STRIP_MASK_TURN);
    let bend = strip_last_bend(strips, triangle);
    var around = thirds[max(bend, 1u) - 1u];
    if strip_has(strips, bend, STRIP_MASK_RESTART) {
        around = strip_edge(strips, bend)[select(1u, 0u, turns)];
    }
    let newest = thirds[max(triangle, 1u) - 1u];
    return select(vec3(newest, around, third), vec3(around, newest, third), turns);
}

// The octahedral pair nearest to a direction, coordinate by coordinate; the middle for none.
fn on_octahedron(direction: vec3<i32>) -> vec2<u32> {
    // Two's complement: the smallest number's size comes out right as well.
    var sizes = bitcast<vec3<u32>>(select(direction, -direction, direction < vec3(0i)));
    let largest = max(max(sizes.x, sizes.y), sizes.z);
    let bits = 32u - countLeadingZeros(largest);
    sizes = sizes >> vec3(max(bits, 19u) - 19u);
    let sum = sizes.x + sizes.y + sizes.z;
    if sum == 0u {
        return vec2(1u << (NORMAL_BITS - 1u));
    }
    let folded = select(sizes.xy, vec2(sum) - sizes.yx, direction.z < 0i);
    let numerator = select(vec2(sum) + folded, vec2(sum) - folded, direction.xy < vec2(0i));
    return (numerator * ((1u << NORMAL_BITS) - 1u) + sum) / (2u * sum);
}

@compute @workgroup_size(64)
fn restore_normals(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let job = transcode_jobs[workgroup.y];
    let cluster = workgroup.x;
    let has_normals = (disk_word(job, DISK_WORD_ATTRIBUTES) & ATTRIBUTE_NORMAL) != 0u;
    // A page with fewer clusters, or without normals: nothing to do between the barriers.
    let is_there = has_normals && cluster < disk_word(job, DISK_WORD_CLUSTER_COUNT);
    var counts = 0u;
    var widths = 0u;
    var span = ClusterSpan(0u, 0u, 0u, 0u);
    if is_there {
        counts = column_word(job, cluster, CLUSTER_WORD_COUNTS);
        widths = column_word(job, cluster, CLUSTER_WORD_WIDTHS);
        span = span_of(job, cluster);
    }
    let vertex_count = vertex_count_of(counts);
    for (var sum = local; sum < 3u * vertex_count; sum += NORMALS_THREADS) {
        atomicStore(&sums[sum], 0i);
    }
    let first_strip = strips_word(job) + span.first_strip;
    let strips = strips_at(first_strip, triangle_count_of(counts), index_bits_of(counts));
    for (var triangle = local; triangle < triangle_count_of(counts); triangle += NORMALS_THREADS) {
        thirds[triangle] = strip_third(strips, triangle);
    }
    workgroupBarrier();
    let vertices = disk_word(job, DISK_WORD_VERTEX_COUNT);
    let first_place = job.restored_word + span.first_vertex;
    let widest = max(max(width_of(widths, 0u), width_of(widths, 1u)), width_of(widths, 2u));
    let shift = max(widest, SURFACE_BITS) - SURFACE_BITS;
    for (var triangle = local; triangle < triangle_count_of(counts); triangle += NORMALS_THREADS) {
        let corners = corners_of(strips, triangle);
        let a = place(first_place + corners.x, vertices, shift);
        let p = place(first_place + corners.y, vertices, shift) - a;
        let q = place(first_place + corners.z, vertices, shift) - a;
        let normal = p.yzx * q.zxy - p.zxy * q.yzx;
        for (var corner = 0u; corner < 3u; corner++) {
            let sum = 3u * corners[corner];
            atomicAdd(&sums[sum], normal.x);
            atomicAdd(&sums[sum + 1u], normal.y);
            atomicAdd(&sums[sum + 2u], normal.z);
        }
    }
    workgroupBarrier();
    let first_normal = job.restored_word + FIELD_NORMAL * vertices + span.first_vertex;
    let first_source = sources(job) + span.first_vertex;
    for (var vertex = local; vertex < vertex_count; vertex += NORMALS_THREADS) {
        if staging[first_source + vertex] >> SOURCE_KIND_SHIFT <= SOURCE_ANEW {
            let sum = 3u * vertex;
            let direction = vec3(atomicLoad(&sums[sum]), atomicLoad(&sums[sum + 1u]), atomicLoad(&sums[sum + 2u]));
            let expected = on_octahedron(direction);
            let mask = (1u << NORMAL_BITS) - 1u;
            let u = first_normal + vertex;
            let v = u + vertices;
            restored[u] = (restored[u] + expected.x) & mask;
            restored[v] = (restored[v] + expected.y) & mask;
        }
    }
}
