// Staged form of a page (see disk_form) to memory form: a workgroup a cluster (x) of a page (y), one more a page for its header and tables. A thread
// makes whole words, each gathered from the planes, so that no two threads write the same one.
#import types
#import memory_form

@group(0) @binding(0) var<storage, read> transcode_jobs: array<TranscodeJob>;
@group(0) @binding(1) var<storage, read> staging: array<u32>;

const DISK_HEADER_WORDS: u32 = 16u;
const DISK_COLUMNS: u32 = 15u;
const DISK_WORD_ATTRIBUTES: u32 = 1u;
const DISK_WORD_CLUSTER_COUNT: u32 = 2u;
const DISK_WORD_PAGE: u32 = 3u;
const DISK_WORD_VERTEX_COUNT: u32 = 4u;
const DISK_WORD_TRIANGLE_COUNT: u32 = 5u;
const DISK_WORD_TABLE_WORDS: u32 = 6u;
const DISK_WORD_MEMORY_WORDS: u32 = 7u;
const DISK_WORD_PLANE_WIDTHS: u32 = 8u;
const DISK_FIELDS: u32 = 11u;
const CLUSTER_SPAN_WORDS: u32 = 3u;
const TRANSCODE_THREADS: u32 = 64u;

// Where the sections of a page's disk form lie in `staging` (disk_form::Layout).
struct DiskLayout {
    index_planes: u32,
    index_plane_words: u32,
    vertex_plane_words: u32,
    // First word of the lowest byte's plane of each field, and where the last one's end: the material tables.
    field_planes: array<u32, 12>,
}

fn disk_word(job: TranscodeJob, word: u32) -> u32 {
    return staging[job.disk_word + word];
}

// Bytes of a vertex field: x, y, z, normal u, v, texture u, v, r, g, b, a.
fn field_bytes(attributes: u32, plane_widths: u32, field: u32) -> u32 {
    if field < 3u {
        return (plane_widths >> (4u * field)) & 0xfu;
    }
    if field < 5u {
        return select(0u, 2u, (attributes & ATTRIBUTE_NORMAL) != 0u);
    }
    if field < 7u {
        return (plane_widths >> (4u * (field - 2u))) & 0xfu;
    }
    return select(0u, 1u, (attributes & ATTRIBUTE_COLOR) != 0u);
}

// Bits of a vertex field in the cluster's records.
fn field_bits(attributes: u32, widths: u32, color_widths: u32, field: u32) -> u32 {
    if field < 3u {
        return width_of(widths, field);
    }
    if field < 5u {
        return select(0u, NORMAL_BITS, (attributes & ATTRIBUTE_NORMAL) != 0u);
    }
    if field < 7u {
        return select(0u, width_of(widths, field - 2u), (attributes & ATTRIBUTE_UV) != 0u);
    }
    return select(0u, color_width_of(color_widths, field - 7u), (attributes & ATTRIBUTE_COLOR) != 0u);
}

fn layout_of(job: TranscodeJob) -> DiskLayout {
    let attributes = disk_word(job, DISK_WORD_ATTRIBUTES);
    let plane_widths = disk_word(job, DISK_WORD_PLANE_WIDTHS);
    var sections: DiskLayout;
    sections.index_planes = job.disk_word + DISK_HEADER_WORDS + DISK_COLUMNS * disk_word(job, DISK_WORD_CLUSTER_COUNT);
    sections.index_plane_words = (disk_word(job, DISK_WORD_TRIANGLE_COUNT) + 3u) / 4u;
    sections.vertex_plane_words = (disk_word(job, DISK_WORD_VERTEX_COUNT) + 3u) / 4u;
    var plane = sections.index_planes + 3u * sections.index_plane_words;
    for (var field = 0u; field < DISK_FIELDS; field++) {
        sections.field_planes[field] = plane;
        plane += field_bytes(attributes, plane_widths, field) * sections.vertex_plane_words;
    }
    sections.field_planes[DISK_FIELDS] = plane;
    return sections;
}

// Word `word` (not the payload's) of a cluster's header.
fn column_word(job: TranscodeJob, cluster: u32, word: u32) -> u32 {
    let column = word - select(0u, 1u, word > CLUSTER_WORD_PAYLOAD);
    return disk_word(job, DISK_HEADER_WORDS + column * disk_word(job, DISK_WORD_CLUSTER_COUNT) + cluster);
}

fn plane_byte(plane: u32, index: u32) -> u32 {
    return (staging[plane + index / 4u] >> (8u * (index % 4u))) & 0xffu;
}

// Value of a field of `bits` bits, from its bytes' planes.
fn field_value(plane: u32, plane_words: u32, bits: u32, index: u32) -> u32 {
    var value = 0u;
    for (var byte = 0u; byte * 8u < bits; byte++) {
        value |= plane_byte(plane + byte * plane_words, index) << (8u * byte);
    }
    return value;
}

// The share of a field that begins at bit `at` in the word that begins at bit `start`; the two overlap.
fn placed(value: u32, at: u32, start: u32) -> u32 {
    if at >= start {
        return value << (at - start);
    }
    return value >> (start - at);
}

// Word `word` of a cluster's triangle indices.
fn index_word(sections: DiskLayout, first_triangle: u32, counts: u32, word: u32) -> u32 {
    let bits = index_bits_of(counts);
    let start = word * 32u;
    let indices = triangle_count_of(counts) * 3u;
    var value = 0u;
    for (var index = start / bits; index < indices && index * bits < start + 32u; index++) {
        let plane = sections.index_planes + (index % 3u) * sections.index_plane_words;
        value |= placed(plane_byte(plane, first_triangle + index / 3u), index * bits, start);
    }
    return value;
}

// Word `word` of a cluster's vertex records.
fn vertex_word(
    sections: DiskLayout,
    first_vertex: u32,
    vertex_count: u32,
    field_widths: array<u32, 11>,
    vertex_bits: u32,
    word: u32,
) -> u32 {
    // Indexed by a variable, and parameters cannot be.
    var widths = field_widths;
    var planes = sections.field_planes;
    let start = word * 32u;
    var vertex = start / vertex_bits;
    var at = vertex * vertex_bits;
    var value = 0u;
    while vertex < vertex_count && at < start + 32u {
        for (var field = 0u; field < DISK_FIELDS; field++) {
            let bits = widths[field];
            if bits > 0u && at + bits > start && at < start + 32u {
                let stored = field_value(planes[field], sections.vertex_plane_words, bits, first_vertex + vertex);
                value |= placed(stored, at, start);
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
    let stored = column_word(job, cluster, word);
    let is_table = word == CLUSTER_WORD_MATERIALS && (counts & MATERIAL_TABLE_FLAG) != 0u;
    return stored + select(0u, job.tables_word, is_table);
}

fn transcode_cluster(job: TranscodeJob, cluster: u32, local: u32) {
    let sections = layout_of(job);
    let attributes = disk_word(job, DISK_WORD_ATTRIBUTES);
    let span = job.span_word + cluster * CLUSTER_SPAN_WORDS;
    let first_vertex = staging[span];
    let first_triangle = staging[span + 1u];
    let payload_word = staging[span + 2u];
    let counts = column_word(job, cluster, CLUSTER_WORD_COUNTS);
    let widths = column_word(job, cluster, CLUSTER_WORD_WIDTHS);
    let color_widths = column_word(job, cluster, CLUSTER_WORD_COLOR_WIDTHS);

    let header = job.pool_word + PAGE_HEADER_WORDS + cluster * CLUSTER_HEADER_WORDS;
    for (var word = local; word < CLUSTER_HEADER_WORDS; word += TRANSCODE_THREADS) {
        store_pool(header + word, header_word(job, cluster, counts, payload_word, word));
    }
    let index_words = index_words_of(counts);
    for (var word = local; word < index_words; word += TRANSCODE_THREADS) {
        store_pool(job.pool_word + payload_word + word, index_word(sections, first_triangle, counts, word));
    }
    var field_widths: array<u32, 11>;
    for (var field = 0u; field < DISK_FIELDS; field++) {
        field_widths[field] = field_bits(attributes, widths, color_widths, field);
    }
    let vertex_count = vertex_count_of(counts);
    let vertex_bits = vertex_bits_of(attributes, widths, color_widths);
    let vertex_words = (vertex_count * vertex_bits + 31u) / 32u;
    for (var word = local; word < vertex_words; word += TRANSCODE_THREADS) {
        let value = vertex_word(sections, first_vertex, vertex_count, field_widths, vertex_bits, word);
        store_pool(job.pool_word + payload_word + index_words + word, value);
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
    let tables = layout_of(job).field_planes[DISK_FIELDS];
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
