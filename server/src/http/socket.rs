//! A connection that must say something soon.
//!
//! hyper's own header timeout starts only once it knows the protocol, so a connection that stays silent, or stops inside the
//! first bytes, would be kept for ever.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::Sleep;

/// Bytes that tell the protocol: the length of HTTP/2's preface.
const PREFACE_BYTES: usize = 24;

/// A stream whose first [`PREFACE_BYTES`] must come before a deadline.
#[derive(Debug)]
pub(super) struct Socket<S> {
    stream: S,
    deadline: Option<Pin<Box<Sleep>>>,
    read_bytes: usize,
}

impl<S> Socket<S> {
    pub(super) fn new(stream: S, first_bytes: Duration) -> Self {
        Self {
            stream,
            deadline: Some(Box::pin(tokio::time::sleep(first_bytes))),
            read_bytes: 0,
        }
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Socket<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        if let Poll::Ready(read) = Pin::new(&mut self.stream).poll_read(context, buffer) {
            if self.deadline.is_some() {
                self.read_bytes += buffer.filled().len() - before;
                if self.read_bytes >= PREFACE_BYTES {
                    self.deadline = None;
                }
            }
            return Poll::Ready(read);
        }
        match &mut self.deadline {
            Some(deadline) => deadline
                .as_mut()
                .poll(context)
                .map(|()| Err(io::Error::new(io::ErrorKind::TimedOut, "no request came"))),
            None => Poll::Pending,
        }
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Socket<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        pieces: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(context, pieces)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::{TcpListener, TcpStream};

    #[tokio::test]
    async fn a_silent_connection_ends_and_one_that_spoke_stays() {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("binds");
        let address = listener.local_addr().expect("an address");
        for (says, ends) in [(0, true), (PREFACE_BYTES - 1, true), (PREFACE_BYTES, false)] {
            let mut client = TcpStream::connect(address).await.expect("connects");
            let (stream, _) = listener.accept().await.expect("accepts");
            let mut socket = Socket::new(stream, Duration::from_millis(100));
            client.write_all(&vec![b'x'; says]).await.expect("writes");
            let mut bytes = [0; 2 * PREFACE_BYTES];
            let read = async {
                loop {
                    match socket.read(&mut bytes).await {
                        Ok(0) => panic!("the client is still there"),
                        Ok(_) => {}
                        Err(error) => return error.kind(),
                    }
                }
            };
            let read = tokio::time::timeout(Duration::from_millis(400), read).await;
            let expected = ends.then_some(io::ErrorKind::TimedOut);
            assert_eq!(read.ok(), expected, "after {says} bytes");
            drop(client);
        }
    }
}
