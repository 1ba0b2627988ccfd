//! Container: the chunks of a `.glb`, or the text of a `.gltf`.

use super::error::{Read, malformed};
use super::warnings::Warnings;

/// A file cut into its JSON and its binary chunk.
pub(super) struct Container<'a> {
    pub(super) json: &'a str,
    pub(super) bin: Option<&'a [u8]>,
}

const MAGIC: &[u8] = b"glTF";
const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;

/// Tells the two containers apart by their first bytes, not by the name.
pub(super) fn split<'a>(bytes: &'a [u8], warnings: &mut Warnings) -> Read<Container<'a>> {
    if bytes.starts_with(MAGIC) {
        return split_glb(bytes, warnings);
    }
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if !text.iter().any(|byte| !byte.is_ascii_whitespace()) {
        return Err(malformed("file", "a glTF file", "nothing in it"));
    }
    if text.trim_ascii_start().first() != Some(&b'{') {
        let start = &bytes[..bytes.len().min(4)];
        let found = format!("\"{}\"", start.escape_ascii());
        return Err(malformed(
            "byte 0",
            "the magic \"glTF\" or a JSON object",
            found,
        ));
    }
    Ok(Container {
        json: utf8(text)?,
        bin: None,
    })
}

fn split_glb<'a>(bytes: &'a [u8], warnings: &mut Warnings) -> Read<Container<'a>> {
    let header = |offset| word(bytes, offset, "header of 12 bytes", bytes.len());
    let version = header(4)?;
    if version != 2 {
        return Err(malformed("header.version", "2", version));
    }
    let length = header(8)? as usize;
    if length > bytes.len() {
        let found = format!("{length} in a file of {} bytes", bytes.len());
        return Err(malformed("header.length", "the file's length", found));
    }
    warnings.add(
        "bytes after the end of the glb left out",
        (bytes.len() - length) as u64,
        "header.length",
    );
    let chunks = read_chunks(&bytes[..length])?;
    let json = match chunks.first() {
        Some((b"JSON", json)) => utf8(json)?,
        Some((kind, _)) => {
            let found = format!("\"{}\"", kind.escape_ascii());
            return Err(malformed("chunk 0", "type \"JSON\"", found));
        }
        None => return Err(malformed("chunk 0", "a JSON chunk", "none")),
    };
    let mut bin = None;
    for (at, (kind, data)) in chunks.into_iter().enumerate().skip(1) {
        if kind == b"BIN\0" && bin.is_none() {
            bin = Some(data);
        } else {
            let what = format!("chunk of type \"{}\" left out", kind.escape_ascii());
            warnings.add(what, 1, &format!("chunk {at}"));
        }
    }
    Ok(Container { json, bin })
}

type Chunk<'a> = (&'a [u8; 4], &'a [u8]);

fn read_chunks(bytes: &[u8]) -> Read<Vec<Chunk<'_>>> {
    let mut chunks = Vec::new();
    let mut at = HEADER_BYTES;
    while at < bytes.len() {
        let place = format!("chunk {}", chunks.len());
        let length = word(bytes, at, &place, bytes.len())? as usize;
        let kind = bytes[at + 4..].first_chunk::<4>();
        let data = bytes[at + 4..].get(4..).and_then(|rest| rest.get(..length));
        let (Some(kind), Some(data)) = (kind, data) else {
            let left = bytes.len().saturating_sub(at + CHUNK_HEADER_BYTES);
            let found = format!("{left} bytes left");
            return Err(malformed(place, format!("{length} bytes of data"), found));
        };
        chunks.push((kind, data));
        // Chunks start on multiples of 4; a last chunk without its padding is harmless.
        at = (at + CHUNK_HEADER_BYTES + length).next_multiple_of(4);
    }
    Ok(chunks)
}

/// The little-endian word at `offset`, which must end within `bytes`.
fn word(bytes: &[u8], offset: usize, place: &str, length: usize) -> Read<u32> {
    match bytes.get(offset..).and_then(|rest| rest.first_chunk()) {
        Some(word) => Ok(u32::from_le_bytes(*word)),
        None => {
            let expected = format!("a word at byte {offset}");
            Err(malformed(
                place,
                expected,
                format!("the end at byte {length}"),
            ))
        }
    }
}

fn utf8(json: &[u8]) -> Read<&str> {
    std::str::from_utf8(json).map_err(|error| {
        let found = format!("other bytes at byte {}", error.valid_up_to());
        malformed("JSON", "UTF-8", found)
    })
}
