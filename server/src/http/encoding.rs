//! `Content-Encoding` of what is not compressed already: hierarchies by Zstandard, which halves them, once for all who ask; texts by gzip,
//! which every client of theirs knows, as they are sent. Pages, manifests and images are compressed in the library.

use std::future::Future;

use axum::http::header::{ACCEPT_ENCODING, CONTENT_ENCODING, CONTENT_TYPE, ETAG, VARY};
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::response::Response;
use bytes::Bytes;
use tokio::sync::Semaphore;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{And, Predicate, SizeAbove};

use crate::library::LibraryError;

/// More takes twice the time for a tenth less.
const LEVEL: i32 = 3;
/// Shorter texts fit into a packet.
const TEXT_BYTES: u16 = 1024;

/// So little is compressed in less time than another thread takes to begin.
const SHORT_BYTES: usize = 32 * 1024;
/// Who compresses needs a processor, and memory for as much again.
static COMPRESSING: Semaphore = Semaphore::const_new(2);

/// Says that an answer depends on what its client takes.
pub(super) const VARIES: (HeaderName, HeaderValue) =
    (VARY, HeaderValue::from_static("accept-encoding"));
/// Says that an answer is compressed by Zstandard.
pub(super) const ZSTD: (HeaderName, HeaderValue) =
    (CONTENT_ENCODING, HeaderValue::from_static("zstd"));

/// Whether a client takes Zstandard (RFC 9110, 12.5.3); one that says nothing may not know it.
pub(super) fn takes_zstd(request: &HeaderMap) -> bool {
    let fields = request.get_all(ACCEPT_ENCODING);
    let members = fields
        .iter()
        .filter_map(|field| field.to_str().ok())
        .flat_map(|field| field.split(','));
    let weight = |member: &str| {
        let mut parts = member.split(';').map(str::trim);
        let is_zstd = parts.next()?.eq_ignore_ascii_case("zstd");
        let weight = parts.find_map(|part| part.strip_prefix("q=")?.parse::<f32>().ok());
        is_zstd.then(|| weight.unwrap_or(1.0))
    };
    members.filter_map(weight).any(|weight| weight > 0.0)
}

/// `pieces` one after the other, compressed; what takes its time on a thread that may.
pub(super) async fn compressed(
    pieces: impl Future<Output = Result<Vec<Bytes>, LibraryError>>,
) -> Result<Bytes, LibraryError> {
    let pieces = pieces.await?;
    let bytes: usize = pieces.iter().map(Bytes::len).sum();
    let compress = move || zstd::bulk::compress(&pieces.concat(), LEVEL).map(Bytes::from);
    let made = match bytes <= SHORT_BYTES {
        true => compress(),
        false => {
            // Never closed, so the permit always comes.
            let _permit = COMPRESSING.acquire().await;
            let made = tokio::task::spawn_blocking(compress).await;
            made.map_err(std::io::Error::other).flatten()
        }
    };
    made.map_err(LibraryError::Compress)
}

/// The tag of an answer that is compressed: the bytes are others, what they say is the same (RFC 9110, 8.8.1).
pub(super) fn weak(tag: &HeaderValue) -> HeaderValue {
    match tag.as_bytes() {
        strong @ [b'"', ..] => {
            HeaderValue::from_bytes(&[b"W/", strong].concat()).unwrap_or_else(|_| tag.clone())
        }
        _ => tag.clone(),
    }
}

/// Compresses texts on their way out.
pub(super) fn texts() -> CompressionLayer<And<SizeAbove, IsText>> {
    CompressionLayer::new().compress_when(SizeAbove::new(TEXT_BYTES).and(IsText))
}

/// To be applied around [`texts`], which leaves tags as they are.
pub(super) async fn weaken(mut answer: Response) -> Response {
    let is_encoded = answer.headers().contains_key(CONTENT_ENCODING);
    if let Some(tag) = answer.headers_mut().get_mut(ETAG).filter(|_| is_encoded) {
        *tag = weak(tag);
    }
    answer
}

/// Whether an answer is JSON or plain text, and not a stream of events.
#[derive(Debug, Clone, Copy)]
pub(super) struct IsText;

impl Predicate for IsText {
    fn should_compress<B>(&self, answer: &axum::http::Response<B>) -> bool {
        let kind = answer.headers().get(CONTENT_TYPE);
        let kind = kind.and_then(|kind| kind.to_str().ok()).unwrap_or_default();
        ["application/json", "text/plain"]
            .iter()
            .any(|text| kind.starts_with(text))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zstd_is_taken_where_it_is_asked_for() {
        for (field, takes) in [
            ("zstd", true),
            ("gzip, ZSTD;q=0.5", true),
            ("br, zstd; q=1.0", true),
            ("zstd;q=0", false),
            ("gzip, br", false),
            ("*", false),
            ("", false),
            ("zstdx", false),
        ] {
            let mut request = HeaderMap::new();
            request.insert(ACCEPT_ENCODING, HeaderValue::from_static(field));
            assert_eq!(takes_zstd(&request), takes, "{field}");
        }
        assert!(!takes_zstd(&HeaderMap::new()));
    }
}
