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
use axum::http::header::{CACHE_CONTROL, CONTENT_LENGTH, CONTENT_TYPE, ETAG, IF_NONE_MATCH};
use axum::http::{HeaderMap, HeaderValue, Method, Request, Response};
use axum::response::IntoResponse;
use bytes::Bytes;
use futures_util::future::{Either, Ready, ready};
use hyper::body::{Frame, Incoming, SizeHint};
use hyper::service::Service;
use hyper_util::service::TowerToHyperService;

use super::error::HttpError;
use super::etag::IMMUTABLE;
use super::limits::Connected;
use super::page_cache::Slices;
use super::pages::{OCTETS, PAGES_ROUTE, parse_pages};
use super::{AppState, cors, router};

/// The service of every connection.
#[derive(Debug, Clone)]
pub(super) struct Front {
    state: AppState,
    router: TowerToHyperService<Router>,
    client: Option<Arc<Connected>>,
}

type Answered = Result<Response<FrontBody>, Infallible>;

impl Front {
    pub(super) fn new(state: AppState) -> Self {
        Self {
            router: TowerToHyperService::new(router(state.clone())),
            state,
            client: None,
        }
    }

    /// The service of one client's connection.
    pub(super) fn of(&self, client: Connected) -> Self {
        Self {
            client: Some(Arc::new(client)),
            ..self.clone()
        }
    }

    /// That the client asks too often; whoever watches over the server may always ask whether it is well.
    fn refused(&self, request: &Request<Incoming>) -> Option<Response<FrontBody>> {
        let secs = self.client.as_ref()?.request().err()?;
        if matches!(request.uri().path(), "/healthz" | "/readyz") {
            return None;
        }
        let metrics = &self.state.0.metrics;
        metrics.began();
        metrics.finished("limited", 429, 0, 0.0);
        let mut response = HttpError::TooMany { secs }.into_response();
        cors::open(response.headers_mut());
        Some(response.map(FrontBody::Routed))
    }

    /// The answer, where all of it is in memory and the request asks for nothing but the pages.
    fn held(&self, request: &Request<Incoming>) -> Option<Response<FrontBody>> {
        let started = Instant::now();
        if request.method() != Method::GET || request.headers().contains_key(IF_NONE_MATCH) {
            return None;
        }
        let path = request.uri().path().strip_prefix("/v1/assets/")?;
        let (hash, range) = path.split_once("/pages/")?;
        let (first, last) = parse_pages(range).ok()?;
        let shared = &self.state.0;
        let asset = shared.tables.held(&hash.parse().ok()?)?;
        let (begin, end) = (
            asset.pages.get(first as usize)?,
            asset.pages.get(last as usize)?,
        );
        let bytes = begin.offset..end.offset + end.bytes as u64;
        let slices = shared.pages.held(&asset.pack, bytes)?;
        // Written as it is parsed: the path is the tag.
        let tag = [b"\"", hash.as_bytes(), b".", range.as_bytes(), b"\""].concat();
        let mut headers = HeaderMap::with_capacity(8);
        headers.insert(CONTENT_TYPE, OCTETS);
        headers.insert(ETAG, HeaderValue::from_maybe_shared(Bytes::from(tag)).ok()?);
        headers.insert(CONTENT_LENGTH, HeaderValue::from(slices.bytes()));
        headers.insert(CACHE_CONTROL, HeaderValue::from_static(IMMUTABLE.1));
        cors::open(&mut headers);
        shared.metrics.pages_sent((last - first + 1) as u64);
        shared.metrics.began();
        let mut response = Response::new(FrontBody::Held(HeldBody {
            state: self.state.clone(),
            sent_bytes: 0,
            started,
            slices,
        }));
        *response.headers_mut() = headers;
        Some(response)
    }
}

impl Service<Request<Incoming>> for Front {
    type Response = Response<FrontBody>;
    type Error = Infallible;
    type Future = Either<Ready<Answered>, Pin<Box<dyn Future<Output = Answered> + Send>>>;

    fn call(&self, request: Request<Incoming>) -> Self::Future {
        if let Some(response) = self.refused(&request).or_else(|| self.held(&request)) {
            return Either::Left(ready(Ok(response)));
        }
        let routed = self.router.call(request);
        Either::Right(Box::pin(
            async move { Ok(routed.await?.map(FrontBody::Routed)) },
        ))
    }
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
    slices: Slices,
    sent_bytes: u64,
    started: Instant,
}

impl Drop for HeldBody {
    fn drop(&mut self) {
        let seconds = self.started.elapsed().as_secs_f64();
        let metrics = &self.state.0.metrics;
        metrics.finished(PAGES_ROUTE, 200, self.sent_bytes, seconds);
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
