//! A range of an object as a response body of known length, in bounded memory.

use std::ops::Range;

use axum::body::Body;
use futures_util::TryStreamExt;
use lodestream_format::ContentHash;

use super::error::HttpError;
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

/// Whether an object of `bytes` is sent whole, after its hash was checked.
pub(super) fn is_small(bytes: u64) -> bool {
    bytes <= WHOLE_BYTES
}
