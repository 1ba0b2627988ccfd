//! Buffers that are needed for moments only, as a thread keeps some: what is written into one is still in the processor's cache when it
//! goes out, and nothing is asked of the system.

use std::cell::RefCell;

/// Bytes of a buffer.
pub(super) const BUFFER_BYTES: usize = 256 * 1024;
/// Empty buffers that a thread keeps.
const SPARE: usize = 8;

thread_local!(static SPARES: RefCell<Vec<Vec<u8>>> = const { RefCell::new(Vec::new()) });

/// A buffer and what is in it.
#[derive(Debug)]
pub(super) struct Buffer {
    /// What is in it, and behind that what other holders left: as long as it was needed once, and not longer.
    bytes: Vec<u8>,
    filled: usize,
}

impl Buffer {
    /// An empty one.
    pub(super) fn take() -> Self {
        let spare = SPARES.with_borrow_mut(Vec::pop);
        Self {
            bytes: spare.unwrap_or_else(|| Vec::with_capacity(BUFFER_BYTES)),
            filled: 0,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.filled
    }

    /// Adds `bytes`, as far as there is space.
    pub(super) fn extend(&mut self, bytes: &[u8]) {
        let before = self.filled;
        let taken = bytes.len().min(BUFFER_BYTES - before);
        if let Some(space) = self.space(before + taken) {
            space[before..].copy_from_slice(&bytes[..taken]);
        }
    }

    /// The buffer's first `bytes`, to be written over; they are in it from now on. None where it is smaller.
    pub(super) fn space(&mut self, bytes: usize) -> Option<&mut [u8]> {
        if bytes > BUFFER_BYTES {
            return None;
        }
        if self.bytes.len() < bytes {
            self.bytes.resize(bytes, 0);
        }
        self.filled = bytes;
        Some(&mut self.bytes[..bytes])
    }
}

impl AsRef<[u8]> for Buffer {
    fn as_ref(&self) -> &[u8] {
        &self.bytes[..self.filled]
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        let bytes = std::mem::take(&mut self.bytes);
        // A thread that ends has none left to give them to.
        let _ = SPARES.try_with(|spares| {
            let mut spares = spares.borrow_mut();
            if spares.len() < SPARE {
                spares.push(bytes);
            }
        });
    }
}
