//! A GET a page range, one task each.

use std::collections::HashMap;
use std::time::Instant;

use tokio::task::AbortHandle;

use super::error::StreamError;
use super::order::Fetch;
use super::page_check::{decode_page, split_frames};
use super::source::blocking;
use super::streamer::{Message, Shared};

#[derive(Default)]
pub(crate) struct GetTransport {
    tasks: HashMap<u64, AbortHandle>,
}

impl GetTransport {
    pub(crate) fn send(&mut self, cancelled: &[u64], fetches: &[Fetch], shared: &Shared) {
        for fetch in cancelled {
            if let Some(task) = self.tasks.remove(fetch) {
                task.abort();
            }
        }
        for &fetch in fetches {
            let task = shared.runtime.spawn(get(fetch, shared.clone()));
            self.tasks.insert(fetch.id, task.abort_handle());
        }
    }

    pub(crate) fn ended(&mut self, fetch: u64) {
        self.tasks.remove(&fetch);
    }
}

impl Drop for GetTransport {
    fn drop(&mut self) {
        for task in self.tasks.values() {
            task.abort();
        }
    }
}

async fn get(fetch: Fetch, shared: Shared) {
    let (first, last) = (fetch.first_page, fetch.last_page);
    if let Err(error) = get_range(&fetch, first, last, &shared).await {
        // One page that the server finds damaged fails the whole range: the others still come.
        let damaged = matches!(error, StreamError::Status { status: 500, .. });
        for page in first..=last {
            let again = match damaged && first < last {
                true => get_range(&fetch, page, page, &shared).await,
                false => Err(error.clone()),
            };
            if let Err(error) = again {
                let page = shared.scene.assets[fetch.asset_index].page_base + page;
                shared.tell(page, Instant::now(), Err(error));
            }
        }
    }
    let _ = shared.messages.send(Message::GetEnded { fetch: fetch.id });
}

/// Tells of every page of a range, or of none and why.
async fn get_range(
    fetch: &Fetch,
    first: u32,
    last: u32,
    shared: &Shared,
) -> Result<(), StreamError> {
    let opened = &shared.scene.assets[fetch.asset_index];
    let bytes = shared.source.pages(opened, first, last).await?;
    let came = Instant::now();
    let frames = split_frames(&opened.hash, &opened.asset, first, last, &bytes)?;
    for (local, frame) in (first..).zip(frames) {
        let _permit = shared.decoders.acquire().await;
        let (scene, asset_index) = (shared.scene.clone(), fetch.asset_index);
        let decoded = blocking(move || {
            let opened = &scene.assets[asset_index];
            decode_page(
                &opened.hash,
                &opened.asset,
                &opened.hierarchy,
                local,
                &frame,
            )
        });
        shared.tell(opened.page_base + local, came, decoded.await);
    }
    Ok(())
}
