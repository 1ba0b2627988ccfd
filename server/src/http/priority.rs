//! Which answer of an HTTP/2 connection goes first: the most urgent (RFC 9218, section 4; a request that does not say is of urgency 3), of
//! several the oldest. Bodies hand their bytes over in pieces, and until the socket takes them they count against the connection's
//! [`AHEAD_BYTES`]; beyond these a body waits. So an urgent answer finds no more than that before it, however much was asked for, and a
//! client that reads nothing holds no more than that.

use std::collections::BTreeMap;
use std::future::Future;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker, ready};
use std::time::Duration;

use axum::body::HttpBody;
use axum::http::HeaderMap;
use bytes::{Buf, Bytes};
use hyper::body::{Frame, SizeHint};
use tokio::sync::Notify;
use tokio::time::{Instant, Sleep};

use super::activity::{Activity, InFlight};
use super::memory::Memory;

/// Bytes of a connection that are handed over and not sent.
const AHEAD_BYTES: usize = 192 * 1024;
/// Most bytes of a piece.
const PIECE_BYTES: usize = 64 * 1024;
/// Where so long nothing was written, one more piece goes out: the client may have stopped to read the streams that hold what is ahead, and
/// wait for another.
const PATIENCE: Duration = Duration::from_secs(1);
/// Urgency of a request that has none.
const DEFAULT_URGENCY: u8 = 3;

/// A connection's answers.
#[derive(Debug, Default)]
pub(super) struct Sending {
    state: Mutex<State>,
    /// Something is ahead that was not before.
    begins: Notify,
}

#[derive(Debug, Default)]
struct State {
    ahead_bytes: usize,
    /// The pieces that are ahead.
    ahead: Vec<Bytes>,
    /// Written, and not taken by the socket.
    unsent_bytes: usize,
    /// When something ahead was written last, or began to be ahead.
    written: Option<Instant>,
    /// When something was handed over last.
    handed: Option<Instant>,
    answers: u64,
    waiting: BTreeMap<Place, Waker>,
}

/// Urgency, smaller before larger, and number of an answer.
type Place = (u8, u64);

impl Sending {
    /// `body` as an answer of this connection.
    pub(super) fn pace<B>(self: &Arc<Self>, body: B, urgency: u8) -> Paced<B> {
        let mut state = self.state();
        state.answers += 1;
        let turn = Turn {
            place: (urgency, state.answers),
            sending: Arc::clone(self),
            patience: None,
        };
        drop(state);
        Paced {
            body,
            turn: Some(turn),
            piece: Bytes::new(),
            _in_flight: None,
        }
    }

    /// So many written bytes the socket did not take.
    pub(super) fn unsent(&self, bytes: usize) {
        let mut state = self.state();
        let less = bytes < state.unsent_bytes;
        state.unsent_bytes = bytes;
        drop(state);
        if less {
            self.wake();
        }
    }

    /// Whether another piece may be ahead.
    #[cfg(test)]
    pub(super) fn has_room(&self) -> bool {
        self.state().has_room()
    }

    /// The piece ahead that holds `slice`, as that slice of it: what writes it need not copy it.
    pub(super) fn piece_of(&self, slice: &[u8]) -> Option<Bytes> {
        let within = slice.as_ptr_range();
        let state = self.state();
        let piece = state.ahead.iter().find(|piece| {
            let piece = piece.as_ptr_range();
            piece.start <= within.start && within.end <= piece.end
        })?;
        Some(piece.slice_ref(slice))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends when the client has taken nothing of what is ahead for as long as `memory` has patience: its socket may take bytes, but it gives
    /// HTTP/2 no window, or none that lasts.
    pub(super) async fn stalled(&self, memory: &Memory, activity: &Activity) {
        loop {
            let begins = self.begins.notified();
            if self.state().ahead_bytes == 0 {
                begins.await;
            }
            tokio::time::sleep(Memory::look_again()).await;
            let state = self.state();
            let since = state.written.filter(|_| state.ahead_bytes > 0);
            drop(state);
            activity.set_stalled(since);
            if since.is_some_and(|since| since.elapsed() >= memory.patience()) {
                return;
            }
        }
    }

    /// Wakes who is next, if there is room.
    fn wake(&self) {
        let state = self.state();
        let next = state.waiting.first_key_value();
        let waker = next
            .filter(|_| state.has_room())
            .map(|(_, waker)| waker.clone());
        drop(state);
        if let Some(waker) = waker {
            waker.wake();
        }
    }
}

impl State {
    fn has_room(&self) -> bool {
        self.ahead_bytes + self.unsent_bytes + PIECE_BYTES <= AHEAD_BYTES
    }
}

/// The urgency that a request asks for: `u=0` to `u=7` in its `priority` field.
pub(super) fn urgency(request: &HeaderMap) -> u8 {
    let fields = request.get_all("priority");
    let members = fields
        .iter()
        .filter_map(|field| field.to_str().ok())
        .flat_map(|field| field.split(','));
    let urgency = |member: &str| match member
        .trim()
        .strip_prefix("u=")?
        .split(';')
        .next()?
        .as_bytes()
    {
        [digit @ b'0'..=b'7'] => Some(digit - b'0'),
        _ => None,
    };
    // Of a key that comes twice the last one counts (RFC 8941, section 3.2).
    members
        .filter_map(urgency)
        .next_back()
        .unwrap_or(DEFAULT_URGENCY)
}

/// A body that waits for its turn; outside HTTP/2, where a connection has one answer at a time, it never waits.
#[derive(Debug)]
pub(super) struct Paced<B> {
    body: B,
    turn: Option<Turn>,
    /// What the body gave and was not handed over yet.
    piece: Bytes,
    _in_flight: Option<InFlight>,
}

#[derive(Debug)]
struct Turn {
    sending: Arc<Sending>,
    place: Place,
    patience: Option<Pin<Box<Sleep>>>,
}

impl<B> Paced<B> {
    /// A body that is alone on its connection.
    pub(super) fn alone(body: B) -> Self {
        Self {
            body,
            turn: None,
            piece: Bytes::new(),
            _in_flight: None,
        }
    }

    /// Whose request is in flight until the body is gone.
    pub(super) fn counted(self, in_flight: InFlight) -> Self {
        Self {
            _in_flight: Some(in_flight),
            ..self
        }
    }
}

impl Turn {
    /// Ready when `piece` may be handed over; it counts from then on.
    fn poll_enter(&mut self, piece: &Bytes, context: &mut Context<'_>) -> Poll<()> {
        let now = Instant::now();
        let mut state = self.sending.state();
        let first = state
            .waiting
            .first_key_value()
            .is_none_or(|(first, _)| *first >= self.place);
        let mut enters = first && state.has_room();
        if !enters && first {
            let until = state.written.max(state.handed).unwrap_or(now) + PATIENCE;
            let patience = self
                .patience
                .get_or_insert_with(|| Box::pin(tokio::time::sleep_until(until)));
            patience.as_mut().reset(until);
            enters = patience.as_mut().poll(context).is_ready();
        }
        if !enters {
            state.waiting.insert(self.place, context.waker().clone());
            return Poll::Pending;
        }
        state.waiting.remove(&self.place);
        let begins = state.ahead_bytes == 0;
        state.ahead_bytes += piece.len();
        state.ahead.push(piece.clone());
        // What is handed over because a client reads other streams is no sign that it reads.
        if begins || state.written.is_none() {
            state.written = Some(now);
        }
        state.handed = Some(now);
        drop(state);
        if begins {
            self.sending.begins.notify_one();
        }
        self.patience = None;
        self.sending.wake();
        Poll::Ready(())
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        self.sending.state().waiting.remove(&self.place);
        self.sending.wake();
    }
}

/// Bytes that count as ahead until they are written, which is when HTTP/2's library drops them.
struct Ahead {
    bytes: Bytes,
    sending: Arc<Sending>,
}

impl AsRef<[u8]> for Ahead {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

impl Drop for Ahead {
    fn drop(&mut self) {
        let mut state = self.sending.state();
        state.ahead_bytes -= self.bytes.len();
        let is_this = |piece: &Bytes| piece.as_ptr_range() == self.bytes.as_ptr_range();
        // Two answers may have the same bytes ahead; either entry stands for both.
        let at = state.ahead.iter().position(is_this);
        let _gone = at.map(|at| state.ahead.swap_remove(at));
        state.written = Some(Instant::now());
        drop(state);
        self.sending.wake();
    }
}

impl<B: HttpBody<Data = Bytes> + Unpin> HttpBody for Paced<B> {
    type Data = Bytes;
    type Error = B::Error;

    fn poll_frame(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, B::Error>>> {
        let this = self.get_mut();
        if this.piece.is_empty() {
            match ready!(Pin::new(&mut this.body).poll_frame(context)) {
                Some(Ok(frame)) if this.turn.is_some() => match frame.into_data() {
                    Ok(data) => this.piece = data,
                    Err(other) => return Poll::Ready(Some(Ok(other))),
                },
                other => return Poll::Ready(other),
            }
        }
        let Some(turn) = &mut this.turn else {
            return Poll::Ready(Some(Ok(Frame::data(std::mem::take(&mut this.piece)))));
        };
        let bytes = this.piece.slice(..this.piece.len().min(PIECE_BYTES));
        ready!(turn.poll_enter(&bytes, context));
        this.piece.advance(bytes.len());
        let ahead = Ahead {
            bytes,
            sending: Arc::clone(&turn.sending),
        };
        Poll::Ready(Some(Ok(Frame::data(Bytes::from_owner(ahead)))))
    }

    fn is_end_stream(&self) -> bool {
        self.piece.is_empty() && self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        let left = self.piece.len() as u64;
        let body = self.body.size_hint();
        let mut hint = SizeHint::new();
        hint.set_lower(body.lower() + left);
        if let Some(upper) = body.upper() {
            hint.set_upper(upper + left);
        }
        hint
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;
    use futures_util::FutureExt;
    use std::collections::VecDeque;
    use std::convert::Infallible;

    #[derive(Debug)]
    struct Slices(VecDeque<Bytes>);

    impl HttpBody for Slices {
        type Data = Bytes;
        type Error = Infallible;
        fn poll_frame(
            mut self: Pin<&mut Self>,
            _: &mut Context<'_>,
        ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
            Poll::Ready(self.0.pop_front().map(|slice| Ok(Frame::data(slice))))
        }
    }

    fn answer(sending: &Arc<Sending>, urgency: u8, pieces: usize) -> Paced<Slices> {
        let piece = Bytes::from(vec![urgency; PIECE_BYTES]);
        sending.pace(Slices(vec![piece; pieces].into()), urgency)
    }

    /// The next piece, if there is one now.
    fn next(body: &mut Paced<Slices>) -> Option<Bytes> {
        let frame = std::future::poll_fn(|context| Pin::new(&mut *body).poll_frame(context));
        let frame = frame.now_or_never()??;
        frame.ok()?.into_data().ok()
    }

    #[tokio::test(start_paused = true)]
    async fn an_urgent_answer_finds_no_more_ahead_than_the_limit() {
        let sending = Arc::new(Sending::default());
        let mut bulk: Vec<_> = (0..20).map(|_| answer(&sending, 5, 30)).collect();
        let mut ahead: VecDeque<_> = bulk.iter_mut().filter_map(next).collect();
        assert_eq!(ahead.len() * PIECE_BYTES, AHEAD_BYTES);
        let mut urgent = answer(&sending, 0, 3);
        assert!(next(&mut urgent).is_none());
        for _ in 0..3 {
            // A piece is written: whoever is polled, only the urgent answer gives its next one.
            ahead.pop_front();
            assert!(bulk.iter_mut().all(|body| next(body).is_none()));
            ahead.extend(next(&mut urgent));
            assert_eq!(ahead.back().map(|piece| piece[0]), Some(0));
            // HTTP/2's library asks for the next one at once.
            assert!(next(&mut urgent).is_none());
        }
        drop(urgent);
        ahead.pop_front();
        // Then the oldest of the others.
        assert!(bulk[1..].iter_mut().all(|body| next(body).is_none()));
        assert!(next(&mut bulk[0]).is_some());
    }

    #[tokio::test(start_paused = true)]
    async fn an_answer_goes_on_behind_streams_that_the_client_does_not_read() {
        let sending = Arc::new(Sending::default());
        let mut unread = answer(&sending, 0, 8);
        let held: Vec<_> = std::iter::from_fn(|| next(&mut unread)).collect();
        assert_eq!(held.len() * PIECE_BYTES, AHEAD_BYTES);
        let mut other = answer(&sending, 0, 2);
        drop(unread);
        let began = Instant::now();
        for _ in 0..2 {
            let frame = std::future::poll_fn(|context| Pin::new(&mut other).poll_frame(context));
            assert!(frame.await.is_some());
        }
        assert_eq!(began.elapsed(), 2 * PATIENCE);
    }

    #[tokio::test(start_paused = true)]
    async fn a_client_that_takes_nothing_has_stalled_and_an_idle_one_has_not() {
        let memory = Memory::default();
        let sending = Arc::new(Sending::default());
        let activity = Activity::default();
        let stalled = sending.stalled(&memory, &activity);
        let idle = tokio::time::timeout(Duration::from_secs(600), stalled);
        assert!(idle.await.is_err());
        let mut body = answer(&sending, 3, 100);
        let mut ahead: VecDeque<_> = std::iter::from_fn(|| next(&mut body)).collect();
        let reads = async {
            for _ in 0..10 {
                tokio::time::sleep(memory.patience() / 2).await;
                ahead.pop_front();
                ahead.extend(next(&mut body));
            }
            Instant::now()
        };
        let ((), last) = tokio::join!(sending.stalled(&memory, &activity), reads);
        assert!(activity.stalled_since().is_some());
        let since = last.elapsed();
        let patience = memory.patience();
        assert!(
            (patience..patience + 2 * Memory::look_again()).contains(&since),
            "{since:?}"
        );
    }

    #[test]
    fn urgency_is_the_last_one_that_is_well_formed() {
        let of = |field: &'static str| {
            let mut request = HeaderMap::new();
            request.insert("priority", HeaderValue::from_static(field));
            urgency(&request)
        };
        assert_eq!(urgency(&HeaderMap::new()), 3);
        for (field, expected) in [("u=0", 0), ("i, u=7", 7), ("u=1;x=2,i", 1), ("u=1, u=5", 5)] {
            assert_eq!(of(field), expected, "{field}");
        }
        for field in ["u=8", "u=-1", "u=10", "u", "U=1", "", "u=1.0"] {
            assert_eq!(of(field), 3, "{field}");
        }
    }
}
