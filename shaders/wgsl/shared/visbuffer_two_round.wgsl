// Target of the rasterizers without 64-bit atomics: the same clusters twice. The first round finds
// the largest depth of a pixel, the second the largest id at that depth: what the 64-bit maximum
// gives. Both rounds are one pipeline, so that a triangle has the same bits of depth in both.
// Needs the binding `view`.
#import view

// A pixel is two words: id, depth.
alias VisbufferWord = atomic<u32>;

fn store_visbuffer(pixel: u32, depth_bits: u32, id: u32) {
    let depth_word = 2u * pixel + 1u;
    if (view.flags & VIEW_FLAG_SECOND_ROUND) != 0u {
        if atomicLoad(&visbuffer[depth_word]) == depth_bits {
            atomicMax(&visbuffer[2u * pixel], id);
        }
    } else if atomicMax(&visbuffer[depth_word], depth_bits) < depth_bits {
        // An id of an earlier draw lies behind. No other id is stored before the second round.
        atomicStore(&visbuffer[2u * pixel], 0u);
    }
}
