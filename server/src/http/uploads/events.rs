//! Events of an upload: `queued`, `progress`, then `done` or `error`.

use std::convert::Infallible;
use std::time::Duration;

use bytes::Bytes;
use futures_util::{Stream, stream};
use tokio::sync::mpsc;

/// Events that wait for the connection; later ones are left out, but the last.
pub(super) const EVENTS_AHEAD: usize = 64;
/// A comment goes out after so long without an event, so that no proxy takes the connection for
/// dead.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// Longest wait for room for the last event.
const LAST: Duration = Duration::from_secs(30);

/// The sending end of an upload's events.
#[derive(Debug)]
pub(super) struct Told(mpsc::Sender<Bytes>);

impl Told {
    pub(super) fn new(sender: mpsc::Sender<Bytes>) -> Self {
        Self(sender)
    }

    /// Sends an event; leaves it out where the connection is behind.
    pub(super) fn tell(&self, name: &str, data: &str) {
        let _ = self.0.try_send(event(name, data));
    }

    /// Sends the last event; an error means that the client is gone.
    pub(super) async fn end(self, name: &str, data: &str) {
        let _ = self.0.send_timeout(event(name, data), LAST).await;
    }
}

fn event(name: &str, data: &str) -> Bytes {
    Bytes::from(format!("event: {name}\ndata: {data}\n\n"))
}

/// The events, and comments between them.
pub(super) fn stream(
    receiver: mpsc::Receiver<Bytes>,
) -> impl Stream<Item = Result<Bytes, Infallible>> {
    stream::unfold(receiver, |mut receiver| async {
        match tokio::time::timeout(KEEP_ALIVE, receiver.recv()).await {
            Ok(event) => Some((Ok(event?), receiver)),
            Err(_) => Some((Ok(Bytes::from_static(b": still here\n\n")), receiver)),
        }
    })
}
