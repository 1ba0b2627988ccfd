//! Textures to the texel buffer: decoded, halved in linear light down to one texel, and shortened by their largest mips
//! where the adapter cannot bind them whole.

use std::sync::OnceLock;

use lodestream_format::scene::{MediaType, Texture};
use lodestream_shaders::types::TextureRecord;

use super::buffers::upload;
use super::device::Gpu;
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

/// Where each texture's mips lie, and how many of the largest ones were left out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Textures {
    /// A record a texture.
    pub records: Vec<TextureRecord>,
    /// Largest mips left out of all textures together, so that they can be bound.
    pub mips_left_out: u32,
    /// Words of all mips.
    pub words: u64,
}

impl Textures {
    /// Lays `textures` out in at most `most_words` words: the largest mip of all goes first.
    pub fn layout(sizes: impl IntoIterator<Item = [u32; 2]>, most_words: u64) -> Self {
        let mut sizes: Vec<_> = sizes
            .into_iter()
            .map(|size| size.map(|axis| axis.max(1)))
            .collect();
        let mut words: u64 = sizes.iter().map(chain_words).sum();
        let mut mips_left_out = 0;
        while words > most_words {
            let largest = (0..sizes.len()).max_by_key(|&index| area(&sizes[index]));
            let Some(index) = largest.filter(|&index| area(&sizes[index]) > 1) else {
                break;
            };
            words -= area(&sizes[index]);
            sizes[index] = half(sizes[index]);
            mips_left_out += 1;
        }
        let mut first_word = 0;
        let record = |size: &[u32; 2]| {
            let record = TextureRecord {
                first_word: first_word as u32,
                width: size[0],
                height: size[1],
                mip_count: size[0].max(size[1]).ilog2() + 1,
            };
            first_word += chain_words(size);
            record
        };
        Self {
            records: sizes.iter().map(record).collect(),
            mips_left_out,
            words,
        }
    }
}

impl Renderer {
    /// Decodes and uploads `textures`, one after the other: only one is unpacked in memory at a time. `warn` gets a line
    /// for every image that does not decode; such a texture is white.
    pub fn upload_textures<'a>(
        &mut self,
        textures: impl ExactSizeIterator<Item = TextureBytes<'a>> + Clone,
        mut warn: impl FnMut(String),
    ) -> Result<Textures, GpuError> {
        let gpu: Gpu = self.gpu.clone();
        let sizes = textures
            .clone()
            .map(|each| [each.texture.width, each.texture.height]);
        let layout = Textures::layout(sizes, gpu.max_binding_bytes() / 4);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let texels = super::buffers::create(&gpu, "texels", layout.words * 4, usage)?;
        for (index, (each, record)) in textures.zip(&layout.records).enumerate() {
            let texels_of = decode(&each).map_or_else(
                |reason| {
                    warn(format!(
                        "texture {index} ({}): {reason}",
                        each.texture.object
                    ));
                    vec![u32::MAX; area(&[record.width, record.height]) as usize]
                },
                |(size, texels)| shrink(size, texels, [record.width, record.height]),
            );
            let words = mip_chain([record.width, record.height], texels_of);
            let offset = record.first_word as u64 * 4;
            gpu.queue
                .write_buffer(&texels, offset, bytemuck::cast_slice(&words));
            gpu.queue.submit([]);
        }
        let records = upload(&gpu, "texture_records", &layout.records)?;
        self.set_textures(records, texels);
        Ok(layout)
    }
}

fn decode(each: &TextureBytes<'_>) -> Result<([u32; 2], Vec<u32>), String> {
    let format = match each.texture.media_type {
        MediaType::Png => image::ImageFormat::Png,
        MediaType::Jpeg => image::ImageFormat::Jpeg,
    };
    let image = image::load_from_memory_with_format(each.bytes, format)
        .map_err(|error| error.to_string())?
        .into_rgba8();
    let (width, height) = image.dimensions();
    let expected = [each.texture.width, each.texture.height];
    if [width, height] != expected {
        return Err(format!(
            "expected {}x{} texels, found {width}x{height}",
            expected[0], expected[1]
        ));
    }
    let texels = image
        .as_raw()
        .chunks_exact(4)
        .map(|rgba| u32::from_le_bytes([rgba[0], rgba[1], rgba[2], rgba[3]]))
        .collect();
    Ok(([width, height], texels))
}

/// Halves until `size` is reached, which the layout reached by halving.
fn shrink(mut size: [u32; 2], mut texels: Vec<u32>, wanted: [u32; 2]) -> Vec<u32> {
    while size != wanted && area(&size) > 1 {
        texels = halve(size, &texels);
        size = half(size);
    }
    texels
}

fn mip_chain(mut size: [u32; 2], texels: Vec<u32>) -> Vec<u32> {
    let mut words = texels.clone();
    let mut mip = texels;
    while area(&size) > 1 {
        mip = halve(size, &mip);
        size = half(size);
        words.extend_from_slice(&mip);
    }
    words
}

fn half(size: [u32; 2]) -> [u32; 2] {
    size.map(|axis| (axis / 2).max(1))
}

fn area(size: &[u32; 2]) -> u64 {
    size[0] as u64 * size[1] as u64
}

fn chain_words(size: &[u32; 2]) -> u64 {
    let mut size = *size;
    let mut words = area(&size);
    while area(&size) > 1 {
        size = half(size);
        words += area(&size);
    }
    words
}

/// The mean of the texels that each target texel covers, in linear light, colours weighed by alpha.
fn halve(size: [u32; 2], texels: &[u32]) -> Vec<u32> {
    let target = half(size);
    let range = |at: u32, axis: usize| {
        let (from, to) = (size[axis] as u64, target[axis] as u64);
        let first = at as u64 * from / to;
        let end = ((at as u64 + 1) * from).div_ceil(to);
        first as usize..end as usize
    };
    let mut halved = Vec::with_capacity(area(&target) as usize);
    for y in 0..target[1] {
        for x in 0..target[0] {
            let (mut sum, mut plain, mut alpha, mut count) = ([0f32; 3], [0f32; 3], 0f32, 0f32);
            for row in range(y, 1) {
                for column in range(x, 0) {
                    let rgba = texels[row * size[0] as usize + column].to_le_bytes();
                    let weight = rgba[3] as f32;
                    for channel in 0..3 {
                        let linear = linear_from_srgb()[rgba[channel] as usize];
                        sum[channel] += linear * weight;
                        plain[channel] += linear;
                    }
                    alpha += weight;
                    count += 1.0;
                }
            }
            let mut rgba = [0; 4];
            for channel in 0..3 {
                let mean = match alpha > 0.0 {
                    true => sum[channel] / alpha,
                    false => plain[channel] / count,
                };
                rgba[channel] = srgb_from_linear(mean);
            }
            rgba[3] = (alpha / count + 0.5) as u8;
            halved.push(u32::from_le_bytes(rgba));
        }
    }
    halved
}

fn linear_from_srgb() -> &'static [f32; 256] {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|byte| {
            let value = byte as f32 / 255.0;
            match value <= 0.04045 {
                true => value / 12.92,
                false => ((value + 0.055) / 1.055).powf(2.4),
            }
        })
    })
}

/// By a table over square roots, which spreads the dark end: exact to the nearest byte but for a few in a thousand.
fn srgb_from_linear(value: f32) -> u8 {
    const STEPS: usize = 4096;
    static TABLE: OnceLock<Vec<u8>> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        let byte = |step: usize| {
            let value = (step as f32 / STEPS as f32).powi(2);
            let encoded = match value <= 0.003_130_8 {
                true => value * 12.92,
                false => 1.055 * value.powf(1.0 / 2.4) - 0.055,
            };
            (encoded * 255.0 + 0.5) as u8
        };
        (0..=STEPS).map(byte).collect()
    });
    table[(value.clamp(0.0, 1.0).sqrt() * STEPS as f32 + 0.5) as usize]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A test's way to fail.
    use super::*;

    #[test]
    fn mips_halve_down_to_one_texel_and_keep_a_flat_colour() {
        for size in [[1, 1], [5, 3], [8, 1], [7, 16]] {
            let texels = vec![0x80_40_20_10; area(&size) as usize];
            let chain = mip_chain(size, texels);
            assert_eq!(chain.len() as u64, chain_words(&size), "{size:?}");
            assert!(
                chain.iter().all(|&texel| texel == 0x80_40_20_10),
                "{size:?}"
            );
            let layout = Textures::layout([size], u64::MAX);
            assert_eq!(layout.words, chain.len() as u64);
            let mips = layout.records[0].mip_count;
            assert_eq!(half_times(size, mips - 1), [1, 1]);
        }
    }

    fn half_times(size: [u32; 2], times: u32) -> [u32; 2] {
        (0..times).fold(size, |size, _| half(size))
    }

    #[test]
    fn every_byte_survives_the_tables() {
        for byte in 0..=255u8 {
            assert_eq!(srgb_from_linear(linear_from_srgb()[byte as usize]), byte);
        }
    }

    #[test]
    fn hidden_texels_do_not_darken_their_neighbours() {
        let red = u32::from_le_bytes([255, 0, 0, 255]);
        let halved = halve([2, 1], &[red, 0]);
        assert_eq!(halved, [u32::from_le_bytes([255, 0, 0, 128])]);
    }

    #[test]
    fn a_budget_drops_the_largest_mips_first_and_says_how_many() {
        let whole = Textures::layout([[64, 64], [32, 32]], u64::MAX);
        let cut = Textures::layout([[64, 64], [32, 32]], whole.words - 1);
        assert_eq!(whole.mips_left_out, 0);
        assert_eq!(cut.mips_left_out, 1);
        assert_eq!((cut.records[0].width, cut.records[1].width), (32, 32));
        assert_eq!(cut.words, whole.words - 64 * 64);
    }
}
