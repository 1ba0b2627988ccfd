//! A texture object against what its scene says of it.

use image::ImageFormat;
use lodestream_format::FormatError;
use lodestream_format::scene::{MediaType, Texture};

/// Reads the image file's header.
pub(super) fn check(texture: &Texture, bytes: &[u8]) -> Result<(), FormatError> {
    if bytes.len() as u64 != texture.bytes {
        return Err(FormatError::new(
            "texture bytes",
            texture.bytes,
            bytes.len(),
        ));
    }
    let format = match texture.media_type {
        MediaType::Png => ImageFormat::Png,
        MediaType::Jpeg => ImageFormat::Jpeg,
    };
    let found = crate::import::dimensions(format, bytes)
        .map_err(|error| FormatError::new("texture", format!("a {format:?} image"), error))?;
    let expected = (texture.width, texture.height);
    if found != expected {
        let text = |(width, height): (u32, u32)| format!("{width} x {height} texels");
        return Err(FormatError::new(
            "texture size",
            text(expected),
            text(found),
        ));
    }
    Ok(())
}
