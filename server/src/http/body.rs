//! Bytes of objects as response bodies of known length, in bounded memory.

use std::convert::Infallible;
use std::ops::{Range, RangeInclusive};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use axum::body::{Body, HttpBody};
use bytes::Bytes;
use futures_util::{Stream, TryStreamExt, stream};
use hyper::body::{Frame, SizeHint};
use lodestream_format::{Asset, ContentHash};

use super::AppState;
use super::error::HttpError;
use super::error_log;
use super::fair::Asker;
use super::page_cache::{Slices, bytes_of, read_pages};
use crate::library::{Library, LibraryError};

/// Ranges up to this come in one read before the status goes out, so that a damaged object is an error and not a cut answer.
const WHOLE_BYTES: u64 = 4 * 1024 * 1024;
/// Pages of longer answers are read so many bytes at a time.
const RUN_BYTES: u64 = 1024 * 1024;

/// The bytes of `range` of an object; longer ones are read piece by piece, as the client takes them, and of a whole object the last piece
/// goes out only if all have the object's hash.
pub(super) async fn range_body(
    library: &Library,
    hash: &ContentHash,
    range: Range<u64>,
    is_whole: bool,
) -> Result<Body, HttpError> {
    if range.end - range.start <= WHOLE_BYTES {
        return Ok(Body::from(library.object_range(hash, range).await?));
    }
    Ok(match is_whole {
        true => streamed(library.checked_pieces(hash, range.end)),
        false => streamed(library.object_pieces(hash, range)),
    })
}

/// Frames of pages; those of up to a few MiB come from the cache, more are read run by run as the client takes them.
pub(super) async fn pages_body(
    state: &AppState,
    asset: &Arc<Asset>,
    pages: RangeInclusive<u32>,
    asker: Asker,
) -> Result<Body, HttpError> {
    let shared = &state.0;
    let bytes = bytes_of(asset, &pages);
    if is_small(bytes.end - bytes.start) {
        let slices = shared
            .pages
            .pages(&shared.library, asset, pages, asker)
            .await?;
        return Ok(Body::new(slices));
    }
    let (library, asset) = (shared.library.clone(), Arc::clone(asset));
    let runs = stream::try_unfold(*pages.start(), move |first| {
        let (library, asset, last) = (library.clone(), Arc::clone(&asset), *pages.end());
        async move {
            if first > last {
                return Ok(None);
            }
            let begin = asset.pages[first as usize].offset;
            let after = asset
                .pages
                .partition_point(|page| page.offset < begin + RUN_BYTES);
            let end = last.min(after as u32 - 1);
            let run = read_pages(&library, &asset, first..=end).await?;
            Ok::<_, LibraryError>(Some((run, end + 1)))
        }
    });
    Ok(streamed(runs))
}

/// The status is out by then: where a piece fails the connection is cut, and the client sees fewer bytes than were promised.
fn streamed(pieces: impl Stream<Item = Result<Bytes, LibraryError>> + Send + 'static) -> Body {
    Body::from_stream(pieces.inspect_err(|error| error_log::cut_short(error)))
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
