//! A connection on which something must move: whoever keeps silent for too long where a request is due, or takes nothing of an answer, is
//! given up.
//!
//! hyper's own header timeout starts only once it knows the protocol, so a connection that stays silent, or stops inside the first bytes,
//! would be kept for ever; for writing it has none.

use std::future::{Future, poll_fn};
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use bytes::{Buf, Bytes};
use tokio::io::{AsyncRead, AsyncWrite, Interest, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::{Instant, Sleep};
use tokio_rustls::server::TlsStream;

use super::activity::Activity;
use super::memory::Memory;

/// HTTP/2 begins with it, and nothing else does.
pub(super) const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";

/// What speaks over TCP in the end.
pub(super) trait OverTcp {
    /// The connection.
    fn tcp(&self) -> &TcpStream;

    /// The connection, where what is written to it is what the other side reads.
    fn plain(&self) -> Option<&TcpStream>;
}

impl OverTcp for TcpStream {
    fn tcp(&self) -> &TcpStream {
        self
    }

    fn plain(&self) -> Option<&TcpStream> {
        Some(self)
    }
}

impl OverTcp for TlsStream<TcpStream> {
    fn tcp(&self) -> &TcpStream {
        self.get_ref().0
    }

    fn plain(&self) -> Option<&TcpStream> {
        None
    }
}

/// A stream with deadlines.
#[derive(Debug)]
pub(super) struct Socket<S> {
    stream: S,
    /// Bytes that were read and given back.
    unread: Bytes,
    /// When so many more bytes must have been read.
    reading: Option<(usize, Instant)>,
    /// Since when nothing was taken of what is written.
    writing: Option<Instant>,
    memory: Arc<Memory>,
    activity: Arc<Activity>,
    /// Set to one of the deadlines only where nothing can be read or written, so that it costs nothing while bytes move.
    timer: Pin<Box<Sleep>>,
}

impl<S> Socket<S> {
    /// Who takes nothing of an answer for as long as `memory` has patience is given up.
    pub(super) fn new(stream: S, memory: Arc<Memory>, activity: Arc<Activity>) -> Self {
        Self {
            stream,
            unread: Bytes::new(),
            reading: None,
            writing: None,
            memory,
            activity,
            timer: Box::pin(tokio::time::sleep(Memory::look_again())),
        }
    }

    /// What it speaks over.
    pub(super) fn stream(&self) -> &S {
        &self.stream
    }

    /// Gives bytes back, to be read again.
    pub(super) fn unread(&mut self, bytes: Bytes) {
        self.unread = bytes;
    }

    /// So many `bytes` more, given back ones too, have to come within this time, which begins now;
    /// gives when that is.
    pub(super) fn read_within(&mut self, time: Duration, bytes: usize) -> Instant {
        let now = Instant::now();
        self.reading = Some((bytes, now + time));
        now
    }

    fn has_read(&mut self, bytes: usize) {
        self.reading = self
            .reading
            .and_then(|(due, until)| Some((due.checked_sub(bytes).filter(|&due| due > 0)?, until)));
    }

    /// Ready where `until` has passed.
    fn passed(
        &mut self,
        until: Option<Instant>,
        what: &str,
        context: &mut Context<'_>,
    ) -> Poll<io::Error> {
        let Some(until) = until else {
            return Poll::Pending;
        };
        loop {
            if self.timer.deadline() > until {
                self.timer.as_mut().reset(until);
            }
            ready!(self.timer.as_mut().poll(context));
            if until <= Instant::now() {
                return Poll::Ready(io::Error::new(io::ErrorKind::TimedOut, what));
            }
            // It was set for an earlier one.
            self.timer.as_mut().reset(until);
        }
    }

    /// Keeps the time that a write may take.
    fn written(
        &mut self,
        written: Poll<io::Result<usize>>,
        context: &mut Context<'_>,
    ) -> Poll<io::Result<usize>> {
        if written.is_ready() {
            if self.writing.take().is_some() {
                self.activity.set_stalled(None);
            }
            return written;
        }
        let since = *self.writing.get_or_insert_with(Instant::now);
        self.activity.set_stalled(Some(since));
        loop {
            let again = Instant::now() + Memory::look_again();
            let until = (since + self.memory.patience()).min(again);
            let error =
                ready!(self.passed(Some(until), "nothing of the answer was taken", context));
            if since + self.memory.patience() <= Instant::now() {
                return Poll::Ready(Err(error));
            }
        }
    }
}

impl<S: OverTcp> Socket<S> {
    /// Writes what `write` does to the connection, as soon as that takes something; only where it is [`OverTcp::plain`].
    pub(super) async fn write_plain(
        &mut self,
        mut write: impl FnMut(&TcpStream) -> io::Result<usize>,
    ) -> io::Result<usize> {
        poll_fn(|context| {
            let written = match self.stream.plain() {
                Some(stream) => poll_write(stream, &mut write, context),
                None => Poll::Ready(Err(io::ErrorKind::Unsupported.into())),
            };
            self.written(written, context)
        })
        .await
    }
}

fn poll_write(
    stream: &TcpStream,
    write: &mut impl FnMut(&TcpStream) -> io::Result<usize>,
    context: &mut Context<'_>,
) -> Poll<io::Result<usize>> {
    loop {
        ready!(stream.poll_write_ready(context))?;
        match stream.try_io(Interest::WRITABLE, || write(stream)) {
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            written => return Poll::Ready(written),
        }
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Socket<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if !self.unread.is_empty() {
            let bytes = self.unread.len().min(buffer.remaining());
            buffer.put_slice(&self.unread[..bytes]);
            self.unread.advance(bytes);
            if self.unread.is_empty() {
                // Nothing is left of what they lie in, either.
                self.unread = Bytes::new();
            }
            self.has_read(bytes);
            return Poll::Ready(Ok(()));
        }
        let before = buffer.filled().len();
        if let Poll::Ready(read) = Pin::new(&mut self.stream).poll_read(context, buffer) {
            self.has_read(buffer.filled().len() - before);
            return Poll::Ready(read);
        }
        let until = self.reading.map(|(_, until)| until);
        self.passed(until, "no request came", context).map(Err)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Socket<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.written(written, context)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        pieces: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, pieces);
        self.written(written, context)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let flushed = Pin::new(&mut self.stream).poll_flush(context);
        self.written(flushed.map_ok(|()| 0), context).map_ok(|_| ())
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let ended = Pin::new(&mut self.stream).poll_shutdown(context);
        self.written(ended.map_ok(|()| 0), context).map_ok(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};

    const SHORT: Duration = Duration::from_millis(100);

    #[tokio::test(start_paused = true)]
    async fn a_silent_connection_ends_and_one_that_spoke_stays() {
        for (says, ends) in [(0, true), (PREFACE.len() - 1, true), (PREFACE.len(), false)] {
            let (mut client, stream) = duplex(1024);
            let mut socket = Socket::new(stream, Arc::default(), Arc::default());
            socket.read_within(SHORT, PREFACE.len());
            socket.unread(Bytes::from_static(b"xy").slice(..says.min(2)));
            let more = vec![b'x'; says.saturating_sub(2)];
            client.write_all(&more).await.expect("writes");
            let mut bytes = [0; 2 * PREFACE.len()];
            let read = async {
                loop {
                    match socket.read(&mut bytes).await {
                        Ok(0) => panic!("the client is still there"),
                        Ok(_) => {}
                        Err(error) => return error.kind(),
                    }
                }
            };
            let read = tokio::time::timeout(4 * SHORT, read).await;
            let expected = ends.then_some(io::ErrorKind::TimedOut);
            assert_eq!(read.ok(), expected, "after {says} bytes");
        }
    }

    #[tokio::test(start_paused = true)]
    async fn an_answer_that_nobody_takes_ends_the_connection_soon_where_memory_is_short() {
        for short in [false, true] {
            let memory = Arc::new(Memory::default());
            let _held = short.then(|| memory.keep(Bytes::from(vec![0; 64 << 20])));
            let patience = memory.patience();
            // Of whole milliseconds, which is what tokio's clock counts.
            let within = patience - Duration::from_millis(50);
            let (mut client, stream) = duplex(16);
            let mut socket = Socket::new(stream, Arc::clone(&memory), Arc::default());
            let began = Instant::now();
            // A slow client: 8 bytes at a time, each within the time.
            let slow = async {
                for _ in 0..4 {
                    tokio::time::sleep(within).await;
                    client.read_exact(&mut [0; 8]).await.expect("reads");
                }
            };
            let (written, ()) = tokio::join!(socket.write_all(&[7; 64]), slow);
            let kind = written.expect_err("the client stopped").kind();
            assert_eq!(kind, io::ErrorKind::TimedOut);
            assert_eq!(began.elapsed(), within * 4 + patience);
        }
    }

    #[tokio::test(start_paused = true)]
    async fn patience_ends_when_memory_gets_short() {
        let memory = Arc::new(Memory::default());
        let (_client, stream) = duplex(16);
        let mut socket = Socket::new(stream, Arc::clone(&memory), Arc::default());
        let began = Instant::now();
        let fills = async {
            tokio::time::sleep(Duration::from_secs(11)).await;
            memory.keep(Bytes::from(vec![0; 64 << 20]))
        };
        let (written, _held) = tokio::join!(socket.write_all(&[7; 64]), fills);
        assert!(written.is_err());
        assert!(
            (11..=14).contains(&began.elapsed().as_secs()),
            "{:?}",
            began.elapsed()
        );
    }
}
