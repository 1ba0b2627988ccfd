//! `POST /v1/pages`: many ranges of many assets at once; pages stream back, most urgent first.
//!
//! Memory of one answer: `ANSWERS_AHEAD` + 2 reads of about `JOIN_BYTES`, whatever was asked for. The answer ends early, with
//! its end block, when a later post of the same viewer comes; with nothing, when the connection goes.

use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::extract::{Request, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use bytes::{BufMut, Bytes, BytesMut};
use futures_util::stream;
use lodestream_format::wire::{self, BlockKind, PageStatus, PagesPost};
use lodestream_format::{Asset, ContentHash, FormatError};
use tokio::sync::mpsc;

use super::AppState;
use super::error::HttpError;
use super::page_plan::{PagePlan, Run};
use super::viewers::Turn;
use crate::library::LibraryError;

/// Most bytes of a post: `MAX_PAGES_A_REQUEST` wants of one page each, at their longest.
const MAX_POST_BYTES: usize = 16 * 1024 * 1024;
/// Longest time for a post's body to come.
const BODY_TIMEOUT: Duration = Duration::from_secs(30);
/// An answer of which nothing is taken for so long is given up.
const STALL_TIMEOUT: Duration = Duration::from_secs(60);
/// Reads that wait for the connection to take them.
const ANSWERS_AHEAD: usize = 2;
/// Pages of one run where nothing is read.
const EMPTY_PAGE_BYTES: u64 = wire::BLOCK_HEADER_BYTES as u64;

/// `POST /v1/pages`
pub(super) async fn post_pages(
    State(state): State<AppState>,
    request: Request,
) -> Result<Response, HttpError> {
    let post = read_post(request.into_body()).await?;
    let plan = PagePlan::new(&post)?;
    let turn = state.0.viewers.enter(post.viewer, post.sequence);
    let (sender, receiver) = mpsc::channel(ANSWERS_AHEAD);
    tokio::spawn(answer(state, plan, turn, sender));
    let blocks = stream::unfold(receiver, |mut receiver| async {
        let block: Bytes = receiver.recv().await?;
        Some((Ok::<_, std::convert::Infallible>(block), receiver))
    });
    let headers = [
        (CONTENT_TYPE, wire::MEDIA_TYPE),
        (CACHE_CONTROL, "no-store"),
    ];
    Ok((headers, Body::from_stream(blocks)).into_response())
}

async fn read_post(body: Body) -> Result<PagesPost, HttpError> {
    let Ok(read) = tokio::time::timeout(BODY_TIMEOUT, to_bytes(body, MAX_POST_BYTES)).await else {
        return Err(HttpError::Slow);
    };
    let bytes = read.map_err(|error| {
        let expected = format!("at most {MAX_POST_BYTES} bytes");
        HttpError::TooLarge(FormatError::new("post", expected, error))
    })?;
    serde_json::from_slice(&bytes).map_err(|error| {
        let expected = "JSON {viewer, sequence, wants: [{asset, first, last, priority}]}";
        HttpError::BadRequest(FormatError::new("post", expected, error))
    })
}

/// Sends run after run, until done, superseded, or nobody listens.
async fn answer(state: AppState, mut plan: PagePlan, mut turn: Turn, sender: mpsc::Sender<Bytes>) {
    while let Some(asset) = plan.next_asset() {
        let block = tokio::select! {
            biased;
            () = turn.superseded() => break,
            () = sender.closed() => return,
            block = next_blocks(&state, &mut plan, asset) => block,
        };
        tokio::select! {
            biased;
            () = turn.superseded() => break,
            sent = sender.send_timeout(block, STALL_TIMEOUT) => if sent.is_err() { return },
        }
    }
    let end = Bytes::copy_from_slice(&wire::end_block());
    // An error means that nobody listens any longer.
    let _ = sender.send_timeout(end, STALL_TIMEOUT).await;
}

/// Reads the next run; gives its blocks end to end.
async fn next_blocks(state: &AppState, plan: &mut PagePlan, asset_hash: ContentHash) -> Bytes {
    let shared = &state.0;
    match shared.tables.asset(&shared.library, &asset_hash).await {
        Ok(asset) => {
            let page_bytes = |page: u32| {
                let entry = asset.pages.get(page as usize);
                entry.map_or(EMPTY_PAGE_BYTES, |entry| entry.bytes as u64)
            };
            match plan.next_run(page_bytes) {
                Some(run) => read_run(state, &asset, run).await,
                None => Bytes::new(),
            }
        }
        Err(error) => {
            let status = status_of(&error);
            let run = plan.next_run(|_| EMPTY_PAGE_BYTES);
            run.map_or_else(Bytes::new, |run| {
                let mut blocks = BytesMut::new();
                for page in run.first..=run.last {
                    blocks.put_slice(&wire::block_header(
                        BlockKind::Page,
                        status,
                        page,
                        run.asset,
                        0,
                    ));
                }
                blocks.freeze()
            })
        }
    }
}

async fn read_run(state: &AppState, asset: &Asset, run: Run) -> Bytes {
    let library = &state.0.library;
    let entries = asset.pages.get(run.first as usize..).unwrap_or(&[]);
    let entries = &entries[..entries.len().min((run.last - run.first) as usize + 1)];
    let bytes: u64 = entries.iter().map(|entry| entry.bytes as u64).sum();
    let offset = entries.first().map_or(0, |entry| entry.offset);
    let whole = library
        .object_range(&asset.pack, offset..offset + bytes)
        .await;

    let headers = (run.last - run.first) as usize + 1;
    let mut blocks = BytesMut::with_capacity(bytes as usize + headers * wire::BLOCK_HEADER_BYTES);
    let mut put = |status, page, frame: &[u8]| {
        let length = frame.len() as u64;
        blocks.put_slice(&wire::block_header(
            BlockKind::Page,
            status,
            page,
            run.asset,
            length,
        ));
        blocks.put_slice(frame);
    };
    let mut sent = 0;
    for page in run.first..=run.last {
        let Some(entry) = entries.get((page - run.first) as usize) else {
            put(PageStatus::NotFound, page, &[]);
            continue;
        };
        let range = entry.offset..entry.offset + entry.bytes as u64;
        let frame = match &whole {
            Ok(bytes) => {
                let first = (range.start - offset) as usize;
                Ok(bytes.slice(first..first + entry.bytes as usize))
            }
            // A pack that ends early still has the pages before its end: one bad page never stops the rest.
            Err(LibraryError::Damaged { .. }) => library.object_range(&asset.pack, range).await,
            Err(_) => Err(LibraryError::NoObject {
                location: library.location().to_owned(),
                path: asset.pack.to_string(),
            }),
        };
        match frame {
            Ok(frame) => {
                put(PageStatus::Ok, page, &frame);
                sent += 1;
            }
            // The asset is there, so a missing pack is a failed store and not a page that never was.
            Err(_) => put(PageStatus::Failed, page, &[]),
        }
    }
    if let Err(error) = whole {
        tracing::error!(
            "pages {}..={} of {}: {error}",
            run.first,
            run.last,
            run.asset
        );
    }
    state.0.metrics.pages_sent(sent);
    blocks.freeze()
}

fn status_of(error: &LibraryError) -> PageStatus {
    if error.is_missing() {
        return PageStatus::NotFound;
    }
    tracing::error!("{error}");
    PageStatus::Failed
}
