//! The list of scenes, made once for all who ask: a snapshot of the names that is at most [`FRESH`]
//! old, or a few times as old as listing takes. One listing runs at a time; what this server
//! publishes shows at once. References are read when they are asked for, and again only where the
//! store says that they have changed.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use futures_util::future::{BoxFuture, Shared};
use futures_util::{FutureExt, StreamExt, TryStreamExt, stream};
use lodestream_format::library::SceneReference;
use lodestream_format::wire::{SceneEntry, ScenesPage};
use tokio::sync::OnceCell;

use super::error::HttpError;
use super::error_log;
use crate::library::{Library, LibraryError, ListedScene};

/// Age at which a snapshot is made anew.
const FRESH: Duration = Duration::from_secs(1);
/// A snapshot is also good for so many times as long as it took: listing takes a quarter of the
/// time.
const TIMES: u32 = 3;
/// References read at once for an answer.
const READS_AT_ONCE: usize = 16;

/// The scenes of a library.
#[derive(Debug)]
pub(super) struct Listing {
    library: Library,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    snapshot: Option<Arc<Snapshot>>,
    /// Counts publications: what was listed before the last one is old.
    generation: u64,
    /// The listing that runs, and the generation that it began in.
    running: Option<(u64, Running)>,
}

/// Nothing where it fails.
type Running = Shared<BoxFuture<'static, Option<Arc<Snapshot>>>>;

impl std::fmt::Debug for State {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("State")
    }
}

struct Snapshot {
    /// By name.
    entries: Vec<Entry>,
    generation: u64,
    listed: Instant,
    good_for: Duration,
}

struct Entry {
    scene: ListedScene,
    reference: OnceCell<SceneReference>,
}

impl Listing {
    pub(super) fn new(library: Library) -> Arc<Self> {
        Arc::new(Self {
            library,
            state: Mutex::default(),
        })
    }

    /// At most `limit` scenes behind `after`, of those that the client may see.
    pub(super) async fn page(
        self: &Arc<Self>,
        after: Option<&str>,
        limit: usize,
        may_see: impl Fn(&str) -> bool,
    ) -> Result<ScenesPage, HttpError> {
        let snapshot = self.snapshot().await?;
        let behind = |entry: &Entry| after.is_some_and(|after| *entry.scene.name <= *after);
        let begin = snapshot.entries.partition_point(behind);
        let seen = snapshot.entries[begin..].iter();
        let seen = seen.filter(|entry| may_see(&entry.scene.name));
        let mut seen: Vec<_> = seen.take(limit.saturating_add(1)).collect();
        let more = seen.len() > limit;
        seen.truncate(limit);
        let next = seen.last().filter(|_| more);
        let next = next.map(|entry| entry.scene.name.to_string());
        let reads: Vec<_> = seen.iter().map(|entry| self.reference(entry)).collect();
        let references: Vec<_> = stream::iter(reads)
            .buffered(READS_AT_ONCE)
            .try_collect()
            .await?;
        let mut scenes = Vec::with_capacity(seen.len());
        let mut gone = Vec::new();
        for (entry, reference) in seen.into_iter().zip(references) {
            match reference {
                Some(reference) => scenes.push(SceneEntry {
                    name: entry.scene.name.to_string(),
                    reference,
                }),
                None => gone.push(&entry.scene),
            }
        }
        self.check_gone(&gone).await?;
        Ok(ScenesPage { scenes, next })
    }

    /// Lists anew for whoever asks next: something was published.
    pub(super) fn forget(&self) {
        self.state().generation += 1;
    }

    /// Nothing where the scene is gone.
    async fn reference(&self, entry: &Entry) -> Result<Option<SceneReference>, LibraryError> {
        let read = || self.library.reference(&entry.scene.name);
        match entry.reference.get_or_try_init(read).await {
            Ok(reference) => Ok(Some(reference.clone())),
            Err(LibraryError::NoScene { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Fails if scenes that were listed, and then not found, are listed still: a store that lists
    /// scenes and does not give them is damaged.
    async fn check_gone(self: &Arc<Self>, gone: &[&ListedScene]) -> Result<(), HttpError> {
        if gone.is_empty() {
            return Ok(());
        }
        self.forget();
        let snapshot = self.snapshot().await?;
        for scene in gone {
            if snapshot
                .entry(&scene.name)
                .is_some_and(|it| it.scene == **scene)
            {
                return Err(self.library.listed_but_gone(&scene.name).into());
            }
        }
        Ok(())
    }

    async fn snapshot(self: &Arc<Self>) -> Result<Arc<Snapshot>, HttpError> {
        let running = {
            let mut state = self.state();
            if let Some(snapshot) = state.fresh() {
                return Ok(Arc::clone(snapshot));
            }
            let generation = state.generation;
            match &state.running {
                Some((began, running)) if *began == generation => running.clone(),
                _ => {
                    let running = self.run(generation);
                    state.running = Some((generation, running.clone()));
                    running
                }
            }
        };
        // Why it failed is in the log, once.
        running.await.ok_or(HttpError::NotReady)
    }

    /// A listing that goes on where the clients go that wait for it.
    fn run(self: &Arc<Self>, generation: u64) -> Running {
        let listing = Arc::clone(self);
        let task = tokio::spawn(async move { listing.list(generation).await });
        // A task that panicked has listed nothing.
        async move { task.await.ok().flatten() }.boxed().shared()
    }

    async fn list(&self, generation: u64) -> Option<Arc<Snapshot>> {
        let began = Instant::now();
        let listed = self.library.listed_scenes().await;
        let mut state = self.state();
        let known = state.snapshot.take();
        let made = listed.map(|scenes| {
            let entry = |scene: ListedScene| {
                let known = known.as_ref().and_then(|known| known.entry(&scene.name));
                let known = known.filter(|known| known.scene.is_unchanged(&scene));
                Entry {
                    reference: known.map_or_else(OnceCell::new, |known| known.reference.clone()),
                    scene,
                }
            };
            Arc::new(Snapshot {
                entries: scenes.into_iter().map(entry).collect(),
                generation,
                listed: began,
                good_for: FRESH.max(began.elapsed() * TIMES),
            })
        });
        if state.running.as_ref().is_some_and(|it| it.0 == generation) {
            state.running = None;
        }
        match made {
            Ok(made) => {
                state.snapshot = Some(Arc::clone(&made));
                Some(made)
            }
            Err(error) => {
                state.snapshot = known;
                drop(state);
                error_log::error("list of scenes", &error);
                None
            }
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn fresh(&self) -> Option<&Arc<Snapshot>> {
        let snapshot = self.snapshot.as_ref()?;
        let is_fresh = snapshot.listed.elapsed() < snapshot.good_for;
        (is_fresh && snapshot.generation == self.generation).then_some(snapshot)
    }
}

impl Snapshot {
    fn entry(&self, name: &str) -> Option<&Entry> {
        let at = self
            .entries
            .binary_search_by(|entry| (*entry.scene.name).cmp(name));
        at.ok().map(|at| &self.entries[at])
    }
}
