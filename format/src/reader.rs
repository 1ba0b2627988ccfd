//! Takes fixed-size pieces off a growing buffer.

/// Bytes that came but do not make a whole message yet.
#[derive(Debug, Default)]
pub(crate) struct Pending {
    bytes: Vec<u8>,
    taken: usize,
}

impl Pending {
    pub fn push(&mut self, bytes: &[u8]) {
        if self.taken > 0 && self.taken * 2 >= self.bytes.len() {
            self.bytes.drain(..self.taken);
            self.taken = 0;
        }
        self.bytes.extend_from_slice(bytes);
    }

    pub fn peek(&self, count: usize) -> Option<&[u8]> {
        self.bytes.get(self.taken..self.taken.checked_add(count)?)
    }

    pub fn take(&mut self, count: usize) -> Option<Vec<u8>> {
        let bytes = self.peek(count)?.to_vec();
        self.taken += count;
        Some(bytes)
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
