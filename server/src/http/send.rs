//! What an answer over HTTP/1.1 has in memory, ours or the system's, and how it gets to the socket: head and pages with one call.

use std::io::{self, IoSlice};
use std::ops::RangeInclusive;
use std::sync::Arc;

use bytes::Bytes;
use lodestream_format::Asset;
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt};

use super::error_log;
use super::front::Front;
use super::resident::MappedPages;
use super::slices::Slices;
use super::socket::{OverTcp, Socket};
use crate::library::LibraryError;

/// What is in memory of an answer.
pub(super) enum Body {
    Held(Slices),
    /// Only for a socket that is [`OverTcp::plain`].
    Mapped(MappedPages),
}

impl Default for Body {
    fn default() -> Self {
        Self::Held(Slices::default())
    }
}

impl From<String> for Body {
    fn from(text: String) -> Self {
        Self::Held(Slices::from_iter([Bytes::from(text)]))
    }
}

impl Body {
    /// Pages, from where the system has them if `is_plain` allows that.
    ///
    /// # Errors
    /// Where the store fails, or has other bytes.
    pub(super) async fn of_pages(
        front: &Front,
        asset: &Arc<Asset>,
        pages: RangeInclusive<u32>,
        is_plain: bool,
    ) -> Result<Self, LibraryError> {
        let cache = &front.state().0.pages;
        if is_plain && let Some(mapped) = cache.mapped(asset, pages.clone()) {
            return Ok(Self::Mapped(mapped));
        }
        let slices = cache.pages(asset, pages, front.asker()).await?;
        Ok(Self::Held(slices))
    }

    pub(super) fn bytes(&self) -> u64 {
        match self {
            Self::Held(slices) => slices.bytes(),
            Self::Mapped(pages) => pages.bytes(),
        }
    }

    /// Sends `head`, then all of it.
    ///
    /// # Errors
    /// Where the connection fails, or the pages are gone by now.
    pub(super) async fn send<S: OverTcp + AsyncRead + AsyncWrite + Unpin>(
        self,
        socket: &mut Socket<S>,
        head: &[u8],
    ) -> io::Result<()> {
        match self {
            Self::Held(slices) => send_held(socket, head, slices).await?,
            Self::Mapped(pages) => send_mapped(socket, head, &pages).await?,
        }
        // TLS keeps what it has encrypted.
        socket.flush().await
    }
}

async fn send_held<S: AsyncWrite + Unpin>(
    socket: &mut Socket<S>,
    head: &[u8],
    slices: Slices,
) -> io::Result<()> {
    let slices: Vec<Bytes> = slices.collect();
    let mut pieces = Vec::with_capacity(slices.len() + 1);
    pieces.extend((!head.is_empty()).then(|| IoSlice::new(head)));
    pieces.extend(slices.iter().map(|slice| IoSlice::new(slice)));
    let mut left = &mut pieces[..];
    while !left.is_empty() {
        match socket.write_vectored(left).await? {
            0 => return Err(io::ErrorKind::WriteZero.into()),
            sent => IoSlice::advance_slices(&mut left, sent),
        }
    }
    Ok(())
}

async fn send_mapped<S: OverTcp>(
    socket: &mut Socket<S>,
    head: &[u8],
    pages: &MappedPages,
) -> io::Result<()> {
    let bytes = head.len() as u64 + pages.bytes();
    let mut sent = 0;
    while sent < bytes {
        let head_left = head.get(sent as usize..).unwrap_or_default();
        let pages_sent = sent.saturating_sub(head.len() as u64);
        let written = socket.write_plain(|to| pages.write(head_left, pages_sent, to));
        match written.await {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(now) => sent += now as u64,
            Err(error) => {
                if error.kind() == io::ErrorKind::UnexpectedEof {
                    error_log::cut_short(&error);
                }
                return Err(error);
            }
        }
    }
    Ok(())
}
