//! PNG, row by row. Of an interlaced image that is too large the first passes alone are taken: they
//! are the image at an eighth, a quarter or half of its size, which is the purpose of interlacing.

use std::io::Cursor;

use lodestream_shaders::cpu::{Mips, mip_chain};
use png::{BitDepth, ColorType, Decoder, Limits, Reader, Transformations};

use super::check_size;
use super::rows::{Rows, shrunk};

/// Most bytes for what stands beside the image: palettes and unknown chunks. Texts and profiles are
/// passed over.
const CHUNK_BYTES: usize = 1 << 20;
/// Adam7: first column and row of each pass, and the steps to the next.
const PASSES: [[u32; 4]; 7] = [
    [0, 0, 8, 8],
    [4, 0, 8, 8],
    [0, 4, 4, 8],
    [2, 0, 4, 4],
    [0, 2, 2, 4],
    [1, 0, 2, 2],
    [0, 1, 1, 2],
];
/// Largest power of two by which the passes can be thinned out.
const MOST_STEP: u32 = 3;

type Source<'a> = Reader<Cursor<&'a [u8]>>;

pub(super) fn mips(size: [u32; 2], file: &[u8], dropped: u32) -> Result<Mips, String> {
    let wrong = |error: png::DecodingError| error.to_string();
    let limits = Limits { bytes: CHUNK_BYTES };
    let mut decoder = Decoder::new_with_limits(Cursor::new(file), limits);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    decoder.set_transformations(Transformations::EXPAND);
    let header = decoder.read_header_info().map_err(wrong)?;
    check_size(size, [header.width, header.height])?;
    let is_interlaced = header.interlaced;
    let reader = decoder.read_info().map_err(wrong)?;
    match is_interlaced {
        false => rows(reader, size, dropped),
        true => passes(reader, size, dropped),
    }
}

fn rows(mut reader: Source<'_>, size: [u32; 2], dropped: u32) -> Result<Mips, String> {
    let kind = reader.output_color_type();
    let mut rows = Rows::new(size, dropped);
    while let Some(row) = reader.next_row().map_err(|error| error.to_string())? {
        rows.push(|rgba| append_rgba(rgba, row.data(), kind));
    }
    rows.finish()
}

fn passes(mut reader: Source<'_>, size: [u32; 2], dropped: u32) -> Result<Mips, String> {
    let kind = reader.output_color_type();
    let step = dropped.min(MOST_STEP);
    let thin = shrunk(size, step);
    let mut image = vec![0u8; 4 * thin[0] as usize * thin[1] as usize];
    let mut rgba = Vec::new();
    for [left, top, across, down] in PASSES.into_iter().take(7 - 2 * step as usize) {
        if left >= size[0] {
            continue;
        }
        for y in (top..size[1]).step_by(down as usize) {
            let row = reader.next_row().map_err(|error| error.to_string())?;
            let row = row.ok_or("expected all passes, found fewer")?;
            rgba.clear();
            append_rgba(&mut rgba, row.data(), kind);
            let row = y >> step;
            if row >= thin[1] {
                continue;
            }
            for (x, texel) in (left..size[0])
                .step_by(across as usize)
                .zip(rgba.chunks_exact(4))
            {
                let column = x >> step;
                if column < thin[0] {
                    let at = 4 * (row as usize * thin[0] as usize + column as usize);
                    image[at..at + 4].copy_from_slice(texel);
                }
            }
        }
    }
    Ok(mip_chain(thin, &image, dropped - step))
}

/// Appends a decoded row as RGBA of eight bits.
fn append_rgba(rgba: &mut Vec<u8>, row: &[u8], (color, depth): (ColorType, BitDepth)) {
    let bytes = if depth == BitDepth::Sixteen { 2 } else { 1 };
    let sample = |at: &[u8], index: usize| match bytes {
        1 => at[index],
        // The nearest of eight bits.
        _ => {
            let sample = u16::from_be_bytes([at[2 * index], at[2 * index + 1]]);
            ((sample as u32 + 128) / 257) as u8
        }
    };
    for at in row.chunks_exact(bytes * color.samples()) {
        let [r, g, b, a] = match color {
            ColorType::Grayscale | ColorType::Indexed => [0, 0, 0, 4],
            ColorType::GrayscaleAlpha => [0, 0, 0, 1],
            ColorType::Rgb => [0, 1, 2, 4],
            ColorType::Rgba => [0, 1, 2, 3],
        };
        let alpha = if a < color.samples() {
            sample(at, a)
        } else {
            255
        };
        rgba.extend([sample(at, r), sample(at, g), sample(at, b), alpha]);
    }
}
