//! Whole buffers back to the host, waited for: pictures, cuts and tests.

use bytemuck::Pod;
use lodestream_shaders::types::{ClusterItem, Counters};

use super::device::Gpu;
use super::error::GpuError;
use super::renderer::Renderer;

/// Bytes copied at once: mapped buffers stay small however large the source.
const PIECE_BYTES: u64 = 64 << 20;

/// The first `count` elements of `buffer`, or as many as it has.
pub fn read_buffer<T: Pod>(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    count: usize,
) -> Result<Vec<T>, GpuError> {
    read_at(gpu, buffer, 0, count)
}

/// [`read_buffer`] from byte `start` on.
fn read_at<T: Pod>(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    start: u64,
    count: usize,
) -> Result<Vec<T>, GpuError> {
    let failed = |reason: String| GpuError::Device(format!("readback of a buffer: {reason}"));
    let bytes = ((count * size_of::<T>()) as u64).min(buffer.size() - start);
    let mut values = vec![T::zeroed(); bytes as usize / size_of::<T>()];
    let target: &mut [u8] = bytemuck::cast_slice_mut(&mut values);
    let mut offset = 0;
    while offset < target.len() as u64 {
        let wanted = (target.len() as u64 - offset).min(PIECE_BYTES);
        let size = wanted
            .next_multiple_of(4)
            .min(buffer.size() - start - offset);
        let piece = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("snapshot"),
            size,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, start + offset, &piece, 0, size);
        gpu.queue.submit([encoder.finish()]);
        piece.map_async(wgpu::MapMode::Read, .., |_| {});
        gpu.wait()?;
        let mapped = piece
            .get_mapped_range(..)
            .map_err(|error| failed(error.to_string()))?;
        target[offset as usize..][..wanted as usize].copy_from_slice(&mapped[..wanted as usize]);
        offset += wanted;
    }
    Ok(values)
}

impl Renderer {
    /// RGBA bytes (sRGB) of the last picture, a word a pixel, row by row.
    pub fn read_color(&self) -> Result<Vec<u32>, GpuError> {
        read_buffer(&self.gpu, self.buffer("color"), self.pixels())
    }

    /// Visbuffer words of the last picture: depth bits above the id.
    pub fn read_visbuffer(&self) -> Result<Vec<u64>, GpuError> {
        read_buffer(&self.gpu, self.buffer("visbuffer"), self.pixels())
    }

    /// Counters of the last frame.
    pub fn read_counters(&self) -> Result<Counters, GpuError> {
        let all = read_buffer(&self.gpu, self.buffer("counters"), 1)?;
        Ok(all.first().copied().unwrap_or_default())
    }

    /// Visible clusters of the last picture, in the order of their ids.
    pub fn read_visible(&self) -> Result<Vec<ClusterItem>, GpuError> {
        let count = self.read_counters()?.visible_count;
        let count = count.min(self.capacities().clusters) as usize;
        let start = self.visible_offset();
        read_at(&self.gpu, self.buffer("clusters"), start, count)
    }

    /// The words of all textures' mips.
    pub fn read_texels(&self) -> Result<Vec<u32>, GpuError> {
        let texels = self.buffer("texels");
        read_buffer(&self.gpu, texels, texels.size() as usize / 4)
    }

    /// The page pool's words.
    pub fn read_pool(&self) -> Result<Vec<u32>, GpuError> {
        let mut words = Vec::new();
        for buffer in &self.pool().buffers {
            words.extend(read_buffer::<u32>(
                &self.gpu,
                buffer,
                buffer.size() as usize / 4,
            )?);
        }
        words.truncate(self.pool().words as usize);
        Ok(words)
    }

    fn pixels(&self) -> usize {
        let [width, height] = self.size_px();
        width as usize * height as usize
    }
}
