//! Bounds on a stranger: how much memory a scene's opening may take, and how slow an answer may be.

use std::time::Duration;

use super::error::StreamError;

/// Bytes that a scene's opening may take unless asked otherwise.
pub const DEFAULT_OPEN_MEMORY_BYTES: u64 = 4 << 30;

/// Bounds on what a library may cost its viewer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreamLimits {
    /// Most bytes of memory for a scene's opening: what comes, what it becomes, and its arrays.
    pub open_memory_bytes: u64,
    /// Time for a connection's first answer, and for pauses.
    pub grace: Duration,
    /// Fewest bytes a second of all answers together, after the grace.
    pub least_bytes_a_sec: f64,
}

impl Default for StreamLimits {
    /// A modem of 56 kbit/s brings ten times the least rate.
    fn default() -> Self {
        Self {
            open_memory_bytes: DEFAULT_OPEN_MEMORY_BYTES,
            grace: Duration::from_secs(30),
            least_bytes_a_sec: 512.0,
        }
    }
}

/// Memory that an opening has taken of its bound.
#[derive(Debug, Clone)]
pub(crate) struct Memory {
    most_bytes: u64,
    taken_bytes: u64,
}

impl Memory {
    pub(crate) fn new(most_bytes: u64) -> Self {
        Self {
            most_bytes,
            taken_bytes: 0,
        }
    }

    pub(crate) fn left_bytes(&self) -> u64 {
        self.most_bytes - self.taken_bytes
    }

    /// Takes `bytes`, which `place` needs.
    pub(crate) fn take(
        &mut self,
        bytes: u64,
        place: impl FnOnce() -> String,
    ) -> Result<(), StreamError> {
        let needed_bytes = self.taken_bytes.saturating_add(bytes);
        if needed_bytes > self.most_bytes {
            return Err(StreamError::Memory {
                place: place(),
                most_bytes: self.most_bytes,
                needed_bytes,
            });
        }
        self.taken_bytes = needed_bytes;
        Ok(())
    }

    /// Gives back `bytes` that were taken.
    pub(crate) fn give_back(&mut self, bytes: u64) {
        self.taken_bytes = self.taken_bytes.saturating_sub(bytes);
    }
}
