//! Bytes of objects as response bodies of known length, in bounded memory.

use std::convert::Infallible;
use std::ops::{Range, RangeInclusive};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use axum::body::{Body, HttpBody};
use bytes::Bytes;
use futures_util::{Stream, StreamExt, TryStreamExt, stream};
use hyper::body::{Frame, SizeHint};
use lodestream_format::hash::ContentHasher;
use lodestream_format::{Asset, ContentHash};

use super::AppState;
use super::error::HttpError;
use super::error_log;
use super::fair::Asker;
use super::page_cache::{RUN_BYTES, runs};
use super::slices::Slices;
use crate::library::LibraryError;

/// Bytes of a piece of a longer answer.
const PIECE_BYTES: u64 = RUN_BYTES;

/// The bytes of `range` of an object; longer ones are read piece by piece, as the client takes them, and of a whole object the last piece
/// goes out only if all have the object's hash.
pub(super) async fn range_body(
    state: &AppState,
    hash: &ContentHash,
    range: Range<u64>,
    is_whole: bool,
) -> Result<Body, HttpError> {
    let shared = &state.0;
    if is_small(range.end - range.start) {
        let room = shared.pages.room(range.end - range.start).await;
        let bytes = match is_whole {
            true => shared.library.object(hash).await?,
            false => shared.library.object_range(hash, range).await?,
        };
        return Ok(Body::from(room.keep(bytes)));
    }
    let (state, hash) = (state.clone(), *hash);
    Ok(streamed(stream::try_unfold(
        (range.start, None),
        move |(at, hasher)| {
            let state = state.clone();
            async move {
                if at >= range.end {
                    return Ok(None);
                }
                let shared = &state.0;
                let end = range.end.min(at + PIECE_BYTES);
                let room = shared.pages.room(end - at).await;
                let piece = room.keep(shared.library.object_range(&hash, at..end).await?);
                // Made when there is something to hash, and boxed: an answer that waits is small.
                let mut hasher: Option<Box<ContentHasher>> =
                    hasher.or_else(|| is_whole.then(Box::default));
                if let Some(hasher) = &mut hasher {
                    hasher.update(&piece);
                    if end == range.end {
                        shared
                            .library
                            .check_hash(&hash, std::mem::take(&mut **hasher), end)?;
                    }
                }
                Ok(Some((piece, (end, hasher))))
            }
        },
    )))
}

/// Frames of pages, from the cache: a few at once, so that what is damaged is an error and not a cut answer, more run by run as the client
/// takes them.
pub(super) async fn pages_body(
    state: &AppState,
    asset: &Arc<Asset>,
    pages: RangeInclusive<u32>,
    asker: Asker,
) -> Result<Body, HttpError> {
    let mut runs = runs(asset, pages);
    let Some(first) = runs.next() else {
        return Ok(Body::empty());
    };
    let shared = &state.0;
    let first = shared.pages.pages(asset, first, asker).await?;
    let mut runs = runs.peekable();
    if runs.peek().is_none() {
        return Ok(Body::new(first));
    }
    let (state, asset) = (state.clone(), Arc::clone(asset));
    let rest = stream::iter(runs).then(move |run| {
        let (state, asset) = (state.clone(), Arc::clone(&asset));
        async move {
            let shared = &state.0;
            shared.pages.pages(&asset, run, asker).await
        }
    });
    let all = stream::once(async { Ok(first) }).chain(rest);
    Ok(streamed(
        all.map_ok(|slices| stream::iter(slices.map(Ok)))
            .try_flatten(),
    ))
}

/// The status is out by then: where a piece fails the connection is cut, and the client sees fewer bytes than were promised.
fn streamed(pieces: impl Stream<Item = Result<Bytes, LibraryError>> + Send + 'static) -> Body {
    Body::from_stream(pieces.inspect_err(error_log::cut_short))
}

impl HttpBody for Slices {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        _: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        Poll::Ready(self.next().map(|slice| Ok(Frame::data(slice))))
    }

    fn is_end_stream(&self) -> bool {
        self.bytes() == 0
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.bytes())
    }
}

/// Whether an answer of `bytes` is in memory as a whole before its status goes out.
pub(super) fn is_small(bytes: u64) -> bool {
    bytes <= RUN_BYTES
}
