// Target of the rasterizers: a 64-bit maximum of the depth's bits above the id.
alias VisbufferWord = atomic<u64>;

fn store_visbuffer(pixel: u32, depth_bits: u32, id: u32) {
    atomicMax(&visbuffer[pixel], (u64(depth_bits) << 32u) | u64(id));
}
