//! The page pool: one range of words, cut into as many buffers as the adapter's largest binding asks for.

use lodestream_shaders::passes::{ALL, PoolAccess, PoolBindings};

use super::device::Gpu;
use super::error::GpuError;

/// Most bindings that the pool is cut into: each costs a comparison a load and a binding of the stage's few.
pub const MAX_POOL_BINDINGS: u32 = 4;

/// The pool's buffers.
#[derive(Debug)]
pub struct Pool {
    /// How words spread over the buffers.
    pub bindings: PoolBindings,
    /// One buffer a binding.
    pub buffers: Vec<wgpu::Buffer>,
    /// Words of all buffers.
    pub words: u64,
}

/// Cuts `words` into bindings that the adapter can bind.
pub fn cut(gpu: &Gpu, words: u64) -> Result<PoolBindings, GpuError> {
    let words = words.max(1);
    let largest_words = gpu.max_binding_bytes() / 4;
    if words <= largest_words {
        let words_log2 = u64::BITS - (words - 1).leading_zeros();
        return Ok(PoolBindings {
            count: 1,
            words_log2: words_log2.min(31),
        });
    }
    let words_log2 = largest_words.ilog2();
    let count = words.div_ceil(1 << words_log2);
    let most = max_bindings(gpu);
    if count > most as u64 {
        return Err(GpuError::Limit {
            adapter: gpu.name.clone(),
            expected: format!("a page pool of {} bytes", words * 4),
            found: format!("at most {} bytes ({most} bindings)", max_bytes(gpu)),
        });
    }
    Ok(PoolBindings {
        count: count as u32,
        words_log2,
    })
}

/// Largest pool that the adapter can bind, bytes. Word numbers are 32 bits, the last one means "not installed".
pub fn max_bytes(gpu: &Gpu) -> u64 {
    let largest_words = gpu.max_binding_bytes() / 4;
    let whole = (1u64 << largest_words.ilog2()) * 4 * max_bindings(gpu) as u64;
    whole.max(largest_words * 4).min((u32::MAX as u64 - 1) * 4)
}

fn max_bindings(gpu: &Gpu) -> u32 {
    let others = ALL
        .iter()
        .filter(|pass| pass.pool != PoolAccess::None)
        .map(|pass| pass.storage_buffers())
        .max()
        .unwrap_or(0);
    gpu.limits
        .max_storage_buffers_per_shader_stage
        .saturating_sub(others)
        .clamp(1, MAX_POOL_BINDINGS)
}

impl Pool {
    /// Makes the buffers; fails where the limits or the memory do not suffice.
    pub fn new(gpu: &Gpu, words: u64) -> Result<Self, GpuError> {
        let bindings = cut(gpu, words)?;
        let mut buffers = Vec::new();
        let mut left = words.max(1);
        for index in 0..bindings.count {
            let own = match index + 1 == bindings.count {
                true => left,
                false => 1 << bindings.words_log2,
            };
            left -= own;
            buffers.push(super::buffers::create(
                gpu,
                "pool",
                own * 4,
                wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_SRC
                    | wgpu::BufferUsages::COPY_DST,
            )?);
        }
        Ok(Self {
            bindings,
            buffers,
            words,
        })
    }

    /// Writes words from word `first` on, in the queue's order.
    pub fn write(&self, gpu: &Gpu, mut first: u64, mut words: &[u32]) {
        let each = match self.bindings.count {
            1 => self.words,
            _ => 1 << self.bindings.words_log2,
        };
        while !words.is_empty() {
            let (buffer, at) = ((first / each) as usize, first % each);
            let (own, rest) = words.split_at(words.len().min((each - at) as usize));
            let bytes = bytemuck::cast_slice(own);
            gpu.queue.write_buffer(&self.buffers[buffer], 4 * at, bytes);
            (first, words) = (first + own.len() as u64, rest);
        }
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        self.words * 4
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A test's way to fail.
    use super::*;

    /// Every word lies in one binding, none in more bindings than the passes have room for.
    #[test]
    fn bindings_cover_the_pool() {
        let mut gpu = Gpu::noop();
        gpu.limits.max_storage_buffers_per_shader_stage = 16;
        let largest = gpu.max_binding_bytes() / 4;
        for words in [
            1,
            1000,
            largest,
            largest + 1,
            3 * largest,
            max_bytes(&gpu) / 4,
        ] {
            let bindings = cut(&gpu, words).unwrap();
            assert!(bindings.count <= MAX_POOL_BINDINGS);
            let each = match bindings.count {
                1 => words,
                _ => 1 << bindings.words_log2,
            };
            assert!(
                each <= largest && each * bindings.count as u64 >= words,
                "{words}"
            );
        }
    }

    #[test]
    fn a_pool_that_cannot_be_bound_names_both_numbers() {
        let gpu = Gpu::noop();
        let most = max_bytes(&gpu);
        let text = cut(&gpu, most / 4 + 1).unwrap_err().to_string();
        let asked = (most / 4 + 1) * 4;
        assert!(
            text.contains(&asked.to_string()) && text.contains(&most.to_string()),
            "{text}"
        );
    }
}
