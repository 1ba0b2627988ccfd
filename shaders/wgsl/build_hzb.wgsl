// The visbuffer's depths to the pyramid of farthest depths: 64 x 64 pixels a workgroup to levels 1
// to 6, then one workgroup the rest.
#import types
#import hzb

@group(0) @binding(0) var<uniform> view: View;
// x is the id, y the depth's bits.
@group(0) @binding(1) var<storage, read> visbuffer: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read_write> hzb: array<u32>;

// Nearer than any depth: pixels outside the picture do not lower a minimum.
const OUTSIDE: u32 = 0xffffffffu;
// Level of a workgroup's single texel.
const TILE_LEVEL: u32 = 6u;
const TOP_THREADS: u32 = 256u;

var<workgroup> tile: array<u32, 256>;

fn depth_bits(pixel: vec2<u32>) -> u32 {
    if pixel.x >= view.size_px.x || pixel.y >= view.size_px.y {
        return OUTSIDE;
    }
    return visbuffer[pixel.y * view.size_px.x + pixel.x].y;
}

fn store_texel(level: u32, texel: vec2<u32>, bits: u32) {
    let size = hzb_size(view.size_px, level);
    if level <= hzb_top(view.size_px) && texel.x < size.x && texel.y < size.y {
        hzb[hzb_level(view.size_px, level).x + texel.y * size.x + texel.x] = bits;
    }
}

@compute @workgroup_size(16, 16)
fn build_hzb(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
) {
    let block = workgroup.xy * 16u + local.xy;
    var farthest = OUTSIDE;
    for (var quarter = 0u; quarter < 4u; quarter++) {
        let texel = block * 2u + vec2<u32>(quarter & 1u, quarter >> 1u);
        let pixel = texel * 2u;
        let bits = min(
            min(depth_bits(pixel), depth_bits(pixel + vec2<u32>(1u, 0u))),
            min(depth_bits(pixel + vec2<u32>(0u, 1u)), depth_bits(pixel + vec2<u32>(1u, 1u))),
        );
        store_texel(1u, texel, bits);
        farthest = min(farthest, bits);
    }
    store_texel(2u, block, farthest);
    tile[local.y * 16u + local.x] = farthest;
    for (var level = 3u; level <= TILE_LEVEL; level++) {
        workgroupBarrier();
        let side = 64u >> level;
        let works = local.x < side && local.y < side;
        var bits = OUTSIDE;
        if works {
            let at = 2u * (local.y * 2u * side + local.x);
            bits = min(min(tile[at], tile[at + 1u]), min(tile[at + 2u * side], tile[at + 2u * side + 1u]));
        }
        workgroupBarrier();
        if works {
            tile[local.y * side + local.x] = bits;
            store_texel(level, workgroup.xy * side + local.xy, bits);
        }
    }
}

// Levels above the tiles'.
@compute @workgroup_size(256)
fn build_hzb_top(@builtin(local_invocation_index) local: u32) {
    let top = hzb_top(view.size_px);
    for (var level = TILE_LEVEL + 1u; level <= top; level++) {
        let below = hzb_size(view.size_px, level - 1u);
        let first_below = hzb_level(view.size_px, level - 1u).x;
        let size = hzb_size(view.size_px, level);
        let first = first_below + below.x * below.y;
        for (var index = local; index < size.x * size.y; index += TOP_THREADS) {
            let texel = vec2<u32>(index % size.x, index / size.x);
            let low = texel * 2u;
            let high = min(low + 1u, below - 1u);
            let bits = min(
                min(hzb[first_below + low.y * below.x + low.x], hzb[first_below + low.y * below.x + high.x]),
                min(hzb[first_below + high.y * below.x + low.x], hzb[first_below + high.y * below.x + high.x]),
            );
            hzb[first + index] = bits;
        }
        storageBarrier();
    }
}
