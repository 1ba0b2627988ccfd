//! Bytes of objects as response bodies of known length, in bounded memory.

use std::convert::Infallible;
use std::ops::Range;
use std::pin::Pin;
use std::task::{Context, Poll};

use axum::body::{Body, HttpBody};
use bytes::Bytes;
use futures_util::TryStreamExt;
use hyper::body::{Frame, SizeHint};
use lodestream_format::{Asset, ContentHash};

use super::AppState;
use super::error::HttpError;
use super::page_cache::Slices;
use crate::library::Library;

/// Ranges up to this come in one read before the status goes out, so that a damaged object is an error and not a cut answer.
const WHOLE_BYTES: u64 = 4 * 1024 * 1024;

/// The bytes of `range`; longer ones are read piece by piece, as the client takes them.
pub(super) async fn range_body(
    library: &Library,
    hash: &ContentHash,
    range: Range<u64>,
) -> Result<Body, HttpError> {
    if range.end - range.start <= WHOLE_BYTES {
        return Ok(Body::from(library.object_range(hash, range).await?));
    }
    let pieces = library.object_pieces(hash, range);
    // The status is out by then: the connection is cut, and the client sees fewer bytes than were promised.
    Ok(Body::from_stream(pieces.inspect_err(|error| {
        tracing::error!("answer cut short: {error}");
    })))
}

/// The bytes `range` of an asset's pack; those of up to a few pages come from the cache.
pub(super) async fn pack_body(
    state: &AppState,
    asset: &Asset,
    range: Range<u64>,
) -> Result<Body, HttpError> {
    let shared = &state.0;
    if range.end - range.start > WHOLE_BYTES {
        return range_body(&shared.library, &asset.pack, range).await;
    }
    let slices = shared.pages.range(&shared.library, asset, range).await?;
    Ok(Body::new(slices))
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

/// Whether an object of `bytes` is sent whole, after its hash was checked.
pub(super) fn is_small(bytes: u64) -> bool {
    bytes <= WHOLE_BYTES
}
