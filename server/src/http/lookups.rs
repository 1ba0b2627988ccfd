//! Look-ups of names that a client may have made up. Misses are remembered for a moment, and each
//! client has so many look-ups at once: the others wait.

use std::collections::HashSet;
use std::future::Future;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use lodestream_format::ContentHash;
use lodestream_format::library::object_path;
use tokio::time::Instant;

use super::budget::Budget;
use super::limits::ClientAddress;
use crate::library::{Library, LibraryError};

/// A miss is looked for again after this to twice this time: the object may have come.
const MISS_LIFE: Duration = Duration::from_millis(500);
/// Misses that are remembered, at most.
const MOST_MISSES: usize = 16_384;
/// Look-ups at once, and those of one client.
const MOST: usize = 256;
const SHARE: usize = 64;

/// A name in the library.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Name {
    Object(ContentHash),
    /// The hash of the scene's name.
    Scene(ContentHash),
}

/// The look-ups that run, and what the last ones missed.
#[derive(Debug)]
pub(super) struct Lookups {
    turns: Arc<Budget>,
    misses: Mutex<Misses>,
}

#[derive(Debug)]
struct Misses {
    young: HashSet<Name>,
    old: HashSet<Name>,
    /// When the old ones were young last.
    turned: Instant,
    /// Counts how often all was forgotten.
    forgotten: u64,
}

impl Default for Lookups {
    fn default() -> Self {
        Self {
            turns: Budget::new(MOST, SHARE),
            misses: Mutex::new(Misses {
                young: HashSet::new(),
                old: HashSet::new(),
                turned: Instant::now(),
                forgotten: 0,
            }),
        }
    }
}

impl Lookups {
    /// Gives the find of `look`; after a remembered miss `missing`, without a look.
    pub(super) async fn find<T>(
        &self,
        client: ClientAddress,
        name: Name,
        missing: impl FnOnce() -> LibraryError,
        look: impl Future<Output = Result<T, LibraryError>>,
    ) -> Result<T, LibraryError> {
        if self.misses().has(&name) {
            return Err(missing());
        }
        let mut turn = self.turns.claim(client.0);
        turn.grow(1).await;
        let forgotten = {
            let mut misses = self.misses();
            // An earlier look-up may have been for the same name.
            if misses.has(&name) {
                return Err(missing());
            }
            misses.forgotten
        };
        let found = look.await;
        if found.as_ref().is_err_and(LibraryError::is_missing) {
            self.misses().insert(name, forgotten);
        }
        found
    }

    /// Forgets all misses: something was published.
    pub(super) fn forget(&self) {
        let mut misses = self.misses();
        misses.young.clear();
        misses.old.clear();
        misses.forgotten += 1;
    }

    fn misses(&self) -> MutexGuard<'_, Misses> {
        self.misses.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Misses {
    fn has(&mut self, name: &Name) -> bool {
        self.turn();
        self.young.contains(name) || self.old.contains(name)
    }

    /// Remembers a look-up that began when all was forgotten so often.
    fn insert(&mut self, name: Name, forgotten: u64) {
        self.turn();
        if forgotten == self.forgotten && self.young.len() < MOST_MISSES / 2 {
            self.young.insert(name);
        }
    }

    fn turn(&mut self) {
        let age = self.turned.elapsed();
        if age < MISS_LIFE {
            return;
        }
        self.old = std::mem::take(&mut self.young);
        if age >= 2 * MISS_LIFE {
            self.old.clear();
        }
        self.turned = Instant::now();
    }
}

/// The error of an object that is not there.
pub(super) fn no_object(library: &Library, hash: &ContentHash) -> LibraryError {
    LibraryError::NoObject {
        location: library.location().to_owned(),
        path: object_path(hash),
    }
}

/// The error of a scene that is not there.
pub(super) fn no_scene(library: &Library, name: &str) -> LibraryError {
    LibraryError::NoScene {
        location: library.location().to_owned(),
        name: name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    const CLIENT: ClientAddress =
        ClientAddress(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST));

    struct Store {
        library: Library,
        lookups: Lookups,
        looks: AtomicUsize,
    }

    impl Store {
        fn new() -> Self {
            Self {
                library: Library::open("memory://").expect("memory opens"),
                lookups: Lookups::default(),
                looks: AtomicUsize::new(0),
            }
        }

        async fn find(&self, number: u32, is_there: bool) -> bool {
            let hash = ContentHash::of(&number.to_le_bytes());
            let missing = || no_object(&self.library, &hash);
            let look = async {
                self.looks.fetch_add(1, Ordering::Relaxed);
                tokio::time::sleep(Duration::from_millis(1)).await;
                is_there.then_some(()).ok_or_else(missing)
            };
            let found = self.lookups.find(CLIENT, Name::Object(hash), missing, look);
            found.await.is_ok()
        }

        fn looks(&self) -> usize {
            self.looks.load(Ordering::Relaxed)
        }
    }

    #[tokio::test(start_paused = true)]
    async fn misses_are_not_looked_for_again_at_once() {
        let store = Store::new();
        for _ in 0..100 {
            assert!(!store.find(1, false).await);
        }
        assert_eq!(store.looks(), 1);
        assert!(store.find(2, true).await && store.find(2, true).await);
        assert_eq!(store.looks(), 3, "what is there is looked for");
        // It has come meanwhile.
        tokio::time::sleep(2 * MISS_LIFE).await;
        assert!(store.find(1, true).await);
        assert!(!store.find(3, false).await && !store.find(3, true).await);
        store.lookups.forget();
        assert!(store.find(3, true).await);
    }

    #[tokio::test(start_paused = true)]
    async fn misses_of_before_a_publication_are_not_remembered() {
        let store = Store::new();
        let publish = async { store.lookups.forget() };
        assert!(!tokio::join!(store.find(1, false), publish).0);
        assert!(store.find(1, true).await);
    }

    #[tokio::test(start_paused = true)]
    async fn misses_are_bounded_and_so_are_look_ups_at_once() {
        let store = Store::new();
        let began = Instant::now();
        let all = (0..3 * MOST_MISSES as u32).map(|number| store.find(number, false));
        futures_util::future::join_all(all).await;
        let misses = store.lookups.misses();
        assert!(misses.young.len() + misses.old.len() <= MOST_MISSES);
        let waves = 3 * MOST_MISSES / SHARE;
        assert!(began.elapsed() >= Duration::from_millis(waves as u64));
    }
}
