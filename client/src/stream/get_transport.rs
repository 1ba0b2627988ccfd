//! A GET a page range, one task each.

use std::collections::HashMap;
use std::time::Instant;

use tokio::task::AbortHandle;

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
    let opened = &shared.scene.assets[fetch.asset_index];
    let (first, last) = (fetch.first_page, fetch.last_page);
    let answer = shared.source.pages(opened, first, last).await;
    let came = Instant::now();
    let frames =
        answer.and_then(|bytes| split_frames(&opened.hash, &opened.asset, first, last, &bytes));
    let scene_page = |local: u32| opened.page_base + local;
    // The receiver is gone when the streamer is: then nobody needs to know.
    let tell = |page, result| {
        let result = Box::new(result);
        let _ = shared.messages.send(Message::Page { page, came, result });
    };
    match frames {
        Err(error) => (first..=last).for_each(|local| tell(scene_page(local), Err(error.clone()))),
        Ok(frames) => {
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
                tell(scene_page(local), decoded.await);
            }
        }
    }
    let _ = shared.messages.send(Message::GetEnded { fetch: fetch.id });
}
