//! The body of `POST /v1/pages`, read in bounded memory: clients that stall cost other clients
//! nothing.
//!
//! Small posts need no room but the few bytes that they are. Beyond that a post takes room as its
//! bytes come, of its client's share, and waits for it a while. A body that does not keep the pace
//! is given up; the pace is stricter while room is short.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use axum::extract::Request;
use axum::http::header::CONTENT_LENGTH;
use lodestream_format::FormatError;
use lodestream_format::wire::PagesPost;
use tokio::time::timeout;

use super::budget::{Budget, Claim};
use super::error::HttpError;
use super::limits::ClientAddress;
use super::pace::{Pace, PacedBody};

/// Most bytes of a post: `MAX_PAGES_A_REQUEST` wants of one page each, at their longest.
const MAX_POST_BYTES: usize = 16 * 1024 * 1024;
/// Most bytes of all posts that are being read, but for one that may take all that a post may have.
const POSTS_BYTES: usize = MAX_POST_BYTES / 2;
/// Bytes of a post that are free; those of viewers have some hundreds to thousands.
const FREE_BYTES: usize = 4 * 1024;
/// Larger posts are not small: their later bytes come from [`POSTS_BYTES`].
const SMALL_BYTES: usize = 64 * 1024;
/// Most bytes of what is small beyond [`FREE_BYTES`], and of one client's; then as large ones.
const ALL_SMALL_BYTES: usize = 8 * 1024 * 1024;
/// Longest wait for room.
const ROOM_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest time for a post's body to come.
const BODY_TIMEOUT: Duration = Duration::from_secs(30);
/// The slowest post.
const PACE: Pace = Pace {
    idle: Duration::from_secs(10),
    grace: Duration::from_secs(5),
    min_bytes_per_sec: 8 * 1024,
};
/// The slowest post while room is short.
const SHORT_PACE: Pace = Pace {
    idle: Duration::from_secs(1),
    grace: Duration::from_secs(2),
    min_bytes_per_sec: 64 * 1024,
};

/// Room for the bodies of posts.
#[derive(Debug)]
pub(super) struct PostBodies {
    small: Arc<Budget>,
    large: Arc<Budget>,
    /// Of those that find no room one at a time goes on without: else they wait for each other.
    turn: Arc<Budget>,
}

impl Default for PostBodies {
    fn default() -> Self {
        Self {
            small: Budget::new(ALL_SMALL_BYTES, ALL_SMALL_BYTES / 2),
            large: Budget::new(POSTS_BYTES, POSTS_BYTES / 2),
            turn: Budget::new(1, 1),
        }
    }
}

/// Room of one post.
struct Room {
    bytes: usize,
    small: Claim,
    large: Claim,
    turn: Claim,
}

impl PostBodies {
    /// Reads a post.
    pub(super) async fn read(
        &self,
        client: ClientAddress,
        request: Request,
    ) -> Result<PagesPost, HttpError> {
        check_length(&request)?;
        let mut room = Room {
            bytes: 0,
            small: self.small.claim(client.0),
            large: self.large.claim(client.0),
            turn: self.turn.claim(client.0),
        };
        let stream = request.into_body().into_data_stream();
        // Read by the pace while the body is waited for.
        let (holds_room, has_turn) = (AtomicBool::new(false), AtomicBool::new(false));
        let pace = || match holds_room.load(Ordering::Relaxed) {
            true if has_turn.load(Ordering::Relaxed) || self.is_short(client) => SHORT_PACE,
            // A post that holds no room hinders nobody.
            _ => PACE,
        };
        let mut body = PacedBody::new("post", stream, pace);
        let mut bytes = Vec::new();
        let whole = async {
            while let Some(piece) = body.next().await? {
                if bytes.len() + piece.len() > MAX_POST_BYTES {
                    return Err(too_large(&"more"));
                }
                let taken = timeout(ROOM_TIMEOUT, room.take(piece.len())).await;
                taken.map_err(|_| HttpError::NotReady)?;
                holds_room.store(room.is_held(), Ordering::Relaxed);
                has_turn.store(room.turn.units() > 0, Ordering::Relaxed);
                bytes.extend_from_slice(&piece);
            }
            Ok(())
        };
        let read = timeout(BODY_TIMEOUT, whole).await;
        read.map_err(|_| HttpError::Slow)??;
        serde_json::from_slice(&bytes).map_err(|error| {
            let expected = "JSON {viewer, sequence, wants: [{asset, first, last, priority}]}";
            HttpError::BadRequest(FormatError::new("post", expected, error))
        })
    }

    fn is_short(&self, client: ClientAddress) -> bool {
        self.small.is_short(client.0) || self.large.is_short(client.0)
    }
}

impl Room {
    /// Takes room for `bytes` more; waits where there is none.
    async fn take(&mut self, bytes: usize) {
        self.bytes += bytes;
        let is_free = self.bytes <= FREE_BYTES;
        if is_free || self.bytes <= SMALL_BYTES && self.small.try_grow(bytes) {
            return;
        }
        if self.turn.units() == 0 {
            tokio::select! {
                biased;
                () = self.large.grow(bytes) => {}
                () = self.turn.grow(1) => {}
            }
        }
    }

    fn is_held(&self) -> bool {
        self.small.units() + self.large.units() + self.turn.units() > 0
    }
}

fn check_length(request: &Request) -> Result<(), HttpError> {
    let length = request.headers().get(CONTENT_LENGTH);
    let length = length.and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
    match length {
        Some(length) if length > MAX_POST_BYTES as u64 => Err(too_large(&length)),
        // A length that cannot be read is refused below us; the bytes are counted in any case.
        _ => Ok(()),
    }
}

fn too_large(found: &dyn std::fmt::Display) -> HttpError {
    let expected = format!("at most {MAX_POST_BYTES} bytes");
    HttpError::TooLarge(FormatError::new("post", expected, found))
}
