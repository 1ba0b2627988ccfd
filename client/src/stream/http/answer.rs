//! An answer's body as it comes: at its pace, and never more than its reader expects.

use bytes::Bytes;
use lodestream_format::wire::{BlockEvent, BlockReader};
use reqwest::Response;

use super::super::error::StreamError;
use super::pace::Pace;
use super::unpack::Unpack;

/// An answer with status 200 whose body has not been read.
pub(super) struct Answer<'a> {
    pub(super) url: &'a str,
    pub(super) response: Response,
    pub(super) pace: Pace,
}

impl<'a> Answer<'a> {
    async fn chunk(&mut self) -> Result<Option<Bytes>, StreamError> {
        let chunk = self.pace.keep(self.url, self.response.chunk()).await?;
        let chunk = chunk.map_err(|error| http_error(self.url, error))?;
        self.pace.came(chunk.as_ref().map_or(0, Bytes::len));
        Ok(chunk)
    }

    /// The whole body, which has at most `most_bytes`. Its room grows with what comes.
    ///
    /// # Errors
    /// [`StreamError::Length`] as soon as more is announced or comes.
    pub(super) async fn at_most(mut self, most_bytes: u64) -> Result<Bytes, StreamError> {
        let headers = self.response.headers();
        // Nothing compressed was asked for.
        if let Unpack::Zstd(_) = Unpack::of(headers).map_err(StreamError::format(self.url))? {
            let error = lodestream_format::FormatError::new("content-encoding", "none", "zstd");
            return Err(StreamError::format(self.url)(error));
        }
        let announced = self.response.content_length();
        self.check(most_bytes, announced.unwrap_or(0))?;
        let mut bytes = Vec::new();
        while let Some(chunk) = self.chunk().await? {
            self.check(most_bytes, (bytes.len() + chunk.len()) as u64)?;
            bytes.extend_from_slice(&chunk);
        }
        Ok(Bytes::from(bytes))
    }

    /// The whole body, which has just so many bytes.
    pub(super) async fn exactly(self, expected_bytes: u64) -> Result<Bytes, StreamError> {
        let place = self.url.to_owned();
        let length = |found_bytes| StreamError::Length {
            place,
            expected_bytes,
            found_bytes,
        };
        if let Some(announced) = self.response.content_length()
            && announced != expected_bytes
        {
            return Err(length(announced));
        }
        let bytes = self.at_most(expected_bytes).await?;
        match bytes.len() as u64 == expected_bytes {
            true => Ok(bytes),
            false => Err(length(bytes.len() as u64)),
        }
    }

    fn check(&self, expected_bytes: u64, found_bytes: u64) -> Result<(), StreamError> {
        match found_bytes > expected_bytes {
            true => Err(StreamError::Length {
                place: self.url.to_owned(),
                expected_bytes,
                found_bytes,
            }),
            false => Ok(()),
        }
    }

    /// The body as blocks.
    pub(super) fn blocks(self) -> Result<Blocks<'a>, StreamError> {
        let unpack = Unpack::of(self.response.headers());
        Ok(Blocks {
            unpack: unpack.map_err(StreamError::format(self.url))?,
            answer: self,
            reader: BlockReader::default(),
            read_bytes: 0,
        })
    }
}

/// The blocks of an answer.
pub(super) struct Blocks<'a> {
    answer: Answer<'a>,
    unpack: Unpack,
    reader: BlockReader,
    /// Bytes as they came.
    pub(super) read_bytes: u64,
}

impl Blocks<'_> {
    /// The next header or whole block; `None` after a whole answer.
    pub(super) async fn next_event(&mut self) -> Result<Option<BlockEvent>, StreamError> {
        let url = self.answer.url;
        loop {
            if let Some(event) = self.reader.next_event().map_err(StreamError::format(url))? {
                return Ok(Some(event));
            }
            let piece = self.unpack.next_piece();
            if let Some(piece) = piece.map_err(StreamError::format(url))? {
                self.reader.push(&piece);
            } else if let Some(chunk) = self.answer.chunk().await? {
                self.read_bytes += chunk.len() as u64;
                self.unpack.push(chunk);
            } else if self.reader.is_ended() {
                return Ok(None);
            } else {
                return Err(StreamError::Http {
                    url: url.to_owned(),
                    found: "no end block".to_owned(),
                });
            }
        }
    }
}

/// The innermost reason says what happened; the outer ones repeat the URL.
pub(super) fn http_error(url: &str, error: reqwest::Error) -> StreamError {
    let mut reason: &dyn std::error::Error = &error;
    while let Some(source) = reason.source() {
        reason = source;
    }
    StreamError::Http {
        url: url.to_owned(),
        found: reason.to_string(),
    }
}
