//! Small writes of a connection, sent together. HTTP/2's library writes each frame by itself, 16 KiB at most, where the system's price is a
//! call's more than a byte's. What is to be written of an answer is held, not copied; what frames say around it is gathered in a buffer. All
//! of it goes out when the connection has said all that it has to say for now.

use std::collections::VecDeque;
use std::io::{self, IoSlice};
use std::ops::Range;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, ready};

use bytes::{Buf, Bytes};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

use super::buffers::Buffer;
use super::memory::{Memory, Room};
use super::priority::Sending;

/// Most bytes that are gathered.
pub(super) const GATHER_BYTES: usize = 128 * 1024;
/// A write of so many is sent as it is.
const LARGE_BYTES: usize = 32 * 1024;
/// Fewer are copied, which is less work than to hold what they are part of.
const SMALL_BYTES: usize = 1024;
/// Most pieces that go out by one call.
const CALL_PIECES: usize = 32;

/// A stream that is written to in pieces and sends at [`Gather::poll_send`]; clones are handles.
#[derive(Debug)]
pub(super) struct Gather<S>(Arc<Mutex<Inner<S>>>);

#[derive(Debug)]
struct Inner<S> {
    stream: S,
    /// Whose pieces are written; none where nothing is gathered.
    sending: Option<Arc<Sending>>,
    /// What was gathered and is not sent.
    pieces: VecDeque<Piece>,
    unsent_bytes: usize,
    /// What was copied since nothing was unsent; none while that is nothing.
    copied: Option<Buffer>,
    room: Option<Room>,
    /// What was sent has to be flushed.
    flushes: bool,
    memory: Arc<Memory>,
}

#[derive(Debug)]
enum Piece {
    /// So much of what was copied.
    Copied(Range<usize>),
    /// Bytes of an answer.
    Held(Bytes),
}

impl<S> Clone for Gather<S> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<S: AsyncWrite + Unpin> Gather<S> {
    /// Where `memory` is short, or without `sending`, nothing is gathered.
    pub(super) fn new(stream: S, memory: Arc<Memory>, sending: Option<Arc<Sending>>) -> Self {
        Self(Arc::new(Mutex::new(Inner {
            stream,
            sending,
            pieces: VecDeque::new(),
            unsent_bytes: 0,
            copied: None,
            room: None,
            flushes: false,
            memory,
        })))
    }

    /// Sends what was gathered, as far as the stream takes it; to be called whenever its writer has been polled.
    pub(super) fn poll_send(&self, context: &mut Context<'_>) -> io::Result<()> {
        match self.inner().poll_send(context) {
            Poll::Ready(sent) => sent,
            Poll::Pending => Ok(()),
        }
    }

    fn inner(&self) -> MutexGuard<'_, Inner<S>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<S: AsyncWrite + Unpin> Inner<S> {
    fn poll_send(&mut self, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        while !self.pieces.is_empty() {
            let copied = self.copied.as_ref().map_or(&[][..], Buffer::as_ref);
            let mut slices = [IoSlice::new(&[]); CALL_PIECES];
            for (slice, piece) in slices.iter_mut().zip(&self.pieces) {
                *slice = IoSlice::new(match piece {
                    Piece::Copied(range) => &copied[range.clone()],
                    Piece::Held(bytes) => bytes,
                });
            }
            let slices = &slices[..self.pieces.len().min(CALL_PIECES)];
            match ready!(Pin::new(&mut self.stream).poll_write_vectored(context, slices))? {
                0 => return Poll::Ready(Err(io::ErrorKind::WriteZero.into())),
                bytes => self.sent(bytes),
            }
        }
        (self.copied, self.room) = (None, None);
        if self.flushes {
            ready!(Pin::new(&mut self.stream).poll_flush(context))?;
            self.flushes = false;
        }
        Poll::Ready(Ok(()))
    }

    /// Forgets the first `bytes` of what is unsent.
    fn sent(&mut self, mut bytes: usize) {
        self.unsent_bytes -= bytes;
        while let Some(piece) = self.pieces.front_mut() {
            let taken = piece.bytes().min(bytes);
            match piece {
                Piece::Copied(range) => range.start += taken,
                Piece::Held(held) => held.advance(taken),
            }
            bytes -= taken;
            if piece.bytes() > 0 {
                break;
            }
            self.pieces.pop_front();
        }
        if let Some(sending) = &self.sending {
            sending.unsent(self.unsent_bytes);
        }
    }

    fn poll_write(
        &mut self,
        slices: &[IoSlice<'_>],
        context: &mut Context<'_>,
    ) -> Poll<io::Result<usize>> {
        let bytes = slices.iter().map(|slice| slice.len()).sum::<usize>();
        let copied_bytes = self.copied.as_ref().map_or(0, Buffer::len);
        if self.unsent_bytes.max(copied_bytes) + bytes > GATHER_BYTES {
            ready!(self.poll_send(context))?;
        }
        let gathers = bytes < LARGE_BYTES && !self.memory.is_short();
        if let Some(sending) = self.sending.clone().filter(|_| gathers) {
            slices.iter().for_each(|slice| self.gather(slice, &sending));
            sending.unsent(self.unsent_bytes);
            self.flushes = true;
            return Poll::Ready(Ok(bytes));
        }
        ready!(self.poll_send(context))?;
        let written = ready!(Pin::new(&mut self.stream).poll_write_vectored(context, slices))?;
        // Not before: a flush of nothing would count as something that the client took.
        self.flushes = true;
        Poll::Ready(Ok(written))
    }

    fn gather(&mut self, slice: &[u8], sending: &Sending) {
        if slice.is_empty() {
            return;
        }
        self.unsent_bytes += slice.len();
        if slice.len() >= SMALL_BYTES
            && let Some(held) = sending.piece_of(slice)
        {
            return self.pieces.push_back(Piece::Held(held));
        }
        let copied = self.copied.get_or_insert_with(|| {
            self.room = Some(self.memory.hold(GATHER_BYTES));
            Buffer::take()
        });
        let before = copied.len();
        copied.extend(slice);
        match self.pieces.back_mut() {
            Some(Piece::Copied(range)) => range.end = copied.len(),
            _ => self.pieces.push_back(Piece::Copied(before..copied.len())),
        }
    }
}

impl Piece {
    fn bytes(&self) -> usize {
        match self {
            Self::Copied(range) => range.len(),
            Self::Held(held) => held.len(),
        }
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
        match inner.sending {
            Some(_) => Poll::Ready(Ok(())),
            None => Pin::new(&mut inner.stream).poll_flush(context),
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
    use axum::body::{Body, HttpBody};
    use futures_util::FutureExt;
    use proptest::prelude::*;
    use std::future::poll_fn;
    use std::task::Waker;
    use tokio::time::Instant;

    /// Takes what it has room for, and remembers each write and where it lay.
    #[derive(Debug, Default)]
    struct Taking {
        writes: Vec<Vec<u8>>,
        slices: Vec<*const u8>,
        room: usize,
    }

    impl AsyncWrite for Taking {
        fn poll_write(
            self: Pin<&mut Self>,
            context: &mut Context<'_>,
            bytes: &[u8],
        ) -> Poll<io::Result<usize>> {
            self.poll_write_vectored(context, &[IoSlice::new(bytes)])
        }
        fn poll_write_vectored(
            mut self: Pin<&mut Self>,
            _: &mut Context<'_>,
            slices: &[IoSlice<'_>],
        ) -> Poll<io::Result<usize>> {
            let mut bytes: Vec<u8> = slices.iter().flat_map(|slice| slice.to_vec()).collect();
            bytes.truncate(self.room);
            if bytes.is_empty() {
                return Poll::Pending;
            }
            let taken = bytes.len();
            self.room -= taken;
            self.writes.push(bytes);
            self.slices
                .extend(slices.iter().map(|slice| slice.as_ptr()));
            Poll::Ready(Ok(taken))
        }
        fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
            Poll::Ready(Ok(()))
        }
        fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
            Poll::Ready(Ok(()))
        }
    }

    fn gather(room: usize, memory: &Arc<Memory>) -> (Gather<Taking>, Arc<Sending>) {
        let taking = Taking {
            room,
            ..Taking::default()
        };
        let sending = Arc::<Sending>::default();
        let gather = Gather::new(taking, Arc::clone(memory), Some(Arc::clone(&sending)));
        (gather, sending)
    }

    fn write(gather: &mut Gather<Taking>, slices: &[&[u8]]) -> Poll<usize> {
        let context = &mut Context::from_waker(Waker::noop());
        let slices: Vec<_> = slices.iter().map(|slice| IoSlice::new(slice)).collect();
        let written = Pin::new(gather).poll_write_vectored(context, &slices);
        written.map(|written| written.expect("nothing fails here"))
    }

    /// Sends, and gives what is unsent.
    fn send(gather: &Gather<Taking>) -> usize {
        let context = &mut Context::from_waker(Waker::noop());
        gather.poll_send(context).expect("nothing fails here");
        gather.inner().unsent_bytes
    }

    fn sizes(gather: &Gather<Taking>) -> Vec<usize> {
        gather.inner().stream.writes.iter().map(Vec::len).collect()
    }

    /// `bytes` as they are handed over in an answer.
    fn handed_over(sending: &Arc<Sending>, bytes: &Bytes) -> Bytes {
        let mut body = sending.pace(Body::from(bytes.clone()), 3);
        let frame = poll_fn(|context| Pin::new(&mut body).poll_frame(context)).now_or_never();
        let frame = frame.flatten().expect("there is room").expect("no error");
        frame.into_data().expect("data")
    }

    #[test]
    fn frames_go_out_together_and_large_writes_as_they_are() {
        let (mut gather, _) = gather(1 << 30, &Arc::default());
        for _ in 0..3 {
            let frame: [&[u8]; 2] = [&[0; 9], &[1; 16 * 1024]];
            assert_eq!(write(&mut gather, &frame), Poll::Ready(9 + 16 * 1024));
        }
        assert!(sizes(&gather).is_empty());
        assert_eq!(send(&gather), 0);
        assert_eq!(sizes(&gather), [3 * 9 + 48 * 1024]);
        assert!(write(&mut gather, &[&[2; 100]]).is_ready());
        assert!(write(&mut gather, &[&[3; 100 * 1024]]).is_ready());
        assert_eq!(sizes(&gather)[1..], [100, 100 * 1024]);
    }

    #[test]
    fn what_is_written_of_an_answer_is_not_copied() {
        let (mut gather, sending) = gather(1 << 30, &Arc::default());
        let page = Bytes::from(vec![5; 40 * 1024]);
        let frame = handed_over(&sending, &page);
        for part in frame.chunks(16 * 1024) {
            assert!(write(&mut gather, &[&[9; 9], part]).is_ready());
        }
        // HTTP/2's library is done with it before it is sent.
        drop(frame);
        assert!(sending.piece_of(&page).is_none());
        assert_eq!(send(&gather), 0);
        let lay = gather.inner().stream.slices.clone();
        let starts: Vec<_> = page.chunks(16 * 1024).map(<[u8]>::as_ptr).collect();
        let of_page = lay.into_iter().skip(1).step_by(2);
        assert!(of_page.eq(starts), "copied");
        assert_eq!(sizes(&gather), [3 * 9 + 40 * 1024]);
    }

    #[test]
    fn nothing_is_gathered_where_memory_is_short() {
        let memory = Arc::new(Memory::default());
        let _held = memory.keep(Bytes::from(vec![0; 64 << 20]));
        let (mut gather, _) = gather(150, &memory);
        assert_eq!(write(&mut gather, &[&[1; 100]]), Poll::Ready(100));
        assert_eq!(write(&mut gather, &[&[1; 100]]), Poll::Ready(50));
        assert_eq!(write(&mut gather, &[&[1; 50]]), Poll::Pending);
        assert_eq!((send(&gather), sizes(&gather)), (0, vec![100, 50]));
    }

    #[tokio::test(start_paused = true)]
    async fn a_client_that_takes_nothing_is_given_up_whatever_is_written() {
        for bytes in [100, LARGE_BYTES] {
            let memory = Arc::<Memory>::default();
            let (_client, stream) = tokio::io::duplex(16);
            let socket = Socket::new(stream, Arc::clone(&memory), Arc::default());
            let mut gather = Gather::new(socket, Arc::clone(&memory), Some(Arc::default()));
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
        fn what_is_sent_is_what_was_written(steps in prop::collection::vec((0usize..80_000, 0usize..80_000, any::<bool>(), any::<bool>()), 1..40)) {
            let (mut gather, sending) = gather(0, &Arc::default());
            let mut written = Vec::new();
            for (bytes, room, is_answer, sends) in steps {
                gather.inner().stream.room += room;
                let mut piece: Bytes = (0..bytes).map(|at| (written.len() + at) as u8).collect();
                if bytes > 0 && is_answer && sending.has_room() {
                    piece = handed_over(&sending, &piece);
                }
                for frame in piece.chunks(16 * 1024) {
                    let (head, rest) = frame.split_at(frame.len().min(9));
                    let Poll::Ready(taken) = write(&mut gather, &[head, rest]) else {
                        break;
                    };
                    written.extend_from_slice(&frame[..taken]);
                }
                drop(piece);
                if sends {
                    send(&gather);
                }
                let unsent = gather.inner().unsent_bytes;
                prop_assert!(unsent <= GATHER_BYTES);
                prop_assert_eq!(gather.inner().stream.writes.concat().len() + unsent, written.len());
            }
            gather.inner().stream.room = usize::MAX;
            prop_assert_eq!(send(&gather), 0);
            prop_assert!(gather.inner().stream.writes.concat() == written, "other bytes, or in another order");
        }
    }
}
