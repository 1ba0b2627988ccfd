//! Bodies of `POST /v1/pages`, and the streams that answer them.

use std::collections::HashSet;

use axum::body::Body;
use axum::http::{Request, StatusCode};
use lodestream_format::limits::MAX_PAGES_A_REQUEST;
use lodestream_format::wire::{BlockKind, PageStatus, PagesPost};

use super::blocks;
use super::input::with_hashes;
use super::served::served;

pub const MOST_BYTES: [usize; 2] = [64 << 20, 4096];

/// The body; `$A` is the hash of an asset that is there.
pub fn run(data: &[u8]) {
    let served = served();
    let body = with_hashes(data, &served.hashes);
    let post = serde_json::from_slice::<PagesPost>(&body).ok();
    if let Some(post) = &post {
        let json = serde_json::to_vec(post).expect("what was read can be written");
        // Numbers that are none become null, which is none.
        if post.wants.iter().all(|want| want.priority.is_finite()) {
            let again: PagesPost = serde_json::from_slice(&json).expect("what was written");
            assert_eq!(&again, post);
        }
    }
    let fits = post.filter(|post| {
        let pages = |want: &lodestream_format::wire::PageWant| {
            let fits = want.priority.is_finite() && want.first <= want.last;
            fits.then(|| u64::from(want.last - want.first) + 1)
        };
        let sum: Option<u64> = post.wants.iter().map(pages).sum();
        sum.is_some_and(|sum| sum <= MAX_PAGES_A_REQUEST as u64)
    });
    let request = Request::post("/v1/pages").body(Body::from(body));
    let answer = served.answer(request.expect("a request"));
    assert_eq!(answer.status == StatusCode::OK, fits.is_some());
    let Some(post) = fits else {
        assert!(answer.status.is_client_error(), "{}", answer.status);
        return;
    };
    let (answered, ended) = blocks::read(&answer.body, answer.body.len().max(1));
    assert_eq!(ended, Ok(true));
    // A later post of the same viewer, of an input before, may have ended it early.
    let mut seen = HashSet::new();
    for block in answered {
        let wants = |want: &lodestream_format::wire::PageWant| {
            want.asset == block.hash && (want.first..=want.last).contains(&block.page)
        };
        assert!(post.wants.iter().any(wants));
        assert!(seen.insert((block.hash, block.page)));
        assert_eq!(block.kind, BlockKind::Page);
        let entry = served.asset.pages.get(block.page as usize);
        match entry.filter(|_| block.hash == served.hashes[0].1) {
            None => assert_eq!(block.status, PageStatus::NotFound),
            Some(entry) => {
                let first = entry.offset as usize;
                let frame = &served.pack[first..first + entry.bytes as usize];
                assert_eq!((block.status, &*block.payload), (PageStatus::Ok, frame));
            }
        }
    }
}
