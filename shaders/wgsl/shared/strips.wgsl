// Random access into the strips of a cluster, as strips::Strips has it (format/src/strips.rs says what they are). Needs
// `load_strip_word`.

// Bits of a mask of 32 triangles, and the masks.
const STRIP_MASK_NEW: u32 = 0u;
const STRIP_MASK_RESTART: u32 = 1u;
const STRIP_MASK_TURN: u32 = 2u;
const STRIP_MASKS: u32 = 3u;

struct Strips {
    // First word of the masks, and of the listed vertices.
    word: u32,
    listed_word: u32,
    index_bits: u32,
}

// What the triangles before one have used up.
struct StripUsed {
    vertices: u32,
    listed: u32,
}

fn strips_at(word: u32, triangle_count: u32, index_bits: u32) -> Strips {
    return Strips(word, word + STRIP_MASKS * ((triangle_count + 31u) / 32u), index_bits);
}

fn strip_mask(s: Strips, block: u32, mask: u32) -> u32 {
    return load_strip_word(s.word + STRIP_MASKS * block + mask);
}

fn strip_has(s: Strips, triangle: u32, mask: u32) -> bool {
    return ((strip_mask(s, triangle / 32u, mask) >> (triangle % 32u)) & 1u) == 1u;
}

fn strip_used_before(s: Strips, triangle: u32) -> StripUsed {
    var fresh = 0u;
    var restarts = 0u;
    var with_two = 0u;
    for (var block = 0u; block <= triangle / 32u; block++) {
        let before = select((1u << (triangle % 32u)) - 1u, 0xffffffffu, block < triangle / 32u);
        let restart = strip_mask(s, block, STRIP_MASK_RESTART) & before;
        fresh += countOneBits(strip_mask(s, block, STRIP_MASK_NEW) & before);
        restarts += countOneBits(restart);
        with_two += countOneBits(restart & strip_mask(s, block, STRIP_MASK_TURN));
    }
    return StripUsed(fresh + 2u * with_two, triangle - fresh + 2u * (restarts - with_two));
}

// A listed vertex. The second word is read only where the number reaches it.
fn strip_listed(s: Strips, number: u32) -> u32 {
    let first = number * s.index_bits;
    let word = s.listed_word + first / 32u;
    let shift = first % 32u;
    var value = load_strip_word(word) >> shift;
    if shift + s.index_bits > 32u {
        value |= load_strip_word(word + 1u) << (32u - shift);
    }
    return value & ((1u << s.index_bits) - 1u);
}

fn strip_third(s: Strips, triangle: u32) -> u32 {
    let used = strip_used_before(s, triangle);
    let is_new = strip_has(s, triangle, STRIP_MASK_NEW);
    let restarts = strip_has(s, triangle, STRIP_MASK_RESTART);
    if restarts && strip_has(s, triangle, STRIP_MASK_TURN) {
        return used.vertices + select(1u, 2u, is_new);
    }
    if is_new {
        return used.vertices;
    }
    return strip_listed(s, used.listed + select(0u, 2u, restarts));
}

// The first two corners of a restart.
fn strip_edge(s: Strips, triangle: u32) -> vec2<u32> {
    let used = strip_used_before(s, triangle);
    if !strip_has(s, triangle, STRIP_MASK_TURN) {
        return vec2(strip_listed(s, used.listed), strip_listed(s, used.listed + 1u));
    }
    if strip_has(s, triangle, STRIP_MASK_NEW) {
        return vec2(used.vertices, used.vertices + 1u);
    }
    return vec2(strip_listed(s, used.listed), used.vertices);
}

// The last triangle up to this one that restarts or turns the other way: what the others turn around comes from there.
fn strip_last_bend(s: Strips, triangle: u32) -> u32 {
    let turns = select(0u, 0xffffffffu, strip_has(s, triangle, STRIP_MASK_TURN));
    var up_to = 0xffffffffu >> (31u - triangle % 32u);
    for (var left = triangle / 32u + 1u; left > 0u; left--) {
        let block = left - 1u;
        let other = strip_mask(s, block, STRIP_MASK_TURN) ^ turns;
        let bends = (strip_mask(s, block, STRIP_MASK_RESTART) | other) & up_to;
        if bends != 0u {
            return 32u * block + firstLeadingBit(bends);
        }
        up_to = 0xffffffffu;
    }
    return 0u;
}

// One vertex number of a triangle: a thread of a vertex stage needs no other.
fn strip_corner(s: Strips, triangle: u32, corner: u32) -> u32 {
    if corner == 2u {
        return strip_third(s, triangle);
    }
    if strip_has(s, triangle, STRIP_MASK_RESTART) {
        return strip_edge(s, triangle)[corner];
    }
    // Around its first corner where it turns, else around the second.
    let around = select(1u, 0u, strip_has(s, triangle, STRIP_MASK_TURN));
    if corner != around {
        return strip_third(s, max(triangle, 1u) - 1u);
    }
    let bend = strip_last_bend(s, triangle);
    if strip_has(s, bend, STRIP_MASK_RESTART) {
        return strip_edge(s, bend)[around];
    }
    return strip_third(s, max(bend, 1u) - 1u);
}

// Vertex numbers of a triangle.
fn strip_triangle(s: Strips, triangle: u32) -> vec3<u32> {
    return vec3(strip_corner(s, triangle, 0u), strip_corner(s, triangle, 1u), strip_corner(s, triangle, 2u));
}
