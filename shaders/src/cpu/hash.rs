//! Numbers that look random. Twin of `wgsl/shared/hash.wgsl`, exact.

/// PCG's output hash (Jarzynski and Olano, "Hash functions for GPU rendering", 2020).
pub fn hash(value: u32) -> u32 {
    let state = value.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}
