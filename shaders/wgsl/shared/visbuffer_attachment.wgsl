// Target of the hardware rasterizer alone: attachments of id and depth, which `resolve` brings to
// the visbuffer. The fragment stage's result is all that it needs.
alias VisbufferWord = u32;

fn store_visbuffer(pixel: u32, depth_bits: u32, id: u32) {}
