// Ids and depths of the attachments into the visbuffer, a thread a pixel: the larger of (depth, id)
// stays, as for atomics.
#import view

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> attached_ids: array<u32>;
@group(0) @binding(2) var<storage, read> attached_depths: array<u32>;
// x is the id, y the depth's bits.
@group(0) @binding(3) var<storage, read_write> visbuffer: array<vec2<u32>>;

// WebGPU copies textures to rows of whole 256 bytes.
const ROW_WORDS: u32 = 64u;

@compute @workgroup_size(8, 8)
fn resolve(@builtin(global_invocation_id) pixel: vec3<u32>) {
    if pixel.x >= view.size_px.x || pixel.y >= view.size_px.y {
        return;
    }
    let row_words = (view.size_px.x + ROW_WORDS - 1u) / ROW_WORDS * ROW_WORDS;
    let attached = pixel.y * row_words + pixel.x;
    let drawn = vec2<u32>(attached_ids[attached], attached_depths[attached]);
    let index = pixel.y * view.size_px.x + pixel.x;
    let stored = visbuffer[index];
    if drawn.y > stored.y || (drawn.y == stored.y && drawn.x > stored.x) {
        visbuffer[index] = drawn;
    }
}
