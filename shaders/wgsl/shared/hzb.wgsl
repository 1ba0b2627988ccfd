// The pyramid of depths: level L (1, 2...) has a texel for 2^L x 2^L pixels, the farthest depth in
// them, as bits. The levels lie one after the other, up to the one of a single texel.

// Sides of a level, rounded up.
fn hzb_size(size_px: vec2<u32>, level: u32) -> vec2<u32> {
    return (size_px + vec2<u32>((1u << level) - 1u)) >> vec2<u32>(level);
}

// First texel of a level, and texels a row.
fn hzb_level(size_px: vec2<u32>, level: u32) -> vec2<u32> {
    var first = 0u;
    for (var below = 1u; below < level; below++) {
        let size = hzb_size(size_px, below);
        first += size.x * size.y;
    }
    return vec2<u32>(first, hzb_size(size_px, level).x);
}

// The level of a single texel, at least 1.
fn hzb_top(size_px: vec2<u32>) -> u32 {
    let longer = max(size_px.x, size_px.y);
    return max(1u, select(firstLeadingBit(longer - 1u) + 1u, 0u, longer <= 1u));
}
