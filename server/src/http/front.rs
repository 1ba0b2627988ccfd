//! The front: pages that are in memory are answered before the router sees their requests, which is most of what a server does. All else
//! goes through the router, unless its client asks too often; `tests/http_cache.rs` holds the two answers against each other.

use std::convert::Infallible;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Instant;

use axum::Router;
use axum::body::{Body, HttpBody};
use axum::http::header::{
    CACHE_CONTROL, CONNECTION, CONTENT_LENGTH, CONTENT_TYPE, ETAG, HOST, IF_NONE_MATCH,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Request, Response, Version};
use axum::response::IntoResponse;
use bytes::Bytes;
use futures_util::future::{Either, Ready, ready};
use hyper::body::{Frame, Incoming, SizeHint};
use hyper::service::Service;
use hyper_util::service::TowerToHyperService;
use lodestream_format::FormatError;
use tokio::sync::Semaphore;

use super::activity::Activity;
use super::body::is_small;
use super::connections::Entered;
use super::cors::Cors;
use super::error::HttpError;
use super::etag::IMMUTABLE;
use super::fair::Asker;
use super::limits::{ClientAddress, Connected};
use super::pages::{self, OCTETS, PAGES_ROUTE};
use super::priority::{self, Paced, Sending};
use super::requests::{Access, REQUEST_ID};
use super::slices::Slices;
use super::{AppState, Serves, router_of};

/// The service of every connection.
#[derive(Debug, Clone)]
pub(super) struct Front {
    state: AppState,
    router: TowerToHyperService<Router>,
    client: Option<Arc<Connected>>,
    /// Which connection this is, of all that there were.
    asker: Asker,
    sending: Arc<Sending>,
    activity: Arc<Activity>,
    /// Of all connections, and of this one.
    turns: [Arc<Semaphore>; 2],
    serves: Serves,
    cors: Arc<Cors>,
}

/// Requests for which an answer is looked up at once, of all connections and of one; the others
/// wait. A look-up holds more than a wait does, and an HTTP/2 connection asks for
/// [`super::connection`]'s number of things at once.
const TURNS: [usize; 2] = [128, 16];

/// Whether bytes can name a host, with or without a port.
pub(super) fn is_host(host: &[u8]) -> bool {
    let names = |byte: &u8| byte.is_ascii_alphanumeric() || b"-._~!$&'()*+,;=:[]%".contains(byte);
    host.iter().all(names)
}

type Answered = Result<Response<Paced<FrontBody>>, Infallible>;

impl Front {
    pub(super) fn new(state: AppState, serves: Serves, cors: Arc<Cors>) -> Self {
        let router = router_of(state.clone(), serves, Arc::clone(&cors));
        Self {
            router: TowerToHyperService::new(router),
            state,
            client: None,
            asker: Asker::Connection(0),
            sending: Arc::default(),
            activity: Arc::default(),
            turns: TURNS.map(|turns| Arc::new(Semaphore::new(turns))),
            serves,
            cors,
        }
    }

    /// The service of one connection.
    pub(super) fn of(&self, entered: &Entered) -> Self {
        Self {
            client: Some(Arc::clone(entered.client())),
            asker: Asker::Connection(entered.number()),
            sending: Arc::default(),
            activity: Arc::clone(entered.activity()),
            turns: [
                Arc::clone(&self.turns[0]),
                Arc::new(Semaphore::new(TURNS[1])),
            ],
            ..self.clone()
        }
    }

    pub(super) fn state(&self) -> &AppState {
        &self.state
    }

    /// The connection's answers over HTTP/2.
    pub(super) fn sending(&self) -> &Arc<Sending> {
        &self.sending
    }

    /// When the connection was of use.
    pub(super) fn activity(&self) -> &Arc<Activity> {
        &self.activity
    }

    /// Whether there are pages.
    pub(super) fn serves_pages(&self) -> bool {
        self.serves != Serves::Metrics
    }

    /// The origins that may show answers.
    pub(super) fn cors(&self) -> &Cors {
        &self.cors
    }

    /// Where the connection comes from.
    pub(super) fn client(&self) -> ClientAddress {
        let client = self.client.as_ref();
        client.map_or(ClientAddress::NONE, |client| client.address())
    }

    /// Who reads on this connection.
    pub(super) fn asker(&self) -> Asker {
        self.asker
    }

    /// What the access log says of a request for pages.
    pub(super) fn access(&self, path: &str, id: &str) -> Option<Box<Access>> {
        let client = self.client.as_ref().map(|client| client.address());
        Access::of(client.as_ref(), &Method::GET, path, id)
    }

    /// Whether the client asks too often now; if not, this counts.
    pub(super) fn is_limited(&self) -> bool {
        self.client
            .as_ref()
            .is_some_and(|client| client.request().is_err())
    }

    /// That the client asks too often; whoever watches over the server may always ask whether it is well.
    fn refused(&self, request: &Request<Incoming>) -> Option<Response<FrontBody>> {
        let secs = self.client.as_ref()?.request().err()?;
        if is_health(request) {
            return None;
        }
        let metrics = &self.state.0.metrics;
        metrics.began();
        metrics.finished("limited", 429, 0, 0.0);
        let mut response = HttpError::TooMany { secs }.into_response();
        self.cors.open(request.headers(), response.headers_mut());
        Some(response.map(FrontBody::Routed))
    }

    /// That a request of HTTP/1.1 does not name one host (RFC 9112, section 3.2): what lies between may take it for another's.
    fn misaddressed(&self, request: &Request<Incoming>) -> Option<Response<FrontBody>> {
        if request.version() != Version::HTTP_11 {
            return None;
        }
        let mut hosts = request.headers().get_all(HOST).iter();
        let host = hosts.next().map(HeaderValue::as_bytes);
        let is_one = hosts.next().is_none();
        if is_one && host.is_some_and(is_host) {
            return None;
        }
        let found = format!("{host:?}{}", if is_one { "" } else { " and more" });
        let error = HttpError::BadRequest(FormatError::new("request", "one Host field", found));
        let metrics = &self.state.0.metrics;
        metrics.began();
        metrics.finished("none", 400, 0, 0.0);
        let mut response = error.into_response();
        // What follows on the connection may be part of this request for somebody else.
        let close = HeaderValue::from_static("close");
        response.headers_mut().insert(CONNECTION, close);
        self.cors.open(request.headers(), response.headers_mut());
        Some(response.map(FrontBody::Routed))
    }

    /// The answer, where all of it is in memory and the request asks for nothing but the pages.
    fn held(&self, request: &Request<Incoming>) -> Option<Response<FrontBody>> {
        let started = Instant::now();
        let asks = |field: HeaderName| request.headers().contains_key(field);
        let is_get = request.method() == Method::GET && self.serves_pages();
        if !is_get || asks(IF_NONE_MATCH) || asks(REQUEST_ID) {
            return None;
        }
        let (hash, range) = pages::split(request.uri().path())?;
        let (first, last) = pages::parse_pages(range).ok()?;
        let shared = &self.state.0;
        let asset = shared.tables.held(&hash.parse().ok()?)?;
        let bytes = pages::bytes_of(&asset, first, last).ok()?;
        if !is_small(bytes.end - bytes.start) {
            return None;
        }
        let slices = shared.pages.held(&asset, first..=last, self.asker)?;
        // Written as it is parsed: the path is the tag.
        let tag = [b"\"", hash.as_bytes(), b".", range.as_bytes(), b"\""].concat();
        let mut headers = HeaderMap::with_capacity(9);
        headers.insert(CONTENT_TYPE, OCTETS);
        headers.insert(ETAG, HeaderValue::from_maybe_shared(Bytes::from(tag)).ok()?);
        headers.insert(CONTENT_LENGTH, HeaderValue::from(slices.bytes()));
        headers.insert(CACHE_CONTROL, HeaderValue::from_static(IMMUTABLE.1));
        self.cors.open(request.headers(), &mut headers);
        shared.metrics.pages_sent((last - first + 1) as u64);
        shared.metrics.began();
        let mut response = Response::new(FrontBody::Held(HeldBody {
            state: self.state.clone(),
            access: self.access(request.uri().path(), ""),
            sent_bytes: 0,
            started,
            slices,
        }));
        *response.headers_mut() = headers;
        Some(response)
    }
}

impl Service<Request<Incoming>> for Front {
    type Response = Response<Paced<FrontBody>>;
    type Error = Infallible;
    type Future = Either<Ready<Answered>, Pin<Box<dyn Future<Output = Answered> + Send>>>;

    fn call(&self, mut request: Request<Incoming>) -> Self::Future {
        let in_flight = self.activity.begin();
        // HTTP/1.1 has one answer at a time.
        let sending = (request.version() == Version::HTTP_2).then(|| Arc::clone(&self.sending));
        let urgency = priority::urgency(request.headers());
        let pace = move |body| match sending {
            Some(sending) => sending.pace(body, urgency).counted(in_flight),
            None => Paced::alone(body).counted(in_flight),
        };
        let early = self
            .refused(&request)
            .or_else(|| self.misaddressed(&request));
        if let Some(response) = early.or_else(|| self.held(&request)) {
            return Either::Left(ready(Ok(response.map(pace))));
        }
        request.extensions_mut().insert(self.asker);
        if let Some(client) = &self.client {
            request.extensions_mut().insert(client.address());
        }
        let router = self.router.clone();
        let turns = has_turn(&request).then(|| self.turns.clone());
        Either::Right(Box::pin(async move {
            let mut held = [None, None];
            if let Some([all, own]) = turns {
                // The own one first: who waits for it must not keep others waiting. Never closed.
                held[1] = own.acquire_owned().await.ok();
                held[0] = all.acquire_owned().await.ok();
            }
            let routed = router.call(request).await;
            drop(held);
            Ok(routed?.map(|body| pace(FrontBody::Routed(body))))
        }))
    }
}

fn is_health(request: &Request<Incoming>) -> bool {
    matches!(request.uri().path(), "/healthz" | "/readyz")
}

/// Whether a request waits for its turn: not where its body has to come first, not where somebody
/// asks whether the server is well, and not for pages, of which an urgent one must not wait for
/// others.
fn has_turn(request: &Request<Incoming>) -> bool {
    let is_get = matches!(*request.method(), Method::GET | Method::HEAD);
    is_get && !is_health(request) && pages::split(request.uri().path()).is_none()
}

/// What an answer is made of.
pub(super) enum FrontBody {
    /// Pages from memory.
    Held(HeldBody),
    /// Whatever the router said.
    Routed(Body),
}

/// Pages from memory; counts its request when it goes.
pub(super) struct HeldBody {
    state: AppState,
    access: Option<Box<Access>>,
    slices: Slices,
    sent_bytes: u64,
    started: Instant,
}

impl Drop for HeldBody {
    fn drop(&mut self) {
        let seconds = self.started.elapsed().as_secs_f64();
        let metrics = &self.state.0.metrics;
        metrics.finished(PAGES_ROUTE, 200, self.sent_bytes, seconds);
        if let Some(access) = &self.access {
            access.log(200, self.sent_bytes, seconds);
        }
    }
}

impl HttpBody for FrontBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        match self.get_mut() {
            Self::Held(held) => {
                let slice = held.slices.next();
                held.sent_bytes += slice.as_ref().map_or(0, |slice| slice.len() as u64);
                Poll::Ready(slice.map(|slice| Ok(Frame::data(slice))))
            }
            Self::Routed(body) => Pin::new(body).poll_frame(context),
        }
    }

    fn is_end_stream(&self) -> bool {
        match self {
            Self::Held(held) => held.slices.bytes() == 0,
            Self::Routed(body) => body.is_end_stream(),
        }
    }

    fn size_hint(&self) -> SizeHint {
        match self {
            Self::Held(held) => SizeHint::with_exact(held.slices.bytes()),
            Self::Routed(body) => body.size_hint(),
        }
    }
}
