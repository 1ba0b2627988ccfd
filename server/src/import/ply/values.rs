//! Values: the body's numbers one after the other, from bytes or from text.

use super::header::{Encoding, Scalar};
use crate::import::error::{Fault, Read, malformed, quoted_bytes};
use crate::import::file::Extent;
use crate::import::text;

const BUFFER_BYTES: usize = 1 << 18;
/// The longest number that is read as text.
const WORD_BYTES: usize = 256;

/// A cursor over the body.
pub(super) struct Values {
    extent: Extent,
    encoding: Encoding,
    buffer: Vec<u8>,
    /// Next byte in the buffer.
    next: usize,
    /// Where the buffer ends in the extent.
    buffer_end: u64,
    line: u64,
}

impl Values {
    /// From `offset` in `extent` on.
    pub(super) fn new(extent: &Extent, encoding: Encoding, offset: u64) -> Self {
        Self {
            extent: extent.clone(),
            encoding,
            buffer: Vec::new(),
            next: 0,
            buffer_end: offset,
            line: 1,
        }
    }

    /// The next byte's offset in the extent.
    pub(super) fn position(&self) -> u64 {
        self.buffer_end - (self.buffer.len() - self.next) as u64
    }

    pub(super) fn left(&self) -> u64 {
        self.extent.len().saturating_sub(self.position())
    }

    pub(super) fn place(&self) -> String {
        match self.encoding {
            Encoding::Text => format!("line {} of the body", self.line),
            _ => format!("byte {}", self.position()),
        }
    }

    /// Refills the buffer so that it holds `least` bytes where the extent does.
    fn fill(&mut self, least: usize) -> Read<()> {
        if self.buffer.len() - self.next >= least {
            return Ok(());
        }
        self.buffer.drain(..self.next);
        self.next = 0;
        let held = self.buffer.len();
        let unread = self.extent.len().saturating_sub(self.buffer_end);
        let more = unread.min((BUFFER_BYTES.max(least) - held) as u64) as usize;
        self.buffer.resize(held + more, 0);
        self.extent
            .read_at(self.buffer_end, &mut self.buffer[held..])?;
        self.buffer_end += more as u64;
        Ok(())
    }

    /// The next `length` bytes of a binary body; at most [`BUFFER_BYTES`].
    #[inline]
    pub(super) fn take(&mut self, length: usize) -> Read<&[u8]> {
        if self.buffer.len() - self.next < length {
            self.fill(length)?;
            if self.buffer.len() - self.next < length {
                return Err(self.ended(length));
            }
        }
        let start = self.next;
        self.next += length;
        Ok(&self.buffer[start..self.next])
    }

    fn ended(&self, length: usize) -> Fault {
        let expected = format!("{length} bytes more");
        let found = format!("the end of the file after {}", self.left());
        malformed(self.place(), expected, found)
    }

    /// The next number. A text's number need not fit its declared type.
    #[inline]
    pub(super) fn scalar(&mut self, scalar: Scalar) -> Read<f64> {
        let big_endian = self.encoding == Encoding::BigEndian;
        match self.encoding {
            Encoding::Text => self.word(),
            _ => Ok(scalar.read(self.take(scalar.bytes())?, big_endian)),
        }
    }

    /// The next number of a text.
    fn word(&mut self) -> Read<f64> {
        loop {
            self.fill(WORD_BYTES)?;
            let Some(&byte) = self.buffer.get(self.next) else {
                return Err(malformed(self.place(), "a number", "the end of the file"));
            };
            if !byte.is_ascii_whitespace() {
                break;
            }
            self.line += u64::from(byte == b'\n');
            self.next += 1;
        }
        let rest = &self.buffer[self.next..self.buffer.len().min(self.next + WORD_BYTES)];
        let length = rest.iter().position(u8::is_ascii_whitespace);
        let word = &rest[..length.unwrap_or(rest.len())];
        let Some(number) = text::number(word) else {
            let found = quoted_bytes(word);
            return Err(malformed(self.place(), "a number", found));
        };
        self.next += word.len();
        Ok(number)
    }

    /// The length of a list.
    pub(super) fn count(&mut self, scalar: Scalar) -> Read<u64> {
        let place = self.position();
        let count = self.scalar(scalar)?;
        match count >= 0.0 && count.fract() == 0.0 && count <= f64::from(u32::MAX) {
            true => Ok(count as u64),
            false => {
                let place = match self.encoding {
                    Encoding::Text => self.place(),
                    _ => format!("byte {place}"),
                };
                Err(malformed(place, "a list's length", count))
            }
        }
    }

    /// Leaves out `count` numbers.
    pub(super) fn skip(&mut self, scalar: Scalar, count: u64) -> Read<()> {
        if self.encoding == Encoding::Text {
            for _ in 0..count {
                self.word()?;
            }
            return Ok(());
        }
        let bytes = count.saturating_mul(scalar.bytes() as u64);
        self.skip_bytes(bytes)
    }

    /// Leaves out bytes of a binary body.
    pub(super) fn skip_bytes(&mut self, bytes: u64) -> Read<()> {
        if bytes > self.left() {
            let expected = format!("{bytes} bytes more");
            let found = format!("the end of the file after {}", self.left());
            return Err(malformed(self.place(), expected, found));
        }
        let held = (self.buffer.len() - self.next) as u64;
        if bytes <= held {
            self.next += bytes as usize;
        } else {
            let position = self.position() + bytes;
            self.buffer.clear();
            self.next = 0;
            self.buffer_end = position;
        }
        Ok(())
    }

    /// Whether only blanks are left in a text.
    pub(super) fn blank_left(&mut self) -> Read<bool> {
        loop {
            self.fill(1)?;
            match self.buffer.get(self.next) {
                None => return Ok(true),
                Some(byte) if byte.is_ascii_whitespace() => self.next += 1,
                Some(_) => return Ok(false),
            }
        }
    }
}
