//! Answers that come compressed (`Content-Encoding: zstd`), unpacked piece by piece as they come.

use bytes::{Buf, Bytes};
use lodestream_format::FormatError;
use reqwest::header::{CONTENT_ENCODING, HeaderMap, HeaderValue};
use zstd::stream::raw::{DParameter, Decoder, InBuffer, Operation, OutBuffer};

/// Encodings that may be asked for: goes into `Accept-Encoding`.
pub(super) const ZSTD: HeaderValue = HeaderValue::from_static("zstd");
/// Most bytes of the server's words in an error.
pub(super) const QUOTED_BYTES: usize = 200;
/// Most bytes of a piece: no more is unpacked before somebody looked at it.
const PIECE_BYTES: usize = 128 << 10;
/// Largest window of a frame: 8 MiB, as RFC 9659 has it for this encoding.
const WINDOW_LOG: u32 = 23;
/// Frames that hold nothing are for ever: of what unpacks to less than half of itself only this
/// much is read.
const EMPTY_BYTES: u64 = 64 << 10;

/// The unpacked bytes of an answer.
pub(super) enum Unpack {
    /// They come as they are.
    Plain(Bytes),
    /// They come as frames of Zstandard.
    Zstd(Box<Frames>),
}

/// See [`Unpack`].
pub(super) struct Frames {
    decoder: Decoder<'static>,
    chunk: Bytes,
    piece: Vec<u8>,
    /// Whether the decoder may hold more of what it has read.
    holds: bool,
    is_between_frames: bool,
    packed_bytes: u64,
    unpacked_bytes: u64,
}

impl Unpack {
    /// For an answer with these header fields.
    pub(super) fn of(answer: &HeaderMap) -> Result<Self, FormatError> {
        let failed = |error| FormatError::new("Zstandard", "memory to unpack", error);
        match answer.get(CONTENT_ENCODING) {
            None => Ok(Self::Plain(Bytes::new())),
            Some(encoding) if encoding == "zstd" => {
                let mut decoder = Decoder::new().map_err(failed)?;
                let window = DParameter::WindowLogMax(WINDOW_LOG);
                decoder.set_parameter(window).map_err(failed)?;
                Ok(Self::Zstd(Box::new(Frames {
                    decoder,
                    chunk: Bytes::new(),
                    piece: vec![0; PIECE_BYTES],
                    holds: false,
                    is_between_frames: false,
                    packed_bytes: 0,
                    unpacked_bytes: 0,
                })))
            }
            Some(other) => {
                let mut found = other.as_bytes().escape_ascii().to_string();
                found.truncate(QUOTED_BYTES);
                Err(FormatError::new("content-encoding", "zstd or none", found))
            }
        }
    }

    /// Takes the next chunk, once the one before has no more pieces.
    pub(super) fn push(&mut self, chunk: Bytes) {
        match self {
            Self::Plain(kept) => *kept = chunk,
            Self::Zstd(frames) => {
                frames.packed_bytes += chunk.len() as u64;
                frames.chunk = chunk;
            }
        }
    }

    /// The next piece of the chunk; `None` once all of it is unpacked.
    pub(super) fn next_piece(&mut self) -> Result<Option<Bytes>, FormatError> {
        match self {
            Self::Plain(chunk) if chunk.is_empty() => Ok(None),
            Self::Plain(chunk) => Ok(Some(std::mem::take(chunk))),
            Self::Zstd(frames) => frames.next_piece(),
        }
    }
}

impl Frames {
    fn next_piece(&mut self) -> Result<Option<Bytes>, FormatError> {
        let wrong = |error: std::io::Error| FormatError::new("Zstandard", "a frame", error);
        while self.holds || !self.chunk.is_empty() {
            if self.is_between_frames {
                self.decoder.reinit().map_err(wrong)?;
            }
            let mut input = InBuffer::around(&self.chunk);
            let mut output = OutBuffer::around(&mut self.piece[..]);
            let missing = self.decoder.run(&mut input, &mut output).map_err(wrong)?;
            let (read, written) = (input.pos(), output.pos());
            self.chunk.advance(read);
            self.is_between_frames = missing == 0;
            self.holds = written == PIECE_BYTES && missing != 0;
            self.unpacked_bytes += written as u64;
            if written > 0 {
                return Ok(Some(Bytes::copy_from_slice(&self.piece[..written])));
            }
        }
        let most = 2 * self.unpacked_bytes + EMPTY_BYTES;
        if self.packed_bytes > most {
            let expected = format!("at most {most} bytes for {}", self.unpacked_bytes);
            return Err(FormatError::new("Zstandard", expected, self.packed_bytes));
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unpack(chunks: &mut dyn Iterator<Item = &[u8]>) -> Result<Vec<u8>, FormatError> {
        let mut answer = HeaderMap::new();
        answer.insert(CONTENT_ENCODING, ZSTD);
        let mut unpack = Unpack::of(&answer)?;
        let mut all = Vec::new();
        for chunk in chunks {
            unpack.push(Bytes::copy_from_slice(chunk));
            while let Some(piece) = unpack.next_piece()? {
                assert!(piece.len() <= PIECE_BYTES);
                all.extend_from_slice(&piece);
            }
        }
        Ok(all)
    }

    #[test]
    fn frames_one_after_the_other_are_one_answer_however_they_come() {
        let parts: Vec<Vec<u8>> = (1..40u8).map(|at| vec![at; 9973 * at as usize]).collect();
        let frames = parts.iter().map(|part| zstd::bulk::compress(part, 3));
        let frames: Vec<Vec<u8>> = frames.collect::<std::io::Result<_>>().expect("memory");
        let sent = frames.concat();
        for bytes in [1, 7, 100, sent.len()] {
            let all = unpack(&mut sent.chunks(bytes)).expect("as compressed");
            assert!(all == parts.concat(), "in chunks of {bytes}");
        }
    }

    #[test]
    fn other_bytes_and_other_encodings_are_refused() {
        assert!(unpack(&mut [&b"neither one nor the other"[..]].into_iter()).is_err());
        let mut other = HeaderMap::new();
        other.insert(CONTENT_ENCODING, HeaderValue::from_static("br"));
        assert!(Unpack::of(&other).is_err());
    }

    #[test]
    fn frames_that_hold_nothing_end() {
        let empty = zstd::bulk::compress(&[], 3).expect("memory");
        let skippable = [
            &0x184d_2a50u32.to_le_bytes()[..],
            &4u32.to_le_bytes(),
            &[0; 4],
        ]
        .concat();
        for frame in [empty, skippable] {
            let chunk = frame.repeat(100);
            let error = unpack(&mut std::iter::repeat_n(&chunk[..], 1000)).expect_err("endless");
            assert!(
                error.to_string().contains("at most 65536 bytes for 0"),
                "{error}"
            );
        }
    }

    #[test]
    fn a_window_above_8_mib_is_refused() {
        use std::io::Write;
        let mut encoder = zstd::Encoder::new(Vec::new(), 1).expect("memory");
        encoder.window_log(27).expect("a window of 128 MiB");
        for _ in 0..20 {
            encoder.write_all(&[7; 1 << 20]).expect("memory");
        }
        let sent = encoder.finish().expect("memory");
        let error = unpack(&mut sent.chunks(1000)).expect_err("too large a window");
        assert!(error.to_string().contains("too much memory"), "{error}");
    }
}
