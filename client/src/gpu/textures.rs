//! Textures to the texel buffer: decoded and uploaded one after the other, so that only one is unpacked in memory.

use lodestream_format::scene::{MediaType, Texture};
use lodestream_shaders::cpu::texture::{Layout, mip_chain};

use super::buffers::{create, upload};
use super::error::GpuError;
use super::renderer::Renderer;

/// One texture's image file.
#[derive(Debug, Clone, Copy)]
pub struct TextureBytes<'a> {
    /// What the scene says of it.
    pub texture: &'a Texture,
    /// The image file.
    pub bytes: &'a [u8],
}

impl Renderer {
    /// Decodes and uploads `textures`. An image that does not decode becomes white, and a line of the layout's notes.
    pub fn upload_textures(&mut self, textures: &[TextureBytes<'_>]) -> Result<Layout, GpuError> {
        let gpu = self.gpu.clone();
        let sizes: Vec<_> = textures
            .iter()
            .map(|each| [each.texture.width, each.texture.height])
            .collect();
        let limit_words = (gpu.max_binding_bytes() / 4) as usize;
        let mut layout = Layout::new(&sizes, limit_words).map_err(|error| GpuError::Limit {
            adapter: gpu.name.clone(),
            expected: "textures that can be bound".to_owned(),
            found: error.to_string(),
        })?;
        let usage = wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_DST
            | wgpu::BufferUsages::COPY_SRC;
        let texels = create(&gpu, "texels", layout.words as u64 * 4, usage)?;
        for (index, each) in textures.iter().enumerate() {
            let size = sizes[index];
            let rgba = decode(each).unwrap_or_else(|reason| {
                let object = each.texture.object;
                layout
                    .notes
                    .push(format!("texture {index} ({object}): {reason}"));
                vec![255; size[0] as usize * size[1] as usize * 4]
            });
            let words = mip_chain(size, &rgba, layout.dropped_mips[index]);
            let offset = layout.records[index].first_word as u64 * 4;
            gpu.queue
                .write_buffer(&texels, offset, bytemuck::cast_slice(&words));
            // Hands the copy's staging memory to the queue before the next texture asks for its own.
            gpu.queue.submit([]);
        }
        let records = upload(&gpu, "texture_records", &layout.records)?;
        self.set_textures(records, texels);
        Ok(layout)
    }
}

/// RGBA bytes of an image file whose size is the one that the scene says.
fn decode(each: &TextureBytes<'_>) -> Result<Vec<u8>, String> {
    let format = match each.texture.media_type {
        MediaType::Png => image::ImageFormat::Png,
        MediaType::Jpeg => image::ImageFormat::Jpeg,
    };
    let image = image::load_from_memory_with_format(each.bytes, format)
        .map_err(|error| error.to_string())?
        .into_rgba8();
    let (width, height) = image.dimensions();
    let [expected_width, expected_height] = [each.texture.width, each.texture.height];
    match (width, height) == (expected_width, expected_height) {
        true => Ok(image.into_raw()),
        false => Err(format!(
            "expected {expected_width}x{expected_height} texels, found {width}x{height}"
        )),
    }
}
