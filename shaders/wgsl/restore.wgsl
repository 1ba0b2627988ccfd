// Values of all vertices of a page, a workgroup a page: first those that parents in the pool have, a thread a vertex; then a round of
// clusters after the other, a thread a field of a cluster. What a cluster of an earlier round has is taken from there; the rest is what is expected and a difference. Normals are
// left as differences, and repeated ones as they are, for `restore_normals` and `transcode`.
#import staged_form

@group(0) @binding(2) var<storage, read_write> restored: array<u32>;

const RESTORE_THREADS: u32 = 256u;

var<workgroup> rounds: u32;

// Smallest value of a field, from the words of a cluster's header that hold it.
fn least_of(field: u32, word: u32) -> u32 {
    if field >= FIELD_COLOR {
        return (word >> (8u * (field - FIELD_COLOR))) & 0xffu;
    }
    return select(word, 0u, field >= FIELD_NORMAL && field < FIELD_UV);
}

// The header word that has a field's smallest value; any for normals.
fn least_word(field: u32) -> u32 {
    if field < FIELD_NORMAL {
        return CLUSTER_WORD_ORIGIN + field;
    }
    if field < FIELD_UV {
        return CLUSTER_WORD_ORIGIN;
    }
    return select(CLUSTER_WORD_COLOR_MIN, CLUSTER_WORD_UV_MIN + field - FIELD_UV, field < FIELD_COLOR);
}

// The fields of a parent's vertex, from zero, to where those of the vertex that inherits them go. Whatever the pool holds, a word of it is read.
fn inherit(job: TranscodeJob, attributes: u32, slots: u32, vertices: u32, vertex: u32, source: u32) {
    let parent = job.parents_word + 2u * ((source >> 8u) & 0x3fffffu);
    let page = staging[parent];
    let clusters = load_pool(page + PAGE_WORD_CLUSTER_COUNT);
    let cluster = min(staging[parent + 1u], max(clusters, 1u) - 1u);
    let header = page + PAGE_HEADER_WORDS + cluster * CLUSTER_HEADER_WORDS;
    let widths = load_pool(header + CLUSTER_WORD_WIDTHS);
    let color_widths = load_pool(header + CLUSTER_WORD_COLOR_WIDTHS);
    let first = page + load_pool(header + CLUSTER_WORD_PAYLOAD) + strip_words_of(widths);
    var bit = (source & 0xffu) * vertex_bits_of(attributes, widths, color_widths);
    for (var slot = 0u; slot < slots; slot++) {
        let field = field_of(attributes, slot);
        let bits = field_bits(attributes, widths, color_widths, field);
        var value = 0u;
        if bits > 0u {
            let word = first + bit / 32u;
            value = load_pool(word) >> (bit % 32u);
            if bit % 32u + bits > 32u {
                value |= load_pool(word + 1u) << (32u - bit % 32u);
            }
            value &= (1u << bits) - 1u;
        }
        let least = least_of(field, load_pool(header + least_word(field)));
        restored[job.restored_word + slot * vertices + vertex] = least + value;
        bit += bits;
    }
}

fn restore_field(job: TranscodeJob, cluster: u32, slot: u32) {
    let attributes = disk_word(job, DISK_WORD_ATTRIBUTES);
    let field = field_of(attributes, slot);
    let is_normal = field >= FIELD_NORMAL && field < FIELD_UV;
    let counts = column_word(job, cluster, CLUSTER_WORD_COUNTS);
    let widths = column_word(job, cluster, CLUSTER_WORD_WIDTHS);
    let color_widths = column_word(job, cluster, CLUSTER_WORD_COLOR_WIDTHS);
    let mask = (1u << field_bits(attributes, widths, color_widths, field)) - 1u;
    let least = least_of(field, column_word(job, cluster, least_word(field)));
    let span = span_of(job, cluster);
    let values = job.restored_word + slot * disk_word(job, DISK_WORD_VERTEX_COUNT);
    let own_values = values + span.first_vertex;
    let vertex_count = vertex_count_of(counts);
    let plane = field_plane(job, field);
    let plane_words = vertex_plane_words(job);
    let bytes = field_bytes(attributes, disk_word(job, DISK_WORD_PLANE_WIDTHS), field);
    let first_source = sources(job) + span.first_vertex;
    var own = span.first_own;
    var last = 0u;
    var largest = 0u;
    for (var vertex = 0u; vertex < vertex_count; vertex++) {
        let source = staging[first_source + vertex];
        let kind = source >> SOURCE_KIND_SHIFT;
        var value = 0u;
        if kind == SOURCE_REPEATED {
            if !is_normal {
                let other = (source >> 8u) & 0x3fffffu;
                let holder = values + span_of(job, other).first_vertex + (source & 0xffu);
                let other_least = least_of(field, column_word(job, other, least_word(field)));
                value = (restored[holder] + other_least - least) & mask;
            }
        } else if kind == SOURCE_INHERITED {
            value = (restored[own_values + vertex] - least) & mask;
        } else {
            var stored = 0u;
            for (var byte = 0u; byte < bytes; byte++) {
                stored |= plane_byte(plane + byte * plane_words, own) << (8u * byte);
            }
            own++;
            var expected = 0u;
            if !is_normal {
                if kind == SOURCE_BEYOND {
                    let a = restored[own_values + (source & 0xffu)];
                    let b = restored[own_values + ((source >> 8u) & 0xffu)];
                    let opposite = restored[own_values + ((source >> 16u) & 0xffu)];
                    expected = select((a + b) / 2u, a + b - opposite, field < FIELD_COLOR);
                } else {
                    expected = last;
                }
            }
            let difference = (stored >> 1u) ^ (0u - (stored & 1u));
            value = (expected + difference) & mask;
        }
        restored[own_values + vertex] = value;
        last = value;
        largest = max(largest, value);
    }
    if slot < 3u {
        restored[extent_word(job, cluster) + slot] = largest;
    }
}

@compute @workgroup_size(256)
fn restore(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let job = transcode_jobs[workgroup.x];
    if local == 0u {
        rounds = disk_word(job, DISK_WORD_ROUNDS);
    }
    let last_round = workgroupUniformLoad(&rounds);
    let attributes = disk_word(job, DISK_WORD_ATTRIBUTES);
    let slots = slots_of(attributes);
    let vertices = disk_word(job, DISK_WORD_VERTEX_COUNT);
    let first_source = sources(job);
    for (var vertex = local; vertex < vertices; vertex += RESTORE_THREADS) {
        let source = staging[first_source + vertex];
        if source >> SOURCE_KIND_SHIFT == SOURCE_INHERITED {
            inherit(job, attributes, slots, vertices, vertex, source);
        }
    }
    storageBarrier();
    let items = disk_word(job, DISK_WORD_CLUSTER_COUNT) * slots;
    for (var round = 0u; round < last_round; round++) {
        for (var item = local; item < items; item += RESTORE_THREADS) {
            let cluster = item / slots;
            if column_word(job, cluster, CLUSTER_WORD_COUNTS) >> DISK_ROUND_SHIFT == round {
                restore_field(job, cluster, item % slots);
            }
        }
        storageBarrier();
    }
}
