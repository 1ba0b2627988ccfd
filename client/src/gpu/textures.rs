//! Textures to the texel buffer: decoded and uploaded one after the other, so that only one is unpacked in memory.

use lodestream_format::scene::Texture;
use lodestream_shaders::cpu::Mips;
use lodestream_shaders::cpu::mask_cutoffs::{
    has_mask_cutoffs, mask_cutoffs, mean_texel, place_tables,
};
use lodestream_shaders::cpu::texture::{Layout, mip_words};
use lodestream_shaders::types::{MaterialRecord, NO_MASK_CUTOFFS};

use super::buffers::create;
use super::device::Gpu;
use super::error::GpuError;
use super::renderer::Renderer;
use crate::images;

/// Most words of a material's table of cutoffs: sides have at most 65,535 texels.
const MOST_TABLE_WORDS: u64 = 61;
/// Bytes handed to the queue at once, which keeps a copy until they are in the buffer.
const STAGED_BYTES: usize = 16 << 20;

/// Textures on their way to the renderer.
#[derive(Debug)]
pub struct TextureUpload {
    gpu: Gpu,
    texels: wgpu::Buffer,
    layout: Layout,
    textures: Vec<Texture>,
    materials: Vec<MaterialRecord>,
}

impl TextureUpload {
    /// Lays out `textures` within `memory_bytes` and what the adapter binds: the largest lose their
    /// top mips. Those that are not `admitted` become one white texel, and a note that says why.
    /// `materials` are the scene's; the masked ones get cutoffs for every mip.
    pub fn new(
        gpu: &Gpu,
        textures: &[Texture],
        admitted: &[Result<(), String>],
        materials: &[MaterialRecord],
        memory_bytes: u64,
    ) -> Result<Self, GpuError> {
        let masked = materials.iter().filter(|it| has_mask_cutoffs(it)).count() as u64;
        let sizes: Vec<_> = textures
            .iter()
            .zip(admitted)
            .map(|(texture, admitted)| match admitted {
                Ok(()) => [texture.width, texture.height],
                Err(_) => [1, 1],
            })
            .collect();
        let limit_bytes = gpu.max_binding_bytes().min(memory_bytes);
        let texel_words = (limit_bytes / 4).saturating_sub(MOST_TABLE_WORDS * masked);
        let mut layout =
            Layout::new(&sizes, texel_words as usize).map_err(|error| GpuError::Limit {
                adapter: gpu.name.clone(),
                expected: "textures that can be bound".to_owned(),
                found: error.to_string(),
            })?;
        layout.notes.clear();
        for (index, (texture, record)) in textures.iter().zip(&layout.records).enumerate() {
            let size = sizes[index];
            if layout.dropped_mips[index] > 0 {
                layout.notes.push(format!(
                    "{}: shown at {} x {} of {} x {} texels, to keep all textures to {limit_bytes} bytes \
                     (--texture-memory)",
                    images::name(index, &texture.object),
                    record.width,
                    record.height,
                    size[0],
                    size[1]
                ));
            }
        }
        let usage = wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_DST
            | wgpu::BufferUsages::COPY_SRC;
        let mut materials = materials.to_vec();
        let words = place_tables(&mut materials, &layout.records, layout.words);
        let mut upload = Self {
            texels: create(gpu, "texels", words as u64 * 4, usage)?,
            materials,
            gpu: gpu.clone(),
            layout,
            textures: textures.to_vec(),
        };
        for (index, admitted) in admitted.iter().enumerate() {
            if let Err(reason) = admitted {
                upload.put_white(index, reason)?;
            }
        }
        Ok(upload)
    }

    /// Decodes and uploads the image file of a texture. One that does not decode becomes white, and
    /// a note.
    pub fn put(&mut self, index: usize, file: &[u8]) -> Result<(), GpuError> {
        let dropped = self.layout.dropped_mips[index];
        match images::mips(&self.textures[index], file, dropped) {
            Ok(mips) => {
                self.write(index, 0, &mips.words)?;
                self.write_cutoffs(index, &mips);
                let uses_it = |it: &&mut MaterialRecord| it.texture as usize == index;
                for material in self.materials.iter_mut().filter(uses_it) {
                    material.mean_texel = mean_texel(&mips, material);
                }
                Ok(())
            }
            Err(reason) => self.put_white(index, &reason),
        }
    }

    /// Uploads the tables of the materials that are masked by a texture.
    fn write_cutoffs(&self, index: usize, mips: &Mips) {
        let has_table = |it: &&MaterialRecord| {
            it.texture as usize == index && it.mask_cutoffs != NO_MASK_CUTOFFS
        };
        let record = &self.layout.records[index];
        for material in self.materials.iter().filter(has_table) {
            let table = mask_cutoffs(&mips.words, record, &mips.alpha_counts, material);
            let at = material.mask_cutoffs as u64 * 4;
            let bytes = bytemuck::cast_slice(&table);
            self.gpu.queue.write_buffer(&self.texels, at, bytes);
        }
    }

    fn put_white(&mut self, index: usize, reason: &str) -> Result<(), GpuError> {
        let name = images::name(index, &self.textures[index].object);
        for material in &mut self.materials {
            if material.texture as usize == index {
                material.mask_cutoffs = NO_MASK_CUTOFFS;
            }
        }
        self.layout
            .notes
            .push(format!("{name}: shown white: {reason}"));
        let record = &self.layout.records[index];
        let words = mip_words([record.width, record.height]);
        let white = vec![u32::MAX; words.min(STAGED_BYTES / 4)];
        for first in (0..words).step_by(STAGED_BYTES / 4) {
            let count = white.len().min(words - first);
            self.write(index, first, &white[..count])?;
        }
        Ok(())
    }

    fn write(&self, index: usize, first: usize, words: &[u32]) -> Result<(), GpuError> {
        let start = self.layout.records[index].first_word as u64 + first as u64;
        for (chunk, at) in words
            .chunks(STAGED_BYTES / 4)
            .zip((start..).step_by(STAGED_BYTES / 4))
        {
            let bytes = bytemuck::cast_slice(chunk);
            self.gpu.queue.write_buffer(&self.texels, at * 4, bytes);
            // Hands the copy's staging memory to the queue before the next asks for its own.
            self.gpu.queue.submit([]);
            if bytes.len() == STAGED_BYTES {
                self.gpu.wait()?;
            }
        }
        Ok(())
    }

    /// Hands the textures to the renderer.
    pub fn finish(self, renderer: &mut Renderer) -> Result<Layout, GpuError> {
        renderer.set_textures(&self.layout.records, self.texels, &self.materials)?;
        Ok(self.layout)
    }
}
