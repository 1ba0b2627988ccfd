//! Small writes of a connection, sent together. HTTP/2's library writes each frame by itself, 16 KiB at most, where the system's price is a
//! call's more than a byte's: copying frames into one buffer that stays in the processor's cache costs a tenth of what the calls do. What
//! was gathered goes out when the connection has said all that it has to say for now.

use std::io::{self, IoSlice};
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

use super::buffers::Buffer;
use super::memory::{Memory, Room};

/// Most bytes that are gathered.
pub(super) const GATHER_BYTES: usize = 64 * 1024;
/// A write of so many is sent as it is.
const LARGE_BYTES: usize = 32 * 1024;
/// A stream that is written to in pieces and sends at [`Gather::poll_send`]; clones are handles.
#[derive(Debug)]
pub(super) struct Gather<S>(Arc<Mutex<Inner<S>>>);

#[derive(Debug)]
struct Inner<S> {
    stream: S,
    /// Whether anything is.
    gathers: bool,
    /// What was gathered; none while that is nothing.
    buffer: Option<Buffer>,
    room: Option<Room>,
    /// So many of its bytes are sent.
    sent: usize,
    /// What was sent has to be flushed.
    flushes: bool,
    memory: Arc<Memory>,
}

impl<S> Clone for Gather<S> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<S: AsyncWrite + Unpin> Gather<S> {
    /// Where `memory` is short, or without `gathers`, nothing is gathered.
    pub(super) fn new(stream: S, memory: Arc<Memory>, gathers: bool) -> Self {
        Self(Arc::new(Mutex::new(Inner {
            stream,
            gathers,
            buffer: None,
            room: None,
            sent: 0,
            flushes: false,
            memory,
        })))
    }

    /// Sends what was gathered; to be called whenever its writer has been polled. Gives the bytes that the stream did not take.
    pub(super) fn poll_send(&self, context: &mut Context<'_>) -> io::Result<usize> {
        let mut inner = self.inner();
        match inner.poll_send(context) {
            Poll::Ready(sent) => sent.map(|()| 0),
            Poll::Pending => Ok(inner.unsent_bytes()),
        }
    }

    fn inner(&self) -> MutexGuard<'_, Inner<S>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<S: AsyncWrite + Unpin> Inner<S> {
    fn unsent_bytes(&self) -> usize {
        self.buffer.as_ref().map_or(0, Buffer::len) - self.sent
    }

    fn poll_send(&mut self, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        while let Some(unsent) = self
            .buffer
            .as_ref()
            .map(|buffer| &buffer.as_ref()[self.sent..])
            && !unsent.is_empty()
        {
            match ready!(Pin::new(&mut self.stream).poll_write(context, unsent))? {
                0 => return Poll::Ready(Err(io::ErrorKind::WriteZero.into())),
                bytes => self.sent += bytes,
            }
        }
        (self.buffer, self.room, self.sent) = (None, None, 0);
        if self.flushes {
            ready!(Pin::new(&mut self.stream).poll_flush(context))?;
            self.flushes = false;
        }
        Poll::Ready(Ok(()))
    }

    fn poll_write(
        &mut self,
        slices: &[IoSlice<'_>],
        context: &mut Context<'_>,
    ) -> Poll<io::Result<usize>> {
        let bytes = slices.iter().map(|slice| slice.len()).sum::<usize>();
        if self.sent + self.unsent_bytes() + bytes > GATHER_BYTES {
            ready!(self.poll_send(context))?;
        }
        let copies = self.gathers && bytes < LARGE_BYTES && !self.memory.is_short();
        if self.buffer.is_none() && !copies {
            let written = ready!(Pin::new(&mut self.stream).poll_write_vectored(context, slices))?;
            self.flushes = true;
            return Poll::Ready(Ok(written));
        }
        self.flushes = true;
        let buffer = self.buffer.get_or_insert_with(|| {
            self.room = Some(self.memory.hold(GATHER_BYTES));
            Buffer::take()
        });
        let before = buffer.len();
        for slice in slices {
            buffer.extend(slice);
        }
        Poll::Ready(Ok(buffer.len() - before))
    }
}

impl<S: AsyncRead + AsyncWrite + Unpin> AsyncRead for Gather<S> {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner().stream).poll_read(context, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Gather<S> {
    fn poll_write(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.inner().poll_write(&[IoSlice::new(bytes)], context)
    }

    fn poll_write_vectored(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        self.inner().poll_write(slices, context)
    }

    fn is_write_vectored(&self) -> bool {
        self.inner().stream.is_write_vectored()
    }

    /// Where it gathers, this does nothing: HTTP/2's library flushes after each frame.
    fn poll_flush(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let mut inner = self.inner();
        match inner.gathers {
            true => Poll::Ready(Ok(())),
            false => Pin::new(&mut inner.stream).poll_flush(context),
        }
    }

    fn poll_shutdown(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let mut inner = self.inner();
        ready!(inner.poll_send(context))?;
        Pin::new(&mut inner.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::socket::Socket;
    use bytes::Bytes;
    use proptest::prelude::*;
    use std::future::poll_fn;
    use std::task::Waker;
    use tokio::time::Instant;

    /// Takes what it has room for, and remembers each write.
    #[derive(Debug, Default)]
    struct Taking {
        writes: Vec<Vec<u8>>,
        room: usize,
    }

    impl AsyncWrite for Taking {
        fn poll_write(
            mut self: Pin<&mut Self>,
            _: &mut Context<'_>,
            bytes: &[u8],
        ) -> Poll<io::Result<usize>> {
            let taken = bytes.len().min(self.room);
            if taken == 0 {
                return Poll::Pending;
            }
            self.room -= taken;
            self.writes.push(bytes[..taken].to_vec());
            Poll::Ready(Ok(taken))
        }
        fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
            Poll::Ready(Ok(()))
        }
        fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
            Poll::Ready(Ok(()))
        }
    }

    fn gather(room: usize, memory: &Arc<Memory>) -> Gather<Taking> {
        let taking = Taking {
            room,
            ..Taking::default()
        };
        Gather::new(taking, Arc::clone(memory), true)
    }

    fn write(gather: &mut Gather<Taking>, bytes: &[u8]) -> Poll<usize> {
        let context = &mut Context::from_waker(Waker::noop());
        let written = Pin::new(gather).poll_write(context, bytes);
        written.map(|written| written.expect("nothing fails here"))
    }

    fn send(gather: &Gather<Taking>) -> usize {
        let context = &mut Context::from_waker(Waker::noop());
        gather.poll_send(context).expect("nothing fails here")
    }

    fn sizes(gather: &Gather<Taking>) -> Vec<usize> {
        gather.inner().stream.writes.iter().map(Vec::len).collect()
    }

    #[test]
    fn frames_go_out_together_and_large_writes_as_they_are() {
        let mut gather = gather(1 << 30, &Arc::default());
        for _ in 0..3 {
            assert_eq!(write(&mut gather, &[1; 16 * 1024]), Poll::Ready(16 * 1024));
        }
        assert!(sizes(&gather).is_empty());
        assert_eq!(send(&gather), 0);
        assert_eq!(sizes(&gather), [48 * 1024]);
        assert!(write(&mut gather, &[2; 100]).is_ready());
        assert!(write(&mut gather, &[3; 100 * 1024]).is_ready());
        assert_eq!(sizes(&gather), [48 * 1024, 100, 100 * 1024]);
    }

    #[test]
    fn nothing_is_gathered_where_memory_is_short() {
        let memory = Arc::new(Memory::default());
        let _held = memory.keep(Bytes::from(vec![0; 64 << 20]));
        let mut gather = gather(150, &memory);
        assert_eq!(write(&mut gather, &[1; 100]), Poll::Ready(100));
        assert_eq!(write(&mut gather, &[1; 100]), Poll::Ready(50));
        assert_eq!(write(&mut gather, &[1; 50]), Poll::Pending);
        assert_eq!((send(&gather), sizes(&gather)), (0, vec![100, 50]));
    }

    #[tokio::test(start_paused = true)]
    async fn a_client_that_takes_nothing_is_given_up_whatever_is_written() {
        for bytes in [100, LARGE_BYTES] {
            let memory = Arc::<Memory>::default();
            let (_client, stream) = tokio::io::duplex(16);
            let socket = Socket::new(stream, Arc::clone(&memory));
            let mut gather = Gather::new(socket, Arc::clone(&memory), true);
            let (began, piece) = (Instant::now(), vec![7; bytes]);
            let error = poll_fn(|context| {
                loop {
                    match Pin::new(&mut gather).poll_write(context, &piece) {
                        Poll::Ready(Ok(_)) => {}
                        Poll::Ready(Err(error)) => return Poll::Ready(error),
                        Poll::Pending => break,
                    }
                }
                match gather.poll_send(context) {
                    Ok(_) => Poll::Pending,
                    Err(error) => Poll::Ready(error),
                }
            });
            assert_eq!(error.await.kind(), io::ErrorKind::TimedOut);
            assert_eq!(began.elapsed(), memory.patience());
        }
    }

    proptest! {
        /// Whatever is written and however slowly it is taken: the same bytes in the same order, and never more than the bound in between.
        #[test]
        fn what_is_sent_is_what_was_written(steps in prop::collection::vec((0usize..80_000, 0usize..80_000, any::<bool>()), 1..40)) {
            let mut gather = gather(0, &Arc::default());
            let mut written = Vec::new();
            for (bytes, room, sends) in steps {
                gather.inner().stream.room += room;
                let piece: Vec<u8> = (0..bytes).map(|at| (written.len() + at) as u8).collect();
                if let Poll::Ready(taken) = write(&mut gather, &piece) {
                    written.extend_from_slice(&piece[..taken]);
                }
                if sends {
                    send(&gather);
                }
                let unsent = gather.inner().unsent_bytes();
                prop_assert!(unsent <= GATHER_BYTES);
                prop_assert_eq!(gather.inner().stream.writes.concat().len() + unsent, written.len());
            }
            gather.inner().stream.room = usize::MAX;
            prop_assert_eq!(send(&gather), 0);
            prop_assert!(gather.inner().stream.writes.concat() == written, "other bytes, or in another order");
        }
    }
}
