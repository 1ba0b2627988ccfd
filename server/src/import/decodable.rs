//! Decodable: whether the pixels of images can be had, told before they are published.

use std::io::Cursor;

use image::{ImageFormat, ImageReader, Limits};
use rayon::prelude::*;

use super::allowance::Allowance;
use super::error::short;
use super::scene::{Image, MediaType};

/// Larger images take seconds each; the viewer tells of them.
const MOST_PIXELS: u64 = 1 << 24;
/// Four channels of 16 bits, and as much while they are made.
const BYTES_PER_PIXEL: u64 = 16;

/// For each image the reason why it cannot be decoded; `None` also where there is no room to try.
pub(super) fn faults(images: &[Image], allowance: &Allowance) -> Vec<Option<String>> {
    let most_bytes = allowance.left_bytes() / rayon::current_num_threads().max(1) as u64;
    let fault = |image: &Image| {
        let pixels = u64::from(image.width) * u64::from(image.height);
        let bytes = pixels * BYTES_PER_PIXEL + 2 * image.bytes.len() as u64;
        match pixels <= MOST_PIXELS && bytes <= most_bytes {
            true => decode(image, bytes).err(),
            false => None,
        }
    };
    images.par_iter().map(fault).collect()
}

fn decode(image: &Image, most_bytes: u64) -> Result<(), String> {
    let plain;
    let (format, bytes) = match image.media_type {
        MediaType::Jpeg => (ImageFormat::Jpeg, &image.bytes[..]),
        MediaType::Png => {
            plain = pixel_chunks(&image.bytes).ok_or("expected whole chunks, found its end")?;
            (ImageFormat::Png, &plain[..])
        }
    };
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::default();
    limits.max_alloc = Some(most_bytes);
    reader.limits(limits);
    let decoded = reader.decode();
    decoded.map(drop).map_err(|error| short(&error.to_string()))
}

/// The file with the chunks alone that make its pixels: profiles and texts may unfold to gigabytes.
/// `None` where it ends before its last chunk.
fn pixel_chunks(file: &[u8]) -> Option<Vec<u8>> {
    const SIGNATURE_BYTES: usize = 8;
    /// Length, kind and checksum.
    const FRAME_BYTES: usize = 12;
    let (signature, mut rest) = file.split_at_checked(SIGNATURE_BYTES)?;
    let mut kept = signature.to_vec();
    loop {
        let length = u32::from_be_bytes(*rest.first_chunk()?) as usize;
        let (chunk, after) = rest.split_at_checked(length.checked_add(FRAME_BYTES)?)?;
        let kind = &chunk[4..8];
        if kind[0].is_ascii_uppercase() || kind == b"tRNS" {
            kept.extend_from_slice(chunk);
        }
        if kind == b"IEND" {
            return Some(kept);
        }
        rest = after;
    }
}
