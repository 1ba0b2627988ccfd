// Numbers of the memory form (format/src/memory_form.rs; tests/reflection.rs compares them).

const MAGIC: u32 = 0x324d534cu;
const PAGE_HEADER_WORDS: u32 = 8u;
const CLUSTER_HEADER_WORDS: u32 = 16u;
const STRIP_WORDS_SHIFT: u32 = 25u;
const MATERIAL_TABLE_FLAG: u32 = 0x800000u;
const NORMAL_BITS: u32 = 10u;
const NO_GROUP: u32 = 0xffffffffu;

const PAGE_WORD_MAGIC: u32 = 0u;
const PAGE_WORD_CLUSTER_COUNT: u32 = 1u;
const PAGE_WORD_WORDS: u32 = 2u;
const PAGE_WORD_ATTRIBUTES: u32 = 3u;
const PAGE_WORD_PAGE: u32 = 4u;
const PAGE_WORD_TABLES: u32 = 5u;

const CLUSTER_WORD_COUNTS: u32 = 0u;
const CLUSTER_WORD_ORIGIN: u32 = 1u;
const CLUSTER_WORD_WIDTHS: u32 = 4u;
const CLUSTER_WORD_COLOR_WIDTHS: u32 = 5u;
const CLUSTER_WORD_PAYLOAD: u32 = 6u;
const CLUSTER_WORD_UV_MIN: u32 = 7u;
const CLUSTER_WORD_COLOR_MIN: u32 = 9u;
const CLUSTER_WORD_MATERIALS: u32 = 10u;
const CLUSTER_WORD_CHILD_GROUP: u32 = 11u;
const CLUSTER_WORD_GROUP: u32 = 12u;
const CLUSTER_WORD_EXTENT: u32 = 13u;

const ATTRIBUTE_NORMAL: u32 = 1u;
const ATTRIBUTE_UV: u32 = 2u;
const ATTRIBUTE_COLOR: u32 = 4u;

fn triangle_count_of(counts: u32) -> u32 {
    return counts & 0xffu;
}

fn vertex_count_of(counts: u32) -> u32 {
    return (counts >> 8u) & 0x1ffu;
}

fn level_of(counts: u32) -> u32 {
    return (counts >> 17u) & 0x3fu;
}

fn index_bits_of(counts: u32) -> u32 {
    return (counts >> 24u) & 0xfu;
}

// Bits of x, y, z, u or v (field 0..5).
fn width_of(widths: u32, field: u32) -> u32 {
    return (widths >> (5u * field)) & 0x1fu;
}

// Bits of r, g, b or a (channel 0..4).
fn color_width_of(color_widths: u32, channel: u32) -> u32 {
    return (color_widths >> (4u * channel)) & 0xfu;
}

// Words of a cluster's strips.
fn strip_words_of(widths: u32) -> u32 {
    return widths >> STRIP_WORDS_SHIFT;
}

// Bits from the start of a vertex record to its normal.
fn position_bits_of(widths: u32) -> u32 {
    return width_of(widths, 0u) + width_of(widths, 1u) + width_of(widths, 2u);
}

// Bits from the start of a vertex record to its texture coordinates.
fn bits_before_uv(attributes: u32, widths: u32) -> u32 {
    return position_bits_of(widths) + select(0u, 2u * NORMAL_BITS, (attributes & ATTRIBUTE_NORMAL) != 0u);
}

// Bits from the start of a vertex record to its colour.
fn bits_before_color(attributes: u32, widths: u32) -> u32 {
    let uv = width_of(widths, 3u) + width_of(widths, 4u);
    return bits_before_uv(attributes, widths) + select(0u, uv, (attributes & ATTRIBUTE_UV) != 0u);
}

// Bits of a whole vertex record.
fn vertex_bits_of(attributes: u32, widths: u32, color_widths: u32) -> u32 {
    let color = color_width_of(color_widths, 0u) + color_width_of(color_widths, 1u)
        + color_width_of(color_widths, 2u) + color_width_of(color_widths, 3u);
    return bits_before_color(attributes, widths) + select(0u, color, (attributes & ATTRIBUTE_COLOR) != 0u);
}
