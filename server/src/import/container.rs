//! Container: the chunks of a `.glb`, or the text of a `.gltf`.

use super::allowance::Allowance;
use super::error::{Read, malformed};
use super::file::Extent;
use super::warnings::Warnings;

/// A file cut into its JSON and its binary chunk, of which only the JSON is read.
pub(super) struct Container {
    pub(super) json: String,
    pub(super) bin: Option<Extent>,
}

const MAGIC: &[u8] = b"glTF";
/// UTF-8's byte order mark, which editors on Windows put before a text.
const MARK: &[u8] = b"\xef\xbb\xbf";
const HEADER_BYTES: u64 = 12;
const CHUNK_HEADER_BYTES: u64 = 8;
/// A file has two, and one for each extension of the container.
const MOST_CHUNKS: usize = 1024;

/// Tells the two containers apart by their first bytes, not by the name.
pub(super) fn split(
    file: &Extent,
    allowance: &Allowance,
    warnings: &mut Warnings,
) -> Read<Container> {
    let head = file.head(HEADER_BYTES)?;
    if head.starts_with(MAGIC) {
        return split_glb(file, allowance, warnings);
    }
    let start = head.strip_prefix(MARK).unwrap_or(&head);
    let blank = start.trim_ascii_start().is_empty();
    // What cannot be JSON is not read to its end.
    let bytes = match blank || start.trim_ascii_start().starts_with(b"{") {
        true => {
            allowance.fits(file.len(), "file")?;
            file.to_vec()?
        }
        false => head,
    };
    let text = bytes.strip_prefix(MARK).unwrap_or(&bytes);
    if text.trim_ascii_start().is_empty() {
        return Err(malformed("file", "a glTF file", "nothing in it"));
    }
    if text.trim_ascii_start().first() != Some(&b'{') {
        let start = &bytes[..bytes.len().min(4)];
        let found = format!("\"{}\"", start.escape_ascii());
        let expected = "the magic \"glTF\" or a JSON object";
        return Err(malformed("byte 0", expected, found));
    }
    Ok(Container {
        json: utf8(bytes)?,
        bin: None,
    })
}

fn split_glb(file: &Extent, allowance: &Allowance, warnings: &mut Warnings) -> Read<Container> {
    let header = |offset| word(file, offset, "header of 12 bytes");
    let version = header(4)?;
    if version != 2 {
        return Err(malformed("header.version", "2", version));
    }
    let length = u64::from(header(8)?);
    let Some(glb) = file.slice(0, length) else {
        let found = format!("{length} in a file of {} bytes", file.len());
        return Err(malformed("header.length", "the file's length", found));
    };
    let rest = file.len() - length;
    let what = "bytes after the end of the glb left out";
    warnings.add(what, rest, "header.length");
    let chunks = read_chunks(&glb)?;
    let Some((kind, json)) = chunks.first() else {
        return Err(malformed("chunk 0", "a JSON chunk", "none"));
    };
    if kind != b"JSON" {
        let found = format!("\"{}\"", kind.escape_ascii());
        return Err(malformed("chunk 0", "type \"JSON\"", found));
    }
    allowance.fits(json.len(), "chunk 0")?;
    let json = utf8(json.to_vec()?)?;
    let mut bin = None;
    for (at, (kind, data)) in chunks.into_iter().enumerate().skip(1) {
        if &kind == b"BIN\0" && bin.is_none() {
            bin = Some(data);
        } else {
            let what = format!("chunk of type \"{}\" left out", kind.escape_ascii());
            warnings.add(what, 1, &format!("chunk {at}"));
        }
    }
    Ok(Container { json, bin })
}

fn read_chunks(glb: &Extent) -> Read<Vec<([u8; 4], Extent)>> {
    let mut chunks = Vec::new();
    let mut at = HEADER_BYTES;
    while at < glb.len() {
        let place = format!("chunk {}", chunks.len());
        if chunks.len() >= MOST_CHUNKS {
            return Err(malformed(
                place,
                format!("{MOST_CHUNKS} chunks at most"),
                "more",
            ));
        }
        let length = u64::from(word(glb, at, &place)?);
        let data = glb.slice(at + CHUNK_HEADER_BYTES, length);
        let Some(data) = data else {
            let left = glb.len().saturating_sub(at + CHUNK_HEADER_BYTES);
            let found = format!("{left} bytes left");
            return Err(malformed(place, format!("{length} bytes of data"), found));
        };
        chunks.push((word(glb, at + 4, &place)?.to_le_bytes(), data));
        // Chunks start on multiples of 4; a last chunk without its padding is harmless.
        at = (at + CHUNK_HEADER_BYTES + length).next_multiple_of(4);
    }
    Ok(chunks)
}

/// The little-endian word at `offset`, which must end within `bytes`.
fn word(bytes: &Extent, offset: u64, place: &str) -> Read<u32> {
    let mut word = [0; 4];
    if bytes.slice(offset, 4).is_none() {
        let expected = format!("a word at byte {offset}");
        let found = format!("the end at byte {}", bytes.len());
        return Err(malformed(place, expected, found));
    }
    bytes.read_at(offset, &mut word)?;
    Ok(u32::from_le_bytes(word))
}

/// The text of a document, without a byte order mark and without the NULs that some exporters pad
/// chunks with.
fn utf8(mut json: Vec<u8>) -> Read<String> {
    if json.starts_with(MARK) {
        json.drain(..MARK.len());
    }
    let padding = json.iter().rev().take_while(|&&byte| byte == 0).count();
    json.truncate(json.len() - padding);
    String::from_utf8(json).map_err(|error| {
        let found = format!("other bytes at byte {}", error.utf8_error().valid_up_to());
        malformed("JSON", "UTF-8", found)
    })
}
