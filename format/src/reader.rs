//! Takes pieces off a buffer of what came.

/// Bytes that came but do not make a whole message yet.
#[derive(Debug, Default)]
pub(crate) struct Pending {
    bytes: Vec<u8>,
    taken: usize,
}

impl Pending {
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.taken);
        self.taken = 0;
        self.bytes.extend_from_slice(bytes);
    }

    pub fn peek(&self, count: usize) -> Option<&[u8]> {
        self.bytes.get(self.taken..self.taken.checked_add(count)?)
    }

    /// Up to `most` bytes, as many as came.
    pub fn take(&mut self, most: usize) -> &[u8] {
        let start = self.taken;
        self.taken += most.min(self.bytes.len() - start);
        &self.bytes[start..self.taken]
    }

    pub fn is_empty(&self) -> bool {
        self.taken == self.bytes.len()
    }
}

/// Little-endian u32 at `at`; the caller has checked the length.
pub(crate) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes[at..at + 4]
        .iter()
        .rev()
        .fold(0, |word, &byte| word << 8 | byte as u32)
}

/// Little-endian u64 at `at`; the caller has checked the length.
pub(crate) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u32_at(bytes, at) as u64 | (u32_at(bytes, at + 4) as u64) << 32
}
