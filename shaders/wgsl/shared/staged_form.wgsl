// Staged form of a page (format/src/disk_form/mod.rs; tests/reflection.rs compares the numbers), and the vertex values that are
// restored from it: for each field that the page has a word a vertex, then three words a cluster, the largest x, y and z.
#import types
#import memory_form

@group(0) @binding(0) var<storage, read> transcode_jobs: array<TranscodeJob>;
@group(0) @binding(1) var<storage, read> staging: array<u32>;

const DISK_HEADER_WORDS: u32 = 16u;
const DISK_COLUMNS: u32 = 12u;
const DISK_WORD_ATTRIBUTES: u32 = 1u;
const DISK_WORD_CLUSTER_COUNT: u32 = 2u;
const DISK_WORD_PAGE: u32 = 3u;
const DISK_WORD_VERTEX_COUNT: u32 = 4u;
const DISK_WORD_TRIANGLE_COUNT: u32 = 5u;
const DISK_WORD_TABLE_WORDS: u32 = 6u;
const DISK_WORD_MEMORY_WORDS: u32 = 7u;
const DISK_WORD_PLANE_WIDTHS: u32 = 8u;
const DISK_WORD_REPEATED: u32 = 11u;
const DISK_WORD_INHERITED: u32 = 12u;
const DISK_WORD_ROUNDS: u32 = 14u;
const DISK_WORD_STRIP_WORDS: u32 = 15u;
const DISK_FIELDS: u32 = 11u;
const DISK_ROUND_SHIFT: u32 = 28u;
const CLUSTER_SPAN_WORDS: u32 = 4u;

// First field of normals, of texture coordinates, of colours.
const FIELD_NORMAL: u32 = 3u;
const FIELD_UV: u32 = 5u;
const FIELD_COLOR: u32 = 7u;

// Where a vertex comes from: the upper two bits of its source word.
const SOURCE_BEYOND: u32 = 0u;
const SOURCE_ANEW: u32 = 1u;
const SOURCE_REPEATED: u32 = 2u;
const SOURCE_INHERITED: u32 = 3u;
const SOURCE_KIND_SHIFT: u32 = 30u;

struct ClusterSpan {
    first_vertex: u32,
    first_strip: u32,
    payload_word: u32,
    first_own: u32,
}

fn disk_word(job: TranscodeJob, word: u32) -> u32 {
    return staging[job.disk_word + word];
}

fn span_of(job: TranscodeJob, cluster: u32) -> ClusterSpan {
    let word = job.span_word + cluster * CLUSTER_SPAN_WORDS;
    return ClusterSpan(staging[word], staging[word + 1u], staging[word + 2u], staging[word + 3u]);
}

// Word `word` (not the payload's, and below the extents') of a cluster's header.
fn column_word(job: TranscodeJob, cluster: u32, word: u32) -> u32 {
    let column = word - select(0u, 1u, word > CLUSTER_WORD_PAYLOAD);
    return disk_word(job, DISK_HEADER_WORDS + column * disk_word(job, DISK_WORD_CLUSTER_COUNT) + cluster);
}

// Bytes of a vertex field: x, y, z, normal u, v, texture u, v, r, g, b, a.
fn field_bytes(attributes: u32, plane_widths: u32, field: u32) -> u32 {
    if field < FIELD_NORMAL {
        return (plane_widths >> (4u * field)) & 0xfu;
    }
    if field < FIELD_UV {
        return select(0u, 2u, (attributes & ATTRIBUTE_NORMAL) != 0u);
    }
    if field < FIELD_COLOR {
        return (plane_widths >> (4u * (field - 2u))) & 0xfu;
    }
    return select(0u, 1u, (attributes & ATTRIBUTE_COLOR) != 0u);
}

// Bits of a vertex field in the cluster's records.
fn field_bits(attributes: u32, widths: u32, color_widths: u32, field: u32) -> u32 {
    if field < FIELD_NORMAL {
        return width_of(widths, field);
    }
    if field < FIELD_UV {
        return select(0u, NORMAL_BITS, (attributes & ATTRIBUTE_NORMAL) != 0u);
    }
    if field < FIELD_COLOR {
        return select(0u, width_of(widths, field - 2u), (attributes & ATTRIBUTE_UV) != 0u);
    }
    return select(0u, color_width_of(color_widths, field - FIELD_COLOR), (attributes & ATTRIBUTE_COLOR) != 0u);
}

// Fields that the page has: they take the slots of `restored` in their order.
fn slots_of(attributes: u32) -> u32 {
    return 3u
        + select(0u, 2u, (attributes & ATTRIBUTE_NORMAL) != 0u)
        + select(0u, 2u, (attributes & ATTRIBUTE_UV) != 0u)
        + select(0u, 4u, (attributes & ATTRIBUTE_COLOR) != 0u);
}

// Field of a slot.
fn field_of(attributes: u32, slot: u32) -> u32 {
    var field = slot;
    if field >= FIELD_NORMAL && (attributes & ATTRIBUTE_NORMAL) == 0u {
        field += 2u;
    }
    if field >= FIELD_UV && (attributes & ATTRIBUTE_UV) == 0u {
        field += 2u;
    }
    return field;
}

fn strips_word(job: TranscodeJob) -> u32 {
    return job.disk_word + DISK_HEADER_WORDS + DISK_COLUMNS * disk_word(job, DISK_WORD_CLUSTER_COUNT);
}

fn sources(job: TranscodeJob) -> u32 {
    return strips_word(job) + disk_word(job, DISK_WORD_STRIP_WORDS);
}

fn vertex_plane_words(job: TranscodeJob) -> u32 {
    let others = disk_word(job, DISK_WORD_REPEATED) + disk_word(job, DISK_WORD_INHERITED);
    return (disk_word(job, DISK_WORD_VERTEX_COUNT) - others + 3u) / 4u;
}

// First word of the lowest byte's plane of a field; of the tables for the field after the last.
fn field_plane(job: TranscodeJob, field: u32) -> u32 {
    let attributes = disk_word(job, DISK_WORD_ATTRIBUTES);
    let plane_widths = disk_word(job, DISK_WORD_PLANE_WIDTHS);
    var bytes = 0u;
    for (var before = 0u; before < field; before++) {
        bytes += field_bytes(attributes, plane_widths, before);
    }
    return sources(job) + disk_word(job, DISK_WORD_VERTEX_COUNT) + bytes * vertex_plane_words(job);
}

fn plane_byte(plane: u32, index: u32) -> u32 {
    return (staging[plane + index / 4u] >> (8u * (index % 4u))) & 0xffu;
}

// First word in `restored` of the largest x, y and z of a cluster.
fn extent_word(job: TranscodeJob, cluster: u32) -> u32 {
    let slots = slots_of(disk_word(job, DISK_WORD_ATTRIBUTES));
    return job.restored_word + slots * disk_word(job, DISK_WORD_VERTEX_COUNT) + 3u * cluster;
}
