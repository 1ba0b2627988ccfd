//! Bytes of an answer that are in memory, as slices of what holds them.

use std::collections::VecDeque;

use bytes::Bytes;

/// Bytes that are there, piece after piece.
#[derive(Debug, Default)]
pub(super) struct Slices {
    /// Most pages lie in one piece, so that nothing is allocated for them.
    first: Option<Bytes>,
    rest: VecDeque<Bytes>,
    bytes: u64,
}

impl Slices {
    /// Bytes that are left.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    pub(super) fn push(&mut self, slice: Bytes) {
        self.bytes += slice.len() as u64;
        match self.first {
            None => self.first = Some(slice),
            Some(_) => self.rest.push_back(slice),
        }
    }

    /// The next `bytes` of what is left.
    pub(super) fn take_bytes(&mut self, mut bytes: usize) -> Vec<Bytes> {
        let mut taken = Vec::with_capacity(2);
        while bytes > 0 {
            let Some(mut slice) = self.next() else {
                break;
            };
            if slice.len() > bytes {
                let left = slice.split_off(bytes);
                self.bytes += left.len() as u64;
                if let Some(second) = self.first.replace(left) {
                    self.rest.push_front(second);
                }
            }
            bytes -= slice.len();
            taken.push(slice);
        }
        taken
    }
}

impl Iterator for Slices {
    type Item = Bytes;

    fn next(&mut self) -> Option<Bytes> {
        let slice = self.first.take()?;
        self.first = self.rest.pop_front();
        self.bytes -= slice.len() as u64;
        Some(slice)
    }
}

impl FromIterator<Bytes> for Slices {
    fn from_iter<T: IntoIterator<Item = Bytes>>(slices: T) -> Self {
        let mut all = Self::default();
        slices.into_iter().for_each(|slice| all.push(slice));
        all
    }
}
