//! The layer around every route: counts the request, names it in whatever is logged about it, and writes the access log.

use std::net::IpAddr;
use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use axum::body::{Body, HttpBody};
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderName, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::Response;
use bytes::Bytes;
use hyper::body::{Frame, SizeHint};
use tracing::Instrument;

use super::AppState;
use super::limits::ClientAddress;

/// The field that names a request, for a client or a proxy that has a name for it, and of every answer that reports an error.
pub(super) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// Longest name that is taken from outside.
const MAX_ID_BYTES: usize = 64;
/// Where the access log goes, as `--access-log` and filters name it.
pub const ACCESS: &str = "access";

/// A new name: unlike all others of this process, and most likely of others.
pub(super) fn new_id() -> HeaderValue {
    static REQUESTS: AtomicU64 = AtomicU64::new(0);
    let now = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    let number = REQUESTS.fetch_add(1, Ordering::Relaxed);
    let text = format!(
        "{:x}-{:x}-{number:x}",
        now.as_nanos() as u64,
        std::process::id()
    );
    HeaderValue::from_maybe_shared(Bytes::from(text)).unwrap_or(HeaderValue::from_static("-"))
}

/// The client's name, if it can stand in a log, and that it is the client's.
fn id_of(request: &Request) -> (HeaderValue, bool) {
    let given = request.headers().get(REQUEST_ID).filter(|id| {
        (1..=MAX_ID_BYTES).contains(&id.len()) && id.as_bytes().iter().all(u8::is_ascii_graphic)
    });
    given.map_or_else(|| (new_id(), false), |id| (id.clone(), true))
}

/// The layer.
pub(super) async fn requests(
    State(state): State<AppState>,
    route: Option<MatchedPath>,
    request: Request,
    next: Next,
) -> Response {
    let (id, given) = id_of(&request);
    let name = id.to_str().unwrap_or_default();
    state.0.metrics.began();
    let mut counted = Counted {
        access: Access::of(
            request.extensions().get(),
            request.method(),
            request.uri().path(),
            name,
        ),
        state,
        route,
        // Stays where the client goes before there is an answer (499 as nginx counts it).
        status: 499,
        bytes: 0,
        started: Instant::now(),
    };
    let span = tracing::error_span!("request", id = name);
    let mut response = next.run(request).instrument(span).await;
    counted.status = response.status().as_u16();
    if given || counted.status >= 400 {
        response.headers_mut().insert(REQUEST_ID, id);
    }
    response.map(|body| Body::new(CountedBody { body, counted }))
}

/// Counts its request when it goes.
struct Counted {
    state: AppState,
    route: Option<MatchedPath>,
    access: Option<Box<Access>>,
    status: u16,
    bytes: u64,
    started: Instant,
}

impl Drop for Counted {
    fn drop(&mut self) {
        let metrics = &self.state.0.metrics;
        let route = self.route.as_ref().map_or("none", MatchedPath::as_str);
        let seconds = self.started.elapsed().as_secs_f64();
        metrics.finished(route, self.status, self.bytes, seconds);
        if let Some(access) = &self.access {
            access.log(self.status, self.bytes, seconds);
        }
    }
}

struct CountedBody {
    body: Body,
    counted: Counted,
}

impl HttpBody for CountedBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = Pin::new(&mut self.body).poll_frame(context);
        if let Poll::Ready(Some(Ok(frame))) = &frame {
            self.counted.bytes += frame.data_ref().map_or(0, |data| data.len() as u64);
        }
        frame
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// What the access log says of a request besides how it ended.
#[derive(Debug)]
pub(super) struct Access {
    client: Option<IpAddr>,
    method: Method,
    path: String,
    id: String,
}

impl Access {
    /// Nothing where there is no access log.
    pub(super) fn of(
        client: Option<&ClientAddress>,
        method: &Method,
        path: &str,
        id: &str,
    ) -> Option<Box<Self>> {
        tracing::enabled!(target: ACCESS, tracing::Level::INFO).then(|| {
            Box::new(Self {
                client: client.map(|client| client.0),
                method: method.clone(),
                path: path.to_owned(),
                id: id.to_owned(),
            })
        })
    }

    /// Writes the line.
    pub(super) fn log(&self, status: u16, bytes: u64, seconds: f64) {
        let Self {
            client,
            method,
            path,
            id,
        } = self;
        let client = client.map(tracing::field::display);
        let ms = (seconds * 1e6).round() / 1e3;
        tracing::info!(target: ACCESS, client, %method, path, status, bytes, ms, id);
    }
}
