//! Bounds on memory: an allocation beyond them fails, and the process aborts.

use std::fs;

use rustix::process::{Resource, Rlimit, setrlimit};

use super::ConfineError;

/// Score of this process where memory runs out: 1000 goes first.
const OOM_SCORE: &str = "1000";
const OOM_FILE: &str = "/proc/self/oom_score_adj";

/// Bounds private memory, and writes no core file. `RLIMIT_DATA` counts what is allocated;
/// `RLIMIT_AS` would count the address space that the allocator only reserves for each thread, too.
pub(super) fn bound(memory_bytes: u64) -> Result<(), ConfineError> {
    for (resource, most) in [(Resource::Data, memory_bytes), (Resource::Core, 0)] {
        let limit = Rlimit {
            current: Some(most),
            maximum: Some(most),
        };
        setrlimit(resource, limit).map_err(|error| ConfineError::System {
            expected: "bounds of memory (setrlimit)",
            found: error.to_string(),
        })?;
    }
    fs::write(OOM_FILE, OOM_SCORE).map_err(|error| ConfineError::System {
        expected: "an out-of-memory score that can be raised",
        found: error.to_string(),
    })
}
