//! A page on the wire and in a pack: its disk form, compressed, behind eight bytes that say how.
//!
//! `codec: u8, 0, 0, 0, disk form words: u32, compressed bytes`. The page's hash covers the whole frame.

use std::io::Write;

use crate::disk_form;
use crate::error::{FormatError, ensure};
use crate::limits::MAX_DISK_FORM_BYTES;

/// Bytes before the compressed disk form.
pub const HEADER_BYTES: usize = 8;

/// How a frame's bytes are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Codec {
    /// As they are.
    None = 0,
    /// Zstandard (RFC 8878).
    #[default]
    Zstd = 1,
    /// LZ4 block format.
    Lz4 = 2,
}

impl std::str::FromStr for Codec {
    type Err = FormatError;

    fn from_str(name: &str) -> Result<Self, FormatError> {
        match name {
            "none" => Ok(Self::None),
            "zstd" => Ok(Self::Zstd),
            "lz4" => Ok(Self::Lz4),
            _ => Err(FormatError::new("codec", "zstd, lz4 or none", name)),
        }
    }
}

/// Level of Zstandard: with sections as blocks the first level takes 2 % more bytes, the twelfth half a per cent less in twice the time.
const ZSTD_LEVEL: i32 = 9;

/// Compresses a disk form. Falls back on [`Codec::None`] where `codec` would not make it smaller.
pub fn encode(words: &[u32], codec: Codec) -> Result<Vec<u8>, FormatError> {
    let bytes: &[u8] = bytemuck::cast_slice(words);
    let packed = match codec {
        Codec::None => bytes.to_vec(),
        Codec::Zstd => zstd_blocks(bytes, &blocks(words), |_| ())?,
        Codec::Lz4 => lz4_flex::block::compress(bytes),
    };
    let (codec, packed) = if packed.len() < bytes.len() {
        (codec, packed)
    } else {
        (Codec::None, bytes.to_vec())
    };
    let mut frame = vec![codec as u8, 0, 0, 0];
    frame.extend((words.len() as u32).to_le_bytes());
    frame.extend(packed);
    Ok(frame)
}

/// Bytes of the disk form's sections: each is a block with tables of its own, since what is alike lies in a section and little
/// repeats across them. One block for words that are no disk form.
fn blocks(words: &[u32]) -> Vec<usize> {
    match disk_form::sections(words) {
        Ok(sections) => sections.into_iter().map(|(_, bytes)| bytes).collect(),
        Err(_) => vec![4 * words.len()],
    }
}

/// `each` hears how many bytes the frame has after each block.
fn zstd_blocks(
    bytes: &[u8],
    blocks: &[usize],
    mut each: impl FnMut(usize),
) -> Result<Vec<u8>, FormatError> {
    let mut compress = || {
        let mut encoder = zstd::Encoder::new(Vec::with_capacity(bytes.len() / 2), ZSTD_LEVEL)?;
        encoder.set_pledged_src_size(Some(bytes.len() as u64))?;
        encoder.include_contentsize(true)?;
        let mut rest = bytes;
        for &block in blocks {
            let (own, more) = rest.split_at(block);
            if block > 0 {
                encoder.write_all(own)?;
                encoder.flush()?;
            }
            each(encoder.get_ref().len());
            rest = more;
        }
        encoder.finish()
    };
    compress().map_err(|error: std::io::Error| FormatError::new("zstd", "to compress", error))
}

/// Bytes that each section of a disk form takes in its frame, compressed with [`Codec::Zstd`]; the frame's own go to the first.
///
/// # Errors
/// Words that are no disk form.
pub fn section_bytes(words: &[u32]) -> Result<Vec<(disk_form::Part, usize)>, FormatError> {
    let sections = disk_form::sections(words)?;
    let blocks: Vec<usize> = sections.iter().map(|&(_, bytes)| bytes).collect();
    let mut ends = Vec::with_capacity(blocks.len());
    let bytes = bytemuck::cast_slice(words);
    let frame = zstd_blocks(bytes, &blocks, |end| ends.push(end))?;
    let mut before = 0;
    let mut sizes: Vec<(disk_form::Part, usize)> = sections
        .iter()
        .zip(ends)
        .map(|(&(part, _), end)| (part, end - std::mem::replace(&mut before, end)))
        .collect();
    if let Some((_, first)) = sizes.first_mut() {
        *first += HEADER_BYTES + frame.len() - before;
    }
    Ok(sizes)
}

/// Decompresses a frame to the words of a disk form, which still has to be parsed.
pub fn decode(frame: &[u8]) -> Result<Vec<u32>, FormatError> {
    ensure(
        frame.len() > HEADER_BYTES,
        "page frame bytes",
        "more than 8",
        frame.len(),
    )?;
    let (header, packed) = frame.split_at(HEADER_BYTES);
    ensure(
        header[1..4] == [0; 3],
        "page frame spare bytes",
        "zeros",
        format_args!("{:?}", &header[1..4]),
    )?;
    let words = u32::from_le_bytes([header[4], header[5], header[6], header[7]]) as usize;
    ensure(
        words <= MAX_DISK_FORM_BYTES / 4,
        "page frame words",
        "at most 131072",
        words,
    )?;
    let mut disk_form = vec![0u32; words];
    let target: &mut [u8] = bytemuck::cast_slice_mut(&mut disk_form);
    let wrong = |found: String| {
        FormatError::new(
            "page frame",
            format!("{} bytes after decompression", words * 4),
            found,
        )
    };
    let length = match header[0] {
        0 if packed.len() == target.len() => {
            target.copy_from_slice(packed);
            packed.len()
        }
        0 => packed.len(),
        1 => zstd::bulk::decompress_to_buffer(packed, target)
            .map_err(|error| wrong(error.to_string()))?,
        2 => lz4_flex::block::decompress_into(packed, target)
            .map_err(|error| wrong(error.to_string()))?,
        codec => return Err(FormatError::new("page frame codec", "0, 1 or 2", codec)),
    };
    if length == words * 4 {
        Ok(disk_form)
    } else {
        Err(wrong(format!("{length} bytes")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_codec_round_trips_and_truncation_is_rejected(words in prop::collection::vec(0u32..9, 1..500), cut in 0usize..100) {
            for codec in [Codec::None, Codec::Zstd, Codec::Lz4] {
                let frame = encode(&words, codec).unwrap();
                prop_assert_eq!(&decode(&frame).unwrap(), &words);
                prop_assert!(decode(&frame[..frame.len() - 1 - cut.min(frame.len() - 1)]).is_err());
            }
        }

        #[test]
        fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = decode(&bytes);
        }
    }
}
