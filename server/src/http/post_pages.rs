//! `POST /v1/pages`: many ranges of many assets at once; pages stream back, most urgent first.
//!
//! Memory of one answer: `ANSWERS_AHEAD` + 2 reads of about `JOIN_BYTES`, whatever was asked for. The answer ends early, with
//! its end block, when a later post of the same viewer comes; with nothing, when the connection goes.

use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::extract::{Request, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use futures_util::{StreamExt, stream};
use lodestream_format::asset::PageEntry;
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
    let runs = stream::unfold(receiver, |mut receiver| async {
        let run: Vec<Bytes> = receiver.recv().await?;
        Some((stream::iter(run), receiver))
    });
    let blocks = runs.flatten().map(Ok::<_, std::convert::Infallible>);
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
async fn answer(
    state: AppState,
    mut plan: PagePlan,
    mut turn: Turn,
    sender: mpsc::Sender<Vec<Bytes>>,
) {
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
    let end = vec![Bytes::copy_from_slice(&wire::end_block())];
    // An error means that nobody listens any longer.
    let _ = sender.send_timeout(end, STALL_TIMEOUT).await;
}

/// Reads the next run; gives its blocks end to end.
async fn next_blocks(state: &AppState, plan: &mut PagePlan, asset_hash: ContentHash) -> Vec<Bytes> {
    let shared = &state.0;
    match shared.tables.asset(&shared.library, &asset_hash).await {
        Ok(asset) => {
            let page_bytes = |page: u32| {
                let entry = asset.pages.get(page as usize);
                entry.map_or(EMPTY_PAGE_BYTES, |entry| entry.bytes as u64)
            };
            match plan.next_run(page_bytes) {
                Some(run) => read_run(state, &asset, run).await,
                None => Vec::new(),
            }
        }
        Err(error) => {
            let status = status_of(&error);
            let run = plan.next_run(|_| EMPTY_PAGE_BYTES);
            run.map_or_else(Vec::new, |run| {
                let header = |page| wire::block_header(BlockKind::Page, status, page, run.asset, 0);
                let headers: Vec<u8> = (run.first..=run.last).flat_map(header).collect();
                vec![Bytes::from(headers)]
            })
        }
    }
}

/// The blocks of a run: headers, and slices of what the cache has.
async fn read_run(state: &AppState, asset: &Asset, run: Run) -> Vec<Bytes> {
    let shared = &state.0;
    let entries = asset.pages.get(run.first as usize..).unwrap_or(&[]);
    let entries = &entries[..entries.len().min((run.last - run.first) as usize + 1)];
    let bytes_of = |page: &PageEntry| page.offset..page.offset + page.bytes as u64;
    let whole = match entries {
        [first, .., last] => bytes_of(first).start..bytes_of(last).end,
        [one] => bytes_of(one),
        [] => 0..0,
    };
    let mut read = shared.pages.range(&shared.library, asset, whole).await;
    let mut blocks = Vec::with_capacity(3 * (run.last - run.first) as usize + 3);
    let mut sent = 0;
    for page in run.first..=run.last {
        let header = |status, bytes: u64| {
            let header = wire::block_header(BlockKind::Page, status, page, run.asset, bytes);
            Bytes::copy_from_slice(&header)
        };
        let Some(entry) = entries.get((page - run.first) as usize) else {
            blocks.push(header(PageStatus::NotFound, 0));
            continue;
        };
        let slices = match &mut read {
            Ok(read) => Ok(read.take_bytes(entry.bytes as usize)),
            // One bad page never stops the rest.
            Err(_) => {
                let range = bytes_of(entry);
                let slices = shared.pages.range(&shared.library, asset, range).await;
                slices.map(Iterator::collect)
            }
        };
        match slices {
            Ok(slices) => {
                blocks.push(header(PageStatus::Ok, entry.bytes as u64));
                blocks.extend(slices);
                sent += 1;
            }
            // The asset is there, so a missing pack is a failed store and not a page that never was.
            Err(error) => {
                tracing::error!("page {page} of {}: {error}", run.asset);
                blocks.push(header(PageStatus::Failed, 0));
            }
        }
    }
    shared.metrics.pages_sent(sent);
    blocks
}

fn status_of(error: &LibraryError) -> PageStatus {
    if error.is_missing() {
        return PageStatus::NotFound;
    }
    tracing::error!("{error}");
    PageStatus::Failed
}
