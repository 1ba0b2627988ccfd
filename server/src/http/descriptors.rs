//! File descriptors: as many as the system allows, shared out between connections and what serves
//! them. Without a share for files a server that has all the connections it can have answers none
//! of them.

use std::io;

/// Most connections at once, however many descriptors there are.
const MAX_CONNECTIONS: u64 = 16_384;
/// Most packs that are open.
const MAX_PACKS: u64 = 1024;
/// Most for reads of the library, connections to a store, and uploads with their pipes.
const MAX_OTHERS: u64 = 1024;
/// Streams of the process, listeners, signals.
const PROCESS: u64 = 16;
/// Of a thread's runtime: its poller and how it is woken, with some to spare.
const THREAD: u64 = 4;
/// So many are of use, whatever the number of threads.
const OF_USE: u64 = 32_768;
/// Fewest connections that a server is worth running for.
const FEWEST_CONNECTIONS: u64 = 8;

/// Raises this process's limit as far as more descriptors are of use and the system allows.
///
/// # Errors
/// Where the system refuses what it said it would allow.
#[cfg(unix)]
pub(crate) fn raise() -> io::Result<()> {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let limits = getrlimit(Resource::Nofile);
    let allowed = limits.maximum.unwrap_or(u64::MAX).min(OF_USE);
    if limits.current.is_none_or(|current| current >= allowed) {
        return Ok(());
    }
    let raised = Rlimit {
        current: Some(allowed),
        ..limits
    };
    Ok(setrlimit(Resource::Nofile, raised)?)
}

#[cfg(not(unix))]
pub(crate) fn raise() -> io::Result<()> {
    Ok(())
}

/// Descriptors that this process may have.
#[cfg(unix)]
fn limit() -> u64 {
    use rustix::process::{Resource, getrlimit};
    getrlimit(Resource::Nofile).current.unwrap_or(u64::MAX)
}

#[cfg(not(unix))]
fn limit() -> u64 {
    u64::MAX
}

/// Most connections of a server that runs `threads`.
///
/// # Errors
/// Where there are too few descriptors for a server.
pub(super) fn connections(threads: usize) -> io::Result<usize> {
    connections_of(limit(), threads as u64)
}

/// Most packs that are open at once.
pub(super) fn packs() -> usize {
    packs_of(limit()) as usize
}

fn packs_of(limit: u64) -> u64 {
    (limit / 8).min(MAX_PACKS)
}

fn connections_of(limit: u64, threads: u64) -> io::Result<usize> {
    let others = (limit / 8).min(MAX_OTHERS) + PROCESS + THREAD * threads;
    let reserved = packs_of(limit) + others;
    let left = limit.saturating_sub(reserved).min(MAX_CONNECTIONS);
    if left < FEWEST_CONNECTIONS {
        let expected = (PROCESS + THREAD * threads + FEWEST_CONNECTIONS) * 4 / 3 + 1;
        let text = format!("expected at least {expected} open files (ulimit -n), found {limit}");
        return Err(io::Error::other(text));
    }
    Ok(left as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connections_leave_descriptors_for_files() {
        for (limit, threads, connections) in [
            (u64::MAX, 64, 16_384),
            (65_536, 16, 16_384),
            (20_000, 2, 16_384),
            (1024, 2, 744),
            (256, 2, 168),
            (64, 2, 24),
        ] {
            let found = connections_of(limit, threads).expect("enough");
            assert_eq!(found, connections, "of {limit}");
            let files = limit - found as u64 - packs_of(limit) - PROCESS - THREAD * threads;
            assert!(files >= limit.min(8192) / 8, "{files} of {limit}");
        }
    }

    #[test]
    fn too_few_descriptors_are_told_with_how_many_are_enough() {
        for threads in [1, 2, 64] {
            let error = connections_of(24, threads).expect_err("too few");
            let text = error.to_string();
            let enough = text.split(' ').nth(3).and_then(|word| word.parse().ok());
            let enough: u64 = enough.unwrap_or_else(|| panic!("{text}"));
            assert!(connections_of(enough, threads).is_ok(), "{text}");
        }
    }
}
