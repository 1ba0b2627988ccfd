// Restored vertices and staged triangles to memory form: a workgroup a cluster (x) of a page (y), one more a page for its header and tables. A
// thread makes whole words, each gathered from its fields, so that no two threads write the same one.
#import staged_form

@group(0) @binding(2) var<storage, read> restored: array<u32>;

const TRANSCODE_THREADS: u32 = 64u;

// The share of a field that begins at bit `at` in the word that begins at bit `start`; the two overlap.
fn placed(value: u32, at: u32, start: u32) -> u32 {
    if at >= start {
        return value << (at - start);
    }
    return value >> (start - at);
}

// A field of a vertex, in the slot that the page keeps it in.
fn field_value(job: TranscodeJob, attributes: u32, field: u32, vertex: u32) -> u32 {
    var holder = vertex;
    if field >= FIELD_NORMAL && field < FIELD_UV {
        // Normals count from zero in all clusters, so those that are repeated are those of the other vertex.
        let source = staging[sources(job) + vertex];
        if source >> SOURCE_KIND_SHIFT == SOURCE_REPEATED {
            holder = span_of(job, (source >> 8u) & 0x3fffffu).first_vertex + (source & 0xffu);
        }
    }
    let slot = slot_of(attributes, field);
    return restored[job.restored_word + slot * disk_word(job, DISK_WORD_VERTEX_COUNT) + holder];
}

// Word `word` of a cluster's vertex records.
fn vertex_word(
    job: TranscodeJob,
    first_vertex: u32,
    vertex_count: u32,
    field_widths: array<u32, 11>,
    vertex_bits: u32,
    word: u32,
) -> u32 {
    // Indexed by a variable, and parameters cannot be.
    var widths = field_widths;
    let attributes = disk_word(job, DISK_WORD_ATTRIBUTES);
    let start = word * 32u;
    var vertex = start / vertex_bits;
    var at = vertex * vertex_bits;
    var value = 0u;
    while vertex < vertex_count && at < start + 32u {
        for (var field = 0u; field < DISK_FIELDS; field++) {
            let bits = widths[field];
            if bits > 0u && at + bits > start && at < start + 32u {
                value |= placed(field_value(job, attributes, field, first_vertex + vertex), at, start);
            }
            at += bits;
        }
        vertex++;
    }
    return value;
}

fn header_word(job: TranscodeJob, cluster: u32, counts: u32, payload_word: u32, word: u32) -> u32 {
    if word == CLUSTER_WORD_PAYLOAD {
        return payload_word;
    }
    if word >= CLUSTER_WORD_EXTENT {
        return restored[extent_word(job, cluster) + word - CLUSTER_WORD_EXTENT];
    }
    if word == CLUSTER_WORD_COUNTS {
        return counts & ((1u << DISK_ROUND_SHIFT) - 1u);
    }
    let stored = column_word(job, cluster, word);
    let is_table = word == CLUSTER_WORD_MATERIALS && (counts & MATERIAL_TABLE_FLAG) != 0u;
    return stored + select(0u, job.tables_word, is_table);
}

fn transcode_cluster(job: TranscodeJob, cluster: u32, local: u32) {
    let attributes = disk_word(job, DISK_WORD_ATTRIBUTES);
    let span = span_of(job, cluster);
    let payload_word = span.payload_word;
    let counts = column_word(job, cluster, CLUSTER_WORD_COUNTS);
    let widths = column_word(job, cluster, CLUSTER_WORD_WIDTHS);
    let color_widths = column_word(job, cluster, CLUSTER_WORD_COLOR_WIDTHS);

    let header = job.pool_word + PAGE_HEADER_WORDS + cluster * CLUSTER_HEADER_WORDS;
    for (var word = local; word < CLUSTER_HEADER_WORDS; word += TRANSCODE_THREADS) {
        store_pool(header + word, header_word(job, cluster, counts, payload_word, word));
    }
    let strip_words = strip_words_of(widths);
    let first_strip = strips_word(job) + span.first_strip;
    for (var word = local; word < strip_words; word += TRANSCODE_THREADS) {
        store_pool(job.pool_word + payload_word + word, staging[first_strip + word]);
    }
    var field_widths: array<u32, 11>;
    for (var field = 0u; field < DISK_FIELDS; field++) {
        field_widths[field] = field_bits(attributes, widths, color_widths, field);
    }
    let vertex_count = vertex_count_of(counts);
    let vertex_bits = vertex_bits_of(attributes, widths, color_widths);
    let vertex_words = (vertex_count * vertex_bits + 31u) / 32u;
    for (var word = local; word < vertex_words; word += TRANSCODE_THREADS) {
        let value = vertex_word(job, span.first_vertex, vertex_count, field_widths, vertex_bits, word);
        store_pool(job.pool_word + payload_word + strip_words + word, value);
    }
}

fn page_header_word(job: TranscodeJob, word: u32) -> u32 {
    switch word {
        case PAGE_WORD_MAGIC: { return MAGIC; }
        case PAGE_WORD_CLUSTER_COUNT: { return disk_word(job, DISK_WORD_CLUSTER_COUNT); }
        case PAGE_WORD_WORDS: { return disk_word(job, DISK_WORD_MEMORY_WORDS); }
        case PAGE_WORD_ATTRIBUTES: { return disk_word(job, DISK_WORD_ATTRIBUTES); }
        case PAGE_WORD_PAGE: { return disk_word(job, DISK_WORD_PAGE); }
        case PAGE_WORD_TABLES: { return job.tables_word; }
        default: { return 0u; }
    }
}

fn transcode_page(job: TranscodeJob, local: u32) {
    for (var word = local; word < PAGE_HEADER_WORDS; word += TRANSCODE_THREADS) {
        store_pool(job.pool_word + word, page_header_word(job, word));
    }
    let tables = field_plane(job, DISK_FIELDS);
    let table_words = disk_word(job, DISK_WORD_TABLE_WORDS);
    for (var word = local; word < table_words; word += TRANSCODE_THREADS) {
        store_pool(job.pool_word + job.tables_word + word, staging[tables + word]);
    }
}

@compute @workgroup_size(64)
fn transcode(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let job = transcode_jobs[workgroup.y];
    let cluster_count = disk_word(job, DISK_WORD_CLUSTER_COUNT);
    if workgroup.x < cluster_count {
        transcode_cluster(job, workgroup.x, local);
    } else if workgroup.x == cluster_count {
        transcode_page(job, local);
    }
}
