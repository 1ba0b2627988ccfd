//! Posts that name everything in flight. A post replaces what the server has not sent yet of the one before, so the
//! answers overlap, and a page may come with either.

use std::collections::{BTreeMap, HashMap};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::ops::Range;
use std::time::Instant;

use lodestream_format::limits::MAX_PAGES_A_REQUEST;
use lodestream_format::wire::{PageWant, PagesPost};
use tokio::task::{AbortHandle, JoinSet};

use super::error::StreamError;
use super::opened_scene::{OpenedAsset, OpenedScene};
use super::order::Fetch;
use super::page_check::decode_page;
use super::residency::Residency;
use super::source::{PageAnswer, blocking};
use super::streamer::{Message, Shared};

/// Shortest time between posts: what changes sooner waits for the next one.
const POST_INTERVAL_SECS: f64 = 0.03;

pub(crate) struct PostTransport {
    viewer: u64,
    /// Of the last post; 0 before the first.
    sequence: u64,
    /// Pages in flight, with the sequence of the last post that named them.
    outstanding: BTreeMap<u32, Option<u64>>,
    /// Pages of the fetches that may yet be called off.
    fetches: HashMap<u64, Range<u32>>,
    /// Posts whose answers have not ended.
    live: BTreeMap<u64, AbortHandle>,
    /// Whether something changed since the last post.
    changed: bool,
    next_post_secs: f64,
}

impl Default for PostTransport {
    fn default() -> Self {
        Self {
            // The standard library's hash keys are random.
            viewer: RandomState::new().build_hasher().finish(),
            sequence: 0,
            outstanding: BTreeMap::new(),
            fetches: HashMap::new(),
            live: BTreeMap::new(),
            changed: false,
            next_post_secs: 0.0,
        }
    }
}

impl PostTransport {
    pub(crate) fn send(
        &mut self,
        cancelled: &[u64],
        fetches: &[Fetch],
        residency: &Residency,
        now_secs: f64,
        shared: &Shared,
    ) {
        for pages in cancelled.iter().map(|id| self.fetches.remove(id)) {
            for page in pages.unwrap_or_default() {
                self.outstanding.remove(&page);
            }
            self.changed = true;
        }
        for fetch in fetches {
            let base = shared.scene.assets[fetch.asset_index].page_base;
            let pages = base + fetch.first_page..base + fetch.last_page + 1;
            self.outstanding
                .extend(pages.clone().map(|page| (page, None)));
            self.fetches.insert(fetch.id, pages);
            self.changed = true;
        }
        if self.changed && now_secs >= self.next_post_secs {
            self.next_post_secs = now_secs + POST_INTERVAL_SECS;
            let outstanding = &self.outstanding;
            self.fetches
                .retain(|_, pages| outstanding.range(pages.clone()).next().is_some());
            self.post(residency, shared);
        }
    }

    fn post(&mut self, residency: &Residency, shared: &Shared) {
        self.sequence += 1;
        self.changed = self.outstanding.len() > MAX_PAGES_A_REQUEST;
        let named = self.outstanding.iter_mut().take(MAX_PAGES_A_REQUEST);
        let pages: Vec<(u32, f32)> = named
            .map(|(&page, sequence)| {
                *sequence = Some(self.sequence);
                (page, residency.priority_px(page))
            })
            .collect();
        let post = PagesPost {
            viewer: self.viewer,
            sequence: self.sequence,
            wants: wants(&shared.scene, &pages),
        };
        let task = shared.runtime.spawn(answer(post, shared.clone()));
        self.live.insert(self.sequence, task.abort_handle());
    }

    pub(crate) fn arrived(&mut self, page: u32) {
        self.outstanding.remove(&page);
    }

    /// Takes the end of an answer. Gives the pages that no live answer can bring any more: all posts that named them have
    /// ended.
    pub(crate) fn ended(
        &mut self,
        sequence: u64,
        error: Option<StreamError>,
    ) -> Vec<(u32, StreamError)> {
        self.live.remove(&sequence);
        let oldest = self.live.keys().next().copied().unwrap_or(u64::MAX);
        let lost = |_: &u32, named: &mut Option<u64>| named.is_some_and(|named| named < oldest);
        let error = error.unwrap_or_else(|| StreamError::Http {
            url: "post for pages".to_owned(),
            found: "an answer that left the page out".to_owned(),
        });
        self.outstanding
            .extract_if(.., lost)
            .map(|(page, _)| (page, error.clone()))
            .collect()
    }
}

impl Drop for PostTransport {
    fn drop(&mut self) {
        for task in self.live.values() {
            task.abort();
        }
    }
}

/// Ascending pages as ranges; neighbours of one asset and one priority share a range.
fn wants(scene: &OpenedScene, pages: &[(u32, f32)]) -> Vec<PageWant> {
    let mut wants: Vec<PageWant> = Vec::new();
    for &(page, priority) in pages {
        let Some((asset_index, local)) = scene.locate(page) else {
            continue;
        };
        let asset = scene.assets[asset_index].hash;
        match wants.last_mut() {
            Some(last)
                if last.asset == asset && last.last + 1 == local && last.priority == priority =>
            {
                last.last = local;
            }
            _ => wants.push(PageWant {
                asset,
                first: local,
                last: local,
                priority,
            }),
        }
    }
    wants
}

async fn answer(post: PagesPost, shared: Shared) {
    let mut decoding = JoinSet::new();
    let take = |page: PageAnswer| {
        decoding.spawn(decode(page, Instant::now(), shared.clone()));
    };
    let assets = &shared.scene.assets;
    let result = shared.source.post_pages(&post, assets, take).await;
    // The end must be told after the pages: it says that no more come.
    decoding.join_all().await;
    let _ = shared.messages.send(Message::PostEnded {
        sequence: post.sequence,
        error: result.err(),
    });
}

async fn decode(answer: PageAnswer, came: Instant, shared: Shared) {
    let of_answer = |opened: &&OpenedAsset| {
        opened.hash == answer.asset && (answer.page as usize) < opened.asset.pages.len()
    };
    // The same asset may stand in the scene more than once, and each has pages of its own.
    for opened in shared.scene.assets.iter().filter(of_answer) {
        let page = opened.page_base + answer.page;
        let result = match answer.frame.clone() {
            Err(error) => Err(error),
            Ok(frame) => {
                let _permit = shared.decoders.acquire().await;
                let (scene, local) = (shared.scene.clone(), answer.page);
                blocking(move || {
                    let (index, _) = scene.locate(page).ok_or_else(|| StreamError::NotFound {
                        place: format!("page {page} of the scene"),
                    })?;
                    let opened = &scene.assets[index];
                    decode_page(
                        &opened.hash,
                        &opened.asset,
                        &opened.hierarchy,
                        local,
                        &frame,
                    )
                })
                .await
            }
        };
        shared.tell(page, came, result);
    }
}
