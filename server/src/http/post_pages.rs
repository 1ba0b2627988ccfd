//! `POST /v1/pages`: many ranges of many assets at once; pages stream back, most urgent first.
//!
//! Memory of one answer: `READS_AHEAD` + 1 reads of about `RUN_BYTES`, whatever was asked for. The answer ends early, with
//! its end block, when a later post of the same viewer comes; with nothing, when the connection goes.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use futures_util::future::BoxFuture;
use futures_util::stream::{self, BoxStream};
use futures_util::{FutureExt, StreamExt};
use lodestream_format::Asset;
use lodestream_format::wire::{self, BlockKind, PageStatus};
use tracing::Instrument;

use super::AppState;
use super::error::HttpError;
use super::error_log;
use super::fair::Asker;
use super::limits::ClientAddress;
use super::page_plan::{PagePlan, Run};
use super::slices::Slices;
use crate::library::LibraryError;

/// Reads of one answer at once: a store far away is waited for once and not for every run. They end in the order in which they are sent.
const READS_AHEAD: usize = 4;
/// Pages of one run where nothing is read.
const EMPTY_PAGE_BYTES: u64 = wire::BLOCK_HEADER_BYTES as u64;

/// `POST /v1/pages`
pub(super) async fn post_pages(
    State(state): State<AppState>,
    client: ClientAddress,
    request: Request,
) -> Result<Response, HttpError> {
    let post = state.0.posts.read(client, request).await?;
    let plan = PagePlan::new(&post)?;
    // Counts for as long as the answer lasts.
    let room = state.0.pages.memory().hold(plan.bytes());
    let asker = Asker::Viewer(post.viewer);
    let turn = state.0.viewers.enter(post.viewer, post.sequence);
    // Polled as the connection takes it: nothing runs for a client that does not read.
    let runs = runs(state, client, plan, asker).take_until(turn.ended());
    let end = stream::once(async { vec![Bytes::copy_from_slice(&wire::end_block())] });
    let blocks = runs.chain(end).flat_map(stream::iter);
    let blocks = blocks.map(move |block| {
        let _held = &room;
        Ok::<_, std::convert::Infallible>(block)
    });
    let headers = [
        (CONTENT_TYPE, wire::MEDIA_TYPE),
        (CACHE_CONTROL, "no-store"),
    ];
    Ok((headers, Body::from_stream(blocks)).into_response())
}

/// The blocks of run after run.
fn runs(
    state: AppState,
    client: ClientAddress,
    plan: PagePlan,
    asker: Asker,
) -> BoxStream<'static, Vec<Bytes>> {
    let span = tracing::Span::current();
    let reads = stream::unfold((state, plan), move |(state, mut plan)| {
        let span = span.clone();
        async move {
            let read = next_read(state.clone(), client, &mut plan, asker).await?;
            Some((read.instrument(span), (state, plan)))
        }
    });
    reads.buffered(READS_AHEAD).boxed()
}

/// The read of the next run, which gives its blocks end to end.
async fn next_read(
    state: AppState,
    client: ClientAddress,
    plan: &mut PagePlan,
    asker: Asker,
) -> Option<BoxFuture<'static, Vec<Bytes>>> {
    let asset = find(&state, client, plan).await?;
    let page_bytes = |page: u32| {
        let pages = asset.as_ref().map_or(&[][..], |asset| &asset.pages);
        let entry = pages.get(page as usize);
        entry.map_or(EMPTY_PAGE_BYTES, |entry| entry.bytes as u64)
    };
    let run = plan.next_run(page_bytes)?;
    let read = async move {
        match asset {
            Ok(asset) => read_run(&state, &asset, run, asker).await,
            Err(status) => {
                let header = |page| wire::block_header(BlockKind::Page, status, page, run.asset, 0);
                let headers: Vec<u8> = (run.first..=run.last).flat_map(header).collect();
                vec![Bytes::from(headers)]
            }
        }
    };
    Some(read.boxed())
}

/// The asset of the next run, or the status of its pages.
async fn find(
    state: &AppState,
    client: ClientAddress,
    plan: &mut PagePlan,
) -> Option<Result<Arc<Asset>, PageStatus>> {
    let hash = plan.next_asset()?;
    let found = match state.0.tables.held(&hash) {
        Some(asset) => return Some(Ok(asset)),
        None if plan.is_missed(&hash) => return Some(Err(PageStatus::NotFound)),
        // It may be there: a later post may ask for it.
        None if !plan.may_look() => return Some(Err(PageStatus::Failed)),
        None => state.asset(client, &hash).await,
    };
    Some(found.map_err(|error| {
        if error.is_missing() {
            plan.miss(hash);
            return PageStatus::NotFound;
        }
        error_log::error("post", &error);
        PageStatus::Failed
    }))
}

/// The blocks of a run: headers, and slices of what the cache has.
async fn read_run(state: &AppState, asset: &Arc<Asset>, run: Run, asker: Asker) -> Vec<Bytes> {
    let shared = &state.0;
    let count = asset.pages.len() as u64;
    let there = u64::from(run.first)..=u64::from(run.last).min(count.saturating_sub(1));
    let mut read = Ok(Slices::default());
    if u64::from(run.first) < count {
        let pages = run.first..=*there.end() as u32;
        read = shared.pages.pages(asset, pages, asker).await;
    }
    let mut blocks = Vec::with_capacity(3 * (run.last - run.first) as usize + 3);
    let mut sent = 0;
    let mut failed = 0;
    for page in run.first..=run.last {
        let header = |status, bytes: u64| {
            let header = wire::block_header(BlockKind::Page, status, page, run.asset, bytes);
            Bytes::copy_from_slice(&header)
        };
        let Some(entry) = asset.pages.get(page as usize) else {
            blocks.push(header(PageStatus::NotFound, 0));
            continue;
        };
        let slices = match &mut read {
            Ok(read) => Some(read.take_bytes(entry.bytes as usize)),
            // One bad page never stops the rest.
            Err(LibraryError::Damaged { .. }) => {
                let pages = shared.pages.pages(asset, page..=page, asker);
                pages.await.ok().map(Iterator::collect)
            }
            // A store that fails is not asked again for every page of the run.
            Err(_) => shared
                .pages
                .held(asset, page..=page, asker)
                .map(Iterator::collect),
        };
        match slices {
            Some(slices) => {
                blocks.push(header(PageStatus::Ok, entry.bytes as u64));
                blocks.extend(slices);
                sent += 1;
            }
            // The asset is there, so a missing pack is a failed store and not a page that never was.
            None => {
                blocks.push(header(PageStatus::Failed, 0));
                failed += 1;
            }
        }
    }
    if let Err(error) = read {
        let text = format!(
            "{failed} of pages {}..={} of {}: {error}",
            run.first, run.last, run.asset
        );
        error_log::error("post", &text);
    }
    shared.metrics.pages_sent(sent);
    blocks
}
