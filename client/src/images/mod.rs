//! Image files to the words of their mips. Whatever an image claims, no more of it is in memory
//! than what is kept: the header is read first, rows are reduced as they are decoded, and mips that
//! nobody keeps are never made.

mod jpeg;
mod png;
mod rows;

use lodestream_format::ContentHash;
use lodestream_format::scene::{MediaType, Texture};
use lodestream_shaders::cpu::Mips;

/// Bytes of all textures unless asked otherwise.
pub const DEFAULT_TEXTURE_MEMORY_BYTES: u64 = 1 << 30;
/// Longest side of an image, as JPEG has it: a row of any image is short.
const MOST_SIDE: u32 = 65_535;
/// Most texels of an image: four times 16,384 x 16,384. More would take minutes of a processor.
const MOST_TEXELS: u64 = 1 << 30;
/// Most texels of all images of a scene that are decoded.
const MOST_SCENE_TEXELS: u64 = 4 << 30;

/// Whether to decode each of `textures`, whose files may have `file_bytes` in all; else why not.
pub fn admitted<'a>(
    textures: impl Iterator<Item = &'a Texture>,
    file_bytes: u64,
) -> Vec<Result<(), String>> {
    let (mut left_texels, mut left_bytes) = (MOST_SCENE_TEXELS, file_bytes);
    let admit = |texture: &Texture| {
        let size = [texture.width, texture.height];
        if size.iter().any(|side| !(1..=MOST_SIDE).contains(side)) {
            let expected = format!("expected sides of 1 to {MOST_SIDE} texels");
            return Err(format!("{expected}, found {} x {}", size[0], size[1]));
        }
        let texels = size[0] as u64 * size[1] as u64;
        if texels > MOST_TEXELS {
            let expected = format!("expected at most {MOST_TEXELS} texels");
            return Err(format!("{expected}, found {} x {}", size[0], size[1]));
        }
        if texels > left_texels {
            let expected = format!("expected at most {MOST_SCENE_TEXELS} texels in all images");
            return Err(format!("{expected}, found more"));
        }
        if texture.bytes > left_bytes {
            let expected = format!("expected at most {file_bytes} bytes of image files");
            return Err(format!("{expected} (--open-memory), found more"));
        }
        left_texels -= texels;
        left_bytes -= texture.bytes;
        Ok(())
    };
    textures.map(admit).collect()
}

/// A texture's mips from mip `dropped` on, out of its image file. The texture is one
/// that was admitted.
///
/// # Errors
/// A line that says what the file is instead of what the scene says.
pub fn mips(texture: &Texture, file: &[u8], dropped: u32) -> Result<Mips, String> {
    let size = [texture.width, texture.height];
    match texture.media_type {
        MediaType::Png => png::mips(size, file, dropped),
        MediaType::Jpeg => jpeg::mips(size, file, dropped),
    }
}

/// Names a texture in a warning.
pub fn name(index: usize, object: &ContentHash) -> String {
    format!("texture {index} ({object})")
}

/// Fails unless an image has the size that the scene says.
fn check_size(expected: [u32; 2], found: [u32; 2]) -> Result<(), String> {
    match expected == found {
        true => Ok(()),
        false => Err(format!(
            "expected {} x {} texels, found {} x {}",
            expected[0], expected[1], found[0], found[1]
        )),
    }
}
