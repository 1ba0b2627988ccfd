//! One connection, from its first byte to its last: pages over HTTP/1.1 by [`http1`], all else by
//! hyper. It ends when its client keeps silent where a request is due, takes nothing of an answer,
//! speaks another protocol than was agreed, or asks for nothing any longer.

use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::task::Poll;
use std::time::Duration;

use hyper::server::conn::{http1 as general1, http2 as general2};
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulConnection;
use tokio::io::{AsyncRead, AsyncWrite};

use super::activity::Activity;
use super::front::Front;
use super::gather::Gather;
use super::http1;
use super::serve::take_no_more;
use super::socket::{OverTcp, PREFACE, Socket};

/// Longest wait for a request's head, also between two requests of one connection over HTTP/1.1.
const HEAD_TIMEOUT: Duration = Duration::from_secs(30);
/// The same for HTTP/2, between the last answer and the next request. Pings do not count: whoever
/// only keeps a connection asks for nothing.
const IDLE: Duration = Duration::from_secs(60);
/// How long a client may take to end a connection that it was told is over.
const GRACE: Duration = Duration::from_secs(1);
/// As [`super::serve`] has it for HTTP/1.1: here something more urgent may come.
const HTTP2_UNSENT_BYTES: u32 = 16 * 1024;
/// Time between two pings of a silent HTTP/2 connection, and for their answer.
const PING: Duration = Duration::from_secs(20);
/// Longest head over HTTP/1.1, most that is read of a body at once, and what an answer may have
/// ahead of its last write.
const BUFFER_BYTES: usize = 64 * 1024;
/// Streams of a connection at once.
const STREAMS: u32 = 128;

/// The protocol that a connection may speak.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Spoken {
    /// The protocol of its first bytes.
    Any,
    /// HTTP/1.1, as was agreed on while it was made.
    Http1,
    /// HTTP/2, in the same way.
    Http2,
}

/// How connections are served; clones are alike.
#[derive(Debug, Clone)]
pub(super) struct Served {
    http1: general1::Builder,
    http2: general2::Builder<TokioExecutor>,
}

type Done = Result<(), Box<dyn std::error::Error + Send + Sync>>;

impl Default for Served {
    fn default() -> Self {
        let mut http1 = general1::Builder::new();
        http1
            .timer(TokioTimer::new())
            .half_close(true)
            .max_buf_size(BUFFER_BYTES)
            .header_read_timeout(HEAD_TIMEOUT);
        let mut http2 = general2::Builder::new(TokioExecutor::new());
        http2
            .timer(TokioTimer::new())
            .keep_alive_interval(PING)
            .keep_alive_timeout(PING)
            .max_concurrent_streams(STREAMS);
        Self { http1, http2 }
    }
}

impl Served {
    /// Serves one connection until it ends.
    pub(super) async fn serve<S>(self, stream: S, front: Front, spoken: Spoken)
    where
        S: OverTcp + AsyncRead + AsyncWrite + Send + Unpin + 'static,
    {
        let activity = Arc::clone(front.activity());
        let memory = Arc::clone(front.state().0.pages.memory());
        let mut socket = Socket::new(stream, memory, Arc::clone(&activity));
        if spoken != Spoken::Http2 {
            let read = {
                let mut pages = pin!(http1::serve(&mut socket, &front, HEAD_TIMEOUT));
                activity.unless_told(pages.as_mut()).await
            };
            let read = match read {
                None | Some(Ok(None)) => return,
                Some(Ok(Some(read))) => read,
                Some(Err(error)) => return tracing::debug!("connection: {error}"),
            };
            let is_http2 = read == PREFACE || read.starts_with(PREFACE);
            if is_http2 && spoken == Spoken::Http1 {
                return tracing::debug!("connection: HTTP/2, where HTTP/1.1 was agreed on");
            }
            socket.unread(read);
            if !is_http2 {
                let gather = Gather::new(socket, Arc::clone(front.state().0.pages.memory()), None);
                let io = TokioIo::new(gather.clone());
                // Boxed: many connections never get here, and this is most of their size.
                let served = Box::pin(self.http1.serve_connection(io, front.clone()));
                return Box::pin(until_over(served, gather, front, false)).await;
            }
        }
        if let Err(error) = take_no_more(socket.stream().tcp(), HTTP2_UNSENT_BYTES) {
            return tracing::debug!("connection: {error}");
        }
        socket.read_within(HEAD_TIMEOUT, PREFACE.len());
        let sending = Some(Arc::clone(front.sending()));
        let gather = Gather::new(socket, Arc::clone(front.state().0.pages.memory()), sending);
        let io = TokioIo::new(gather.clone());
        let served = Box::pin(self.http2.serve_connection(io, front.clone()));
        Box::pin(until_over(served, gather, front, true)).await;
    }
}

/// Serves all but [`http1`]'s pages, until the connection is over.
async fn until_over<C, S>(mut served: Pin<Box<C>>, gather: Gather<S>, front: Front, is_http2: bool)
where
    C: GracefulConnection<Error = hyper::Error>,
    S: AsyncWrite + Unpin,
{
    let (activity, sending) = (front.activity(), front.sending());
    let memory = front.state().0.pages.memory();
    let over = async {
        let idle = async {
            match is_http2 {
                true => activity.idle_for(IDLE).await,
                // hyper has a timeout of its own for it.
                false => std::future::pending().await,
            }
        };
        tokio::select! {
            () = front.state().drained() => {}
            () = poll_fn(|context| activity.poll_told(context)) => {}
            () = idle => {}
        }
    };
    let done = tokio::select! {
        done = drive(&mut served, &gather) => done,
        () = sending.stalled(memory, activity) => Err(STALLED.into()),
        () = over => {
            ends(&mut served, &gather, activity, sending.stalled(memory, activity)).await
        }
    };
    if let Err(error) = done {
        tracing::debug!("connection: {error}");
    }
}

const STALLED: &str = "nothing of the answers was taken";

/// Serves until the connection ends by itself.
async fn drive<C, S>(served: &mut Pin<Box<C>>, gather: &Gather<S>) -> Done
where
    C: GracefulConnection<Error = hyper::Error>,
    S: AsyncWrite + Unpin,
{
    poll_fn(|context| {
        let served = served.as_mut().poll(context);
        match gather.poll_send(context) {
            Ok(()) => served.map_err(Into::into),
            Err(error) => Poll::Ready(Err(error.into())),
        }
    })
    .await
}

/// Tells the client that there will be no more, and lets what it asked for finish.
async fn ends<C, S>(
    served: &mut Pin<Box<C>>,
    gather: &Gather<S>,
    activity: &Activity,
    stalled: impl Future<Output = ()>,
) -> Done
where
    C: GracefulConnection<Error = hyper::Error>,
    S: AsyncWrite + Unpin,
{
    if activity.is_told() && activity.idle_since().is_none() {
        return Err("others came, and nothing of its answers was taken".into());
    }
    served.as_mut().graceful_shutdown();
    let grace = async {
        // Others wait for its room: the last word is sent, and nobody waits for an answer to it.
        if !activity.is_told() {
            activity.idle_for(GRACE).await;
        }
    };
    tokio::select! {
        biased;
        done = drive(served, gather) => done,
        () = stalled => Err(STALLED.into()),
        // It was said that it is over.
        () = grace => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::connections::Connections;
    use crate::http::cors::Cors;
    use crate::http::limits::{ClientLimits, Limits};
    use crate::http::socket::PREFACE;
    use crate::http::{AppState, Serves};
    use crate::library::Library;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::{TcpListener, TcpStream};
    use tokio::time::Instant;

    const PING_FRAME: u8 = 6;
    const GOAWAY_FRAME: u8 = 7;
    const HEADERS_FRAME: u8 = 1;
    /// `GET /healthz` of the host `a`, by the static table where that has it.
    const REQUEST: &[u8] = b"\x82\x86\x44\x08/healthz\x41\x01a";

    fn frame(kind: u8, flags: u8, stream: u8, payload: &[u8]) -> Vec<u8> {
        let head = [0, 0, payload.len() as u8, kind, flags, 0, 0, 0, stream];
        [&head[..], payload].concat()
    }

    /// A client that keeps a connection by all that costs it nothing, and asks at the times `asks`;
    /// gives when it ended and whether that was said before.
    async fn keeps(mut stream: TcpStream, asks: &[Duration]) -> (Duration, bool) {
        let began = Instant::now();
        let hello = [PREFACE, &frame(4, 0, 0, &[])].concat();
        stream.write_all(&hello).await.expect("taken");
        let (mut was_told, mut asked) = (false, 0);
        loop {
            let mut head = [0; 9];
            let next = asks.get(asked).map_or(Duration::MAX, |&at| at);
            let read = tokio::select! {
                read = stream.read_exact(&mut head) => read,
                () = tokio::time::sleep(next.saturating_sub(began.elapsed())) => {
                    asked += 1;
                    let request = frame(HEADERS_FRAME, 5, 2 * asked as u8 - 1, REQUEST);
                    stream.write_all(&request).await.expect("taken");
                    continue;
                }
            };
            if read.is_err() {
                return (began.elapsed(), was_told);
            }
            let bytes = usize::from(head[1]) * 256 + usize::from(head[2]);
            let mut payload = vec![0; bytes];
            stream
                .read_exact(&mut payload)
                .await
                .expect("a whole frame");
            match (head[3], head[4]) {
                (PING_FRAME, 0) => {
                    let answer = frame(PING_FRAME, 1, 0, &payload);
                    // After the last word nobody may be there to take it.
                    let _ = stream.write_all(&answer).await;
                }
                (GOAWAY_FRAME, _) => was_told = true,
                _ => {}
            }
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_connection_without_streams_is_told_that_it_is_over() {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("binds");
        let address = listener.local_addr().expect("an address");
        let library = Library::open("memory://").expect("memory opens");
        let state = AppState::new(library, 1 << 20);
        let front = Front::new(state, Serves::All, Arc::<Cors>::default());
        let connections = Arc::new(Connections::new(8));
        let limits = Arc::new(Limits::new(ClientLimits::default()));
        for asks in [&[][..], &[IDLE / 2, IDLE]] {
            let stream = TcpStream::connect(address).await.expect("connects");
            let (accepted, peer) = listener.accept().await.expect("accepts");
            let client = limits.connect(peer.ip(), 8).expect("room");
            let permit = connections.room().await;
            let entered = connections.enter(permit, 1, Arc::new(client));
            let front = front.of(&entered);
            let served = Served::default().serve(accepted, front, Spoken::Any);
            let ((), (ended, was_told)) = tokio::join!(served, keeps(stream, asks));
            let last = asks.last().copied().unwrap_or_default();
            let within = last + IDLE..=last + IDLE + PING;
            assert!(within.contains(&ended), "{ended:?} after {last:?}");
            assert!(was_told);
        }
    }
}
