//! Answers that come compressed (`Content-Encoding: zstd`), unpacked as they come.

use std::io::{self, Write};

use lodestream_format::FormatError;
use reqwest::header::{CONTENT_ENCODING, HeaderMap, HeaderValue};

/// What may be asked for: goes into `Accept-Encoding`.
pub(super) const ZSTD: HeaderValue = HeaderValue::from_static("zstd");
/// Most bytes that one chunk of an answer may unpack to; what is sent takes a fraction of it.
const CHUNK_BYTES: usize = 64 << 20;

/// The unpacked bytes of an answer.
pub(super) enum Unpack {
    /// They come as they are.
    Plain,
    /// They come as frames of Zstandard.
    Zstd(Box<zstd::stream::write::Decoder<'static, Bounded>>),
}

impl Unpack {
    /// For an answer with these header fields.
    pub(super) fn of(answer: &HeaderMap) -> Result<Self, FormatError> {
        let failed = |error| FormatError::new("Zstandard", "memory to unpack", error);
        match answer.get(CONTENT_ENCODING) {
            None => Ok(Self::Plain),
            Some(encoding) if encoding == "zstd" => {
                let decoder = zstd::stream::write::Decoder::new(Bounded(Vec::new()));
                decoder.map(Box::new).map(Self::Zstd).map_err(failed)
            }
            Some(other) => Err(FormatError::new(
                "content-encoding",
                "zstd or none",
                format!("{other:?}"),
            )),
        }
    }

    /// Unpacks the next `chunk` and gives what it holds to `take`.
    pub(super) fn push(
        &mut self,
        chunk: &[u8],
        take: impl FnOnce(&[u8]),
    ) -> Result<(), FormatError> {
        let Self::Zstd(decoder) = self else {
            take(chunk);
            return Ok(());
        };
        let unpacked = decoder.write_all(chunk).and_then(|()| decoder.flush());
        unpacked.map_err(|error| FormatError::new("Zstandard", "a frame", error))?;
        let bytes = &mut decoder.get_mut().0;
        take(bytes);
        bytes.clear();
        Ok(())
    }
}

/// Bytes, no more than [`CHUNK_BYTES`].
pub(super) struct Bounded(Vec<u8>);

impl Write for Bounded {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.0.len() + bytes.len() > CHUNK_BYTES {
            let found = format!("more than {CHUNK_BYTES} bytes in one chunk");
            return Err(io::Error::other(found));
        }
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
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
            unpack.push(chunk, |bytes| all.extend_from_slice(bytes))?;
        }
        Ok(all)
    }

    #[test]
    fn frames_one_after_the_other_are_one_answer_however_they_come() {
        let parts: Vec<Vec<u8>> = (1..40u8).map(|at| vec![at; 997 * at as usize]).collect();
        let frames = parts.iter().map(|part| zstd::bulk::compress(part, 3));
        let frames: Vec<Vec<u8>> = frames.collect::<io::Result<_>>().expect("memory");
        let sent = frames.concat();
        for bytes in [1, 7, 100, sent.len()] {
            let all = unpack(&mut sent.chunks(bytes)).expect("as compressed");
            assert!(all == parts.concat(), "in chunks of {bytes}");
        }
    }

    #[test]
    fn what_is_no_frame_or_grows_beyond_the_bound_is_refused() {
        assert!(unpack(&mut [&b"neither one nor the other"[..]].into_iter()).is_err());
        let bomb = zstd::bulk::compress(&vec![0; CHUNK_BYTES + 1], 1).expect("memory");
        assert!(unpack(&mut [&bomb[..]].into_iter()).is_err());
        let mut other = HeaderMap::new();
        other.insert(CONTENT_ENCODING, HeaderValue::from_static("br"));
        assert!(Unpack::of(&other).is_err());
    }
}
