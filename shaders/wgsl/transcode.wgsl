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

// Where the vertices of a cluster lie, and what a record of one is made of.
struct Records {
    // First word of the fields of the cluster's first vertex in `restored`, and from a field to the next.
    values_word: u32,
    slot_words: u32,
    // First word of their sources in `staging`.
    sources_word: u32,
    slots: u32,
    // First slot of normals; none where it is as large as `slots`.
    normal_slot: u32,
    vertex_count: u32,
    vertex_bits: u32,
}

// How far the vertex whose normal is that of a repeated one lies from it: normals count from zero in all clusters.
fn normal_holder(job: TranscodeJob, first_vertex: u32, source: u32, vertex: u32) -> u32 {
    if source >> SOURCE_KIND_SHIFT != SOURCE_REPEATED {
        return vertex;
    }
    return span_of(job, (source >> 8u) & 0x3fffffu).first_vertex + (source & 0xffu) - first_vertex;
}

// Word `word` of a cluster's vertex records, whose fields have `slot_bits` bits.
fn vertex_word(job: TranscodeJob, first_vertex: u32, records: Records, slot_bits: array<u32, 11>, word: u32) -> u32 {
    // Indexed by a variable, and parameters cannot be.
    var widths = slot_bits;
    let start = word * 32u;
    var vertex = start / records.vertex_bits;
    var at = vertex * records.vertex_bits;
    var value = 0u;
    while vertex < records.vertex_count && at < start + 32u {
        for (var slot = 0u; slot < records.slots; slot++) {
            let bits = widths[slot];
            if bits > 0u && at + bits > start && at < start + 32u {
                var holder = vertex;
                if slot - records.normal_slot < 2u {
                    holder = normal_holder(job, first_vertex, staging[records.sources_word + vertex], vertex);
                }
                value |= placed(restored[records.values_word + slot * records.slot_words + holder], at, start);
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
    let slots = slots_of(attributes);
    var slot_bits: array<u32, 11>;
    for (var slot = 0u; slot < slots; slot++) {
        slot_bits[slot] = field_bits(attributes, widths, color_widths, field_of(attributes, slot));
    }
    let vertex_count = vertex_count_of(counts);
    let vertex_bits = vertex_bits_of(attributes, widths, color_widths);
    let records = Records(
        job.restored_word + span.first_vertex,
        disk_word(job, DISK_WORD_VERTEX_COUNT),
        sources(job) + span.first_vertex,
        slots,
        select(slots, FIELD_NORMAL, (attributes & ATTRIBUTE_NORMAL) != 0u),
        vertex_count,
        vertex_bits,
    );
    let vertex_words = (vertex_count * vertex_bits + 31u) / 32u;
    for (var word = local; word < vertex_words; word += TRANSCODE_THREADS) {
        let value = vertex_word(job, span.first_vertex, records, slot_bits, word);
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
