//! A page's frame to its checked disk form: the hash first, then everything else. Nothing else makes a page drawable.

use bytes::Bytes;
use lodestream_format::disk_form::DiskForm;
use lodestream_format::{Asset, ContentHash, FormatError, Hierarchy, frame};

use super::error::{StreamError, check_hash};

/// Checks and decompresses the frame of page `page` of the asset named `hash`.
///
/// # Errors
/// [`StreamError::Hash`] where the frame is not the one that the asset names; [`StreamError::Format`] where it does not
/// decompress, does not parse, or says something else than the asset and its hierarchy do.
pub fn decode_page(
    hash: &ContentHash,
    asset: &Asset,
    hierarchy: &Hierarchy,
    page: u32,
    frame: &[u8],
) -> Result<DiskForm, StreamError> {
    let place = || format!("page {page} of asset {hash}");
    let wrong = |error: FormatError| StreamError::Format {
        place: place(),
        error,
    };
    let entry = asset
        .pages
        .get(page as usize)
        .ok_or_else(|| wrong(mismatch("page", asset.pages.len(), page)))?;
    check_hash(place, &entry.hash, frame)?;
    let form = frame::decode(frame)
        .and_then(DiskForm::parse)
        .map_err(wrong)?;
    let words = form.memory_words() as u32;
    for (at, expected, found) in [
        ("page number", page, form.page()),
        ("page attributes", asset.attributes.0, form.attributes().0),
        ("page memory words", entry.memory_words, words),
    ] {
        if expected != found {
            return Err(wrong(mismatch(at, expected, found)));
        }
    }
    let astray = form
        .parent_pages()
        .into_iter()
        .find(|parent| entry.dependencies.binary_search(parent).is_err());
    if let Some(parent) = astray {
        let expected = format!("pages that it depends on: {:?}", entry.dependencies);
        let error = FormatError::new("pages of parents", expected, parent);
        return Err(wrong(error));
    }
    hierarchy.check_page(&form).map_err(wrong)?;
    Ok(form)
}

fn mismatch(
    at: &str,
    expected: impl std::fmt::Display,
    found: impl std::fmt::Display,
) -> FormatError {
    FormatError::new(at, format!("the asset's {expected}"), found)
}

/// Bytes that pages `first..=last` take in the pack, and where they begin; `None` outside the asset.
pub(crate) fn pack_range(asset: &Asset, first: u32, last: u32) -> Option<std::ops::Range<u64>> {
    let start = asset.pages.get(first as usize)?;
    let end = asset.pages.get(last as usize)?;
    (first <= last).then_some(start.offset..end.offset + end.bytes as u64)
}

/// Cuts the bytes of pages `first..=last` into frames.
///
/// # Errors
/// [`StreamError::Length`] where the bytes are not as many as the asset says.
pub fn split_frames(
    hash: &ContentHash,
    asset: &Asset,
    first: u32,
    last: u32,
    bytes: &Bytes,
) -> Result<Vec<Bytes>, StreamError> {
    let place = || format!("pages {first}-{last} of asset {hash}");
    let range =
        pack_range(asset, first, last).ok_or_else(|| StreamError::NotFound { place: place() })?;
    if bytes.len() as u64 != range.end - range.start {
        return Err(StreamError::Length {
            place: place(),
            expected_bytes: range.end - range.start,
            found_bytes: bytes.len() as u64,
        });
    }
    let frames = asset.pages[first as usize..=last as usize]
        .iter()
        .map(|entry| {
            let start = (entry.offset - range.start) as usize;
            bytes.slice(start..start + entry.bytes as usize)
        });
    Ok(frames.collect())
}
