//! `Content-Encoding` of what is not compressed already: hierarchies by Zstandard, which halves them, once for all who ask; texts by gzip,
//! which every client of theirs knows, as they are sent. Pages, manifests and images are compressed in the library.

use std::future::Future;
use std::io::{self, Write};

use axum::body::{Body, HttpBody, to_bytes};
use axum::extract::{Request, State};
use axum::http::header::{
    ACCEPT_ENCODING, CONTENT_ENCODING, CONTENT_LENGTH, CONTENT_TYPE, ETAG, VARY,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use flate2::Compression;
use flate2::write::GzEncoder;
use tokio::sync::Semaphore;

use super::AppState;
use super::error::HttpError;
use crate::library::LibraryError;

/// More takes twice the time for a tenth less.
const LEVEL: i32 = 3;
/// Shorter texts fit into a packet.
const TEXT_BYTES: u64 = 1024;

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

/// Whether a client takes Zstandard; one that says nothing may not know it.
pub(super) fn takes_zstd(request: &HeaderMap) -> bool {
    takes(request, "zstd")
}

/// Whether a client names `coding` as one that it takes (RFC 9110, 12.5.3).
fn takes(request: &HeaderMap, coding: &str) -> bool {
    let fields = request.get_all(ACCEPT_ENCODING);
    let members = fields
        .iter()
        .filter_map(|field| field.to_str().ok())
        .flat_map(|field| field.split(','));
    let weight = |member: &str| {
        let mut parts = member.split(';').map(str::trim);
        let is_named = parts.next()?.eq_ignore_ascii_case(coding);
        let weight = parts.find_map(|part| part.strip_prefix("q=")?.parse::<f32>().ok());
        is_named.then(|| weight.unwrap_or(1.0))
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
    compressed_by(bytes, compress).await
}

/// The result of `compress`, of so many bytes.
async fn compressed_by(
    bytes: usize,
    compress: impl FnOnce() -> io::Result<Bytes> + Send + 'static,
) -> Result<Bytes, LibraryError> {
    let made = match bytes <= SHORT_BYTES {
        true => compress(),
        false => {
            // Never closed, so the permit always comes.
            let _permit = COMPRESSING.acquire().await;
            let made = tokio::task::spawn_blocking(compress).await;
            made.map_err(io::Error::other).flatten()
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

/// Compresses texts on their way out, for those who take that. All of a text is made, counted and
/// compressed at once: an encoder of a stream keeps 300 KB for as long as its client reads.
pub(super) async fn texts(State(state): State<AppState>, request: Request, next: Next) -> Response {
    let takes_gzip = takes(request.headers(), "gzip");
    let answer = next.run(request).await;
    // A text of known length is in memory.
    let bytes = answer.body().size_hint().exact().unwrap_or(0);
    if bytes < TEXT_BYTES || !is_text(answer.headers()) {
        return answer;
    }
    let (mut head, body) = answer.into_parts();
    let room = state.0.pages.room(bytes).await;
    let text = match to_bytes(body, bytes as usize).await {
        Ok(text) => room.keep(text),
        Err(error) => {
            let error = LibraryError::Compress(io::Error::other(error));
            return HttpError::Library(error).into_response();
        }
    };
    head.headers.append(VARIES.0, VARIES.1);
    if !takes_gzip {
        return Response::from_parts(head, Body::from(text));
    }
    let compress = move || {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(&text)?;
        encoder.finish().map(Bytes::from)
    };
    let packed = match compressed_by(bytes as usize, compress).await {
        Ok(packed) => state.0.pages.memory().keep(packed),
        Err(error) => return HttpError::Library(error).into_response(),
    };
    head.headers.remove(CONTENT_LENGTH);
    head.headers
        .insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    if let Some(tag) = head.headers.get_mut(ETAG) {
        *tag = weak(tag);
    }
    Response::from_parts(head, Body::from(packed))
}

/// Whether an answer is JSON or plain text, not compressed already, and no stream of events.
fn is_text(answer: &HeaderMap) -> bool {
    let kind = answer.get(CONTENT_TYPE);
    let kind = kind.and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    let is_text = ["application/json", "text/plain"]
        .iter()
        .any(|text| kind.starts_with(text));
    is_text && !answer.contains_key(CONTENT_ENCODING)
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

    #[tokio::test]
    async fn a_text_that_nobody_reads_counts_until_it_is_gone() {
        use hyper::service::Service;
        use hyper_util::service::TowerToHyperService;
        let library = crate::library::Library::open("memory://").expect("memory opens");
        let state = AppState::new(library, 1 << 20);
        let memory = state.0.pages.memory();
        for coding in ["identity", "gzip"] {
            let request = Request::get("/v1/openapi.json").header(ACCEPT_ENCODING, coding);
            let request = request.body(Body::empty()).expect("a request");
            let router = super::super::router(state.clone());
            let answer = TowerToHyperService::new(router).call(request).await;
            let answer = answer.unwrap_or_else(|error| match error {});
            let bytes = answer.body().size_hint().exact();
            assert_eq!(Some(memory.beside()), bytes, "{coding}");
            assert_eq!(answer.headers()[VARY], "accept-encoding");
            drop(answer);
            assert_eq!(memory.beside(), 0, "{coding}");
        }
    }
}
