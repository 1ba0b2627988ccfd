//! `GET /v1/objects/{hash}`: any immutable object, whole or a single range of it.

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::header::{
    ACCEPT_RANGES, CONTENT_LENGTH, CONTENT_RANGE, CONTENT_TYPE, ETAG, IF_RANGE, RANGE,
};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use lodestream_format::ContentHash;
use lodestream_format::hierarchy::MAGIC;

use super::AppState;
use super::body::range_body;
use super::encoding;
use super::error::{HttpError, header};
use super::etag::{self, IMMUTABLE};
use super::fair::Asker;
use super::limits::ClientAddress;
use super::lookups::{self, Name};
use super::page_cache::Made;

/// Shorter objects are sent as they are.
const SMALL_BYTES: u64 = 1024;
/// Longer ones, of more than 300 million triangles, are not held whole.
const HIERARCHY_BYTES: u64 = 32 * 1024 * 1024;
const BYTES: HeaderValue = HeaderValue::from_static("application/octet-stream");

/// A name in a URL: 64 lower-case hexadecimal digits, nothing else ever reaches the store.
pub(super) fn parse_hash(text: &str) -> Result<ContentHash, HttpError> {
    text.parse().map_err(HttpError::BadRequest)
}

/// `GET` and `HEAD /v1/objects/{hash}`
pub(super) async fn object(
    State(state): State<AppState>,
    Path(hash): Path<String>,
    method: Method,
    asker: Asker,
    client: ClientAddress,
    request: HeaderMap,
) -> Result<Response, HttpError> {
    let library = &state.0.library;
    let hash = parse_hash(&hash)?;
    let tag = etag::tag(hash);
    let missing = || lookups::no_object(library, &hash);
    let look = async { library.object_bytes(&hash).await?.ok_or_else(missing) };
    let looked = state
        .0
        .lookups
        .find(client, Name::Object(hash), missing, look);
    let bytes = looked.await?;
    if etag::is_held(&request, &tag) {
        let held = etag::not_modified(tag, IMMUTABLE);
        return Ok(([encoding::VARIES], held).into_response());
    }
    let mut headers = HeaderMap::new();
    headers.insert(CONTENT_TYPE, BYTES);
    headers.insert(ACCEPT_RANGES, HeaderValue::from_static("bytes"));
    headers.insert(ETAG, tag.clone());
    let current = request.get(IF_RANGE).is_none_or(|held| *held == tag);
    let wanted = request
        .get(RANGE)
        .filter(|_| current && method == Method::GET)
        .and_then(|value| value.to_str().ok());
    let (status, range) = match wanted.map_or(Wanted::All, |text| parse_range(text, bytes)) {
        Wanted::Nothing => return Err(HttpError::OutsideObject { bytes }),
        Wanted::All => (StatusCode::OK, 0..bytes),
        Wanted::Part(part) => {
            let text = format!("bytes {}-{}/{bytes}", part.start, part.end - 1);
            headers.insert(CONTENT_RANGE, header(&text));
            (StatusCode::PARTIAL_CONTENT, part)
        }
    };
    headers.insert(CONTENT_LENGTH, HeaderValue::from(range.end - range.start));
    headers.extend([encoding::VARIES]);
    if status == StatusCode::OK
        && encoding::takes_zstd(&request)
        && let Some(hierarchy) = Box::pin(compressed_hierarchy(&state, &hash, bytes, asker)).await?
    {
        headers.remove(ACCEPT_RANGES);
        headers.extend([encoding::ZSTD]);
        headers.insert(ETAG, encoding::weak(&tag));
        headers.insert(CONTENT_LENGTH, HeaderValue::from(hierarchy.len()));
        return Ok((status, [IMMUTABLE], headers, Body::from(hierarchy)).into_response());
    }
    let body = match method == Method::HEAD {
        true => Body::empty(),
        false => range_body(&state, &hash, range, status == StatusCode::OK).await?,
    };
    Ok((status, [IMMUTABLE], headers, body).into_response())
}

/// An object of `bytes`, compressed, where it is a hierarchy: all others are in the library already.
async fn compressed_hierarchy(
    state: &AppState,
    hash: &ContentHash,
    bytes: u64,
    asker: Asker,
) -> Result<Option<Bytes>, HttpError> {
    let shared = &state.0;
    if !(SMALL_BYTES..=HIERARCHY_BYTES).contains(&bytes) {
        return Ok(None);
    }
    if let Some(held) = shared.pages.held_made(Made::Hierarchy, hash) {
        return Ok(Some(held));
    }
    let magic = shared.library.object_range(hash, 0..4).await?;
    if magic[..] != MAGIC.to_le_bytes() {
        return Ok(None);
    }
    let object = async { Ok(vec![shared.pages.object(hash, asker).await?]) };
    let make = encoding::compressed(object);
    let made = shared.pages.made(Made::Hierarchy, hash, make);
    Ok(Some(made.await?))
}

/// What a `Range` header asks for.
#[derive(Debug, PartialEq, Eq)]
enum Wanted {
    /// Everything: another unit, several ranges, or nonsense, which RFC 9110 lets a server ignore.
    All,
    /// Bytes of the object, at least one.
    Part(std::ops::Range<u64>),
    /// No byte of the object.
    Nothing,
}

/// Reads `bytes=first-last`, `bytes=first-` or `bytes=-count` for an object of `bytes`.
fn parse_range(text: &str, bytes: u64) -> Wanted {
    let Some((first, last)) = text
        .strip_prefix("bytes=")
        .filter(|ranges| !ranges.contains(','))
        .and_then(|range| range.trim().split_once('-'))
    else {
        return Wanted::All;
    };
    let number = |text: &str| match text.bytes().all(|byte| byte.is_ascii_digit()) {
        true => text.parse::<u64>().ok(),
        false => None,
    };
    match (first, last) {
        ("", count) => match number(count) {
            Some(0) => Wanted::Nothing,
            Some(_) if bytes == 0 => Wanted::Nothing,
            Some(count) => Wanted::Part(bytes.saturating_sub(count)..bytes),
            None => Wanted::All,
        },
        (first, "") => match number(first) {
            Some(first) if first < bytes => Wanted::Part(first..bytes),
            Some(_) => Wanted::Nothing,
            None => Wanted::All,
        },
        (first, last) => match (number(first), number(last)) {
            (Some(first), Some(last)) if first > last => Wanted::All,
            (Some(first), Some(last)) if first < bytes => {
                Wanted::Part(first..bytes.min(last.saturating_add(1)))
            }
            (Some(_), Some(_)) => Wanted::Nothing,
            _ => Wanted::All,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_as_rfc_9110_says() {
        for (text, wanted) in [
            ("bytes=0-0", Wanted::Part(0..1)),
            ("bytes=2-4", Wanted::Part(2..5)),
            ("bytes=2-", Wanted::Part(2..10)),
            ("bytes=-3", Wanted::Part(7..10)),
            ("bytes=-30", Wanted::Part(0..10)),
            ("bytes=8-99999999999999999", Wanted::Part(8..10)),
            ("bytes=8-18446744073709551615", Wanted::Part(8..10)),
            ("bytes=10-", Wanted::Nothing),
            ("bytes=10-12", Wanted::Nothing),
            ("bytes=-0", Wanted::Nothing),
            ("bytes=4-2", Wanted::All),
            ("bytes=0-1,3-4", Wanted::All),
            ("bytes=a-b", Wanted::All),
            ("bytes=+1-2", Wanted::All),
            ("bytes=-", Wanted::All),
            ("lines=0-1", Wanted::All),
            ("bytes=99999999999999999999-", Wanted::All),
        ] {
            assert_eq!(parse_range(text, 10), wanted, "{text}");
        }
        assert_eq!(parse_range("bytes=-5", 0), Wanted::Nothing);
    }
}
