//! Rows: elements at a fixed stride, read in ranges or by ascending numbers, a bounded buffer at a time.

use std::ops::Range;

use super::error::Read;
use super::file::Extent;

/// Most bytes that one read takes: few enough to stay in the cache and on the heap, where the next read finds them again.
const BUFFER_BYTES: u64 = 1 << 16;
/// A gap up to here is read over: copying that much takes about as long as another call of the system.
const GAP_BYTES: u64 = 1 << 14;

/// Invariant: every row that a caller names lies within `extent`; whoever makes one has checked the count.
#[derive(Clone)]
pub(super) struct Rows {
    /// From the first row on.
    pub(super) extent: Extent,
    pub(super) stride: usize,
    pub(super) row_bytes: usize,
}

impl Rows {
    /// Gives the rows `ascending` to `visit`, each with its place in that list.
    ///
    /// Rows that lie near to each other are read at once; the time is that of reading what lies between, too.
    pub(super) fn visit(&self, ascending: &[u32], mut visit: impl FnMut(usize, &[u8])) -> Read<()> {
        let start_of = |row: u32| u64::from(row) * self.stride as u64;
        let row_bytes = self.row_bytes as u64;
        let mut buffer = Vec::new();
        let mut at = 0;
        while at < ascending.len() {
            let start = start_of(ascending[at]);
            let (mut last, mut end) = (at + 1, start + row_bytes);
            while let Some(&row) = ascending.get(last) {
                let next = start_of(row);
                if next > end + GAP_BYTES || next + row_bytes - start > BUFFER_BYTES {
                    break;
                }
                (last, end) = (last + 1, next + row_bytes);
            }
            buffer.resize((end - start) as usize, 0);
            self.extent.read_at(start, &mut buffer)?;
            for (place, &row) in ascending.iter().enumerate().take(last).skip(at) {
                let offset = (start_of(row) - start) as usize;
                visit(place, &buffer[offset..offset + self.row_bytes]);
            }
            at = last;
        }
        Ok(())
    }

    /// Gives the rows `range` to `visit`, each with its number.
    pub(super) fn visit_range(
        &self,
        range: Range<u64>,
        mut visit: impl FnMut(u64, &[u8]) -> Read<()>,
    ) -> Read<()> {
        let stride = self.stride as u64;
        let rows_at_once = (BUFFER_BYTES / stride).max(1);
        let mut buffer = Vec::new();
        let mut first = range.start;
        while first < range.end {
            let count = rows_at_once.min(range.end - first);
            let length = (count - 1) * stride + self.row_bytes as u64;
            buffer.resize(length as usize, 0);
            self.extent.read_at(first * stride, &mut buffer)?;
            for (row, bytes) in (first..).zip(buffer.chunks(self.stride)) {
                visit(row, &bytes[..self.row_bytes])?;
            }
            first += count;
        }
        Ok(())
    }
}
