//! Page ranges over HTTP/1.1, from the socket to the socket: read a head, look the pages up, write head and pages with one call. That is
//! nearly all that a server is asked over HTTP/1.1, by viewers as by the caches in front of it, and a general HTTP library costs more
//! there than everything else outside the kernel. The first request for anything else, and all after it on that connection, is hyper's;
//! `tests/http_cache.rs` holds the answers of the two against each other.

use std::cell::RefCell;
use std::future::{Future, poll_fn};
use std::io::{self, Write};
use std::ops::RangeInclusive;
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use axum::http::{HeaderMap, HeaderValue, StatusCode};
use bytes::Bytes;
use lodestream_format::Asset;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};

use super::body::is_small;
use super::error::HttpError;
use super::error_log;
use super::etag::IMMUTABLE;
use super::front::{Front, is_host};
use super::objects::parse_hash;
use super::page_cache::runs;
use super::pages::{self, PAGES_ROUTE};
use super::requests::{REQUEST_ID, new_id};
use super::send::Body;
use super::socket::{OverTcp, PREFACE, Socket};

/// Longest head that is read here; those of viewers have some 150 bytes.
const HEAD_BYTES: usize = 2048;
/// Most header fields of it.
const MAX_FIELDS: usize = 32;
/// What every request that is answered here begins with.
const BEGIN: &[u8] = b"GET /v1/assets/";

/// Answers requests for pages until something else comes: what was read of that, or nothing where the connection is over.
pub(super) async fn serve<S: OverTcp + AsyncRead + AsyncWrite + Unpin>(
    socket: &mut Socket<S>,
    front: &Front,
    head_timeout: Duration,
) -> io::Result<Option<Bytes>> {
    let state = front.state();
    let mut draining = state.draining();
    let mut drained = pin!(draining.wait_for(|&draining| draining));
    let mut read = Vec::with_capacity(HEAD_BYTES);
    let mut head = Vec::with_capacity(512);
    socket.read_within(head_timeout, usize::MAX);
    let activity = front.activity();
    loop {
        let asked = match asked(&read) {
            Read::Pages(asked) if takes(front, &asked) => asked,
            Read::Part if read.len() < HEAD_BYTES => {
                let mut more = pin!(socket.read_buf(&mut read));
                let more = poll_fn(|context| match more.as_mut().poll(context) {
                    Poll::Ready(bytes) => Poll::Ready(bytes),
                    // Nothing is in flight: a server that stops does not wait for this client.
                    Poll::Pending => drained.as_mut().poll(context).map(|_| Ok(0)),
                });
                match more.await? {
                    0 => return Ok(None),
                    _ => continue,
                }
            }
            _ => return Ok(Some(Bytes::from(read))),
        };
        activity.set_busy();
        let started = Instant::now();
        let last = asked.last || state.is_draining();
        let head_bytes = asked.head_bytes;
        state.0.metrics.began();
        let is_plain = socket.stream().plain().is_some();
        let mut answer = Answer::new(front, &asked, is_plain).await;
        answer.write_head(&mut head, front, &asked, last);
        let sent = answer.send(socket, front, &head).await;
        answer.finished(front, asked.path, started.elapsed().as_secs_f64());
        sent?;
        if last {
            return socket.shutdown().await.map(|()| None);
        }
        read.drain(..head_bytes);
        activity.set_idle(socket.read_within(head_timeout, usize::MAX));
    }
}

/// What has been read of a connection.
enum Read<'a> {
    /// The beginning of a head.
    Part,
    Pages(Asked<'a>),
    /// Anything else, also what is no HTTP.
    Other,
}

/// A request for pages.
struct Asked<'a> {
    path: &'a str,
    hash: &'a str,
    range: &'a str,
    head_bytes: usize,
    /// The client wants no other answer on this connection.
    last: bool,
    /// The request is a page's of another origin.
    has_origin: bool,
}

/// Whether the answer depends on nothing but the pages.
fn takes(front: &Front, asked: &Asked<'_>) -> bool {
    let is_alike = !asked.has_origin || front.cors().is_open();
    is_alike && front.serves_pages() && !front.is_limited()
}

fn asked(read: &[u8]) -> Read<'_> {
    let known = read.len().min(BEGIN.len());
    if read[..known] != BEGIN[..known] {
        // Nothing but the whole preface tells HTTP/2 from what only begins so.
        return match PREFACE.starts_with(read) && read != PREFACE {
            true => Read::Part,
            false => Read::Other,
        };
    }
    let mut fields = [httparse::EMPTY_HEADER; MAX_FIELDS];
    let mut request = httparse::Request::new(&mut fields);
    let head_bytes = match request.parse(read) {
        Ok(httparse::Status::Complete(bytes)) => bytes,
        Ok(httparse::Status::Partial) => return Read::Part,
        Err(_) => return Read::Other,
    };
    let path = request.path.unwrap_or_default();
    let Some((hash, range)) = pages::split(path).filter(|_| !path.contains(['%', '?', '#'])) else {
        return Read::Other;
    };
    let (mut hosts, mut last, mut has_origin) = (0, false, false);
    for field in request.headers.iter() {
        let is = |name: &str| field.name.eq_ignore_ascii_case(name);
        if is("host") && is_host(field.value) {
            hosts += 1;
        } else if is("connection") && field.value.eq_ignore_ascii_case(b"close") {
            last = true;
        } else if is("origin") {
            has_origin = true;
        } else if is("connection") && !field.value.eq_ignore_ascii_case(b"keep-alive")
            || is("host")
            || CHANGES.iter().any(|name| is(name))
        {
            return Read::Other;
        }
    }
    match request.version == Some(1) && hosts == 1 {
        true => Read::Pages(Asked {
            path,
            hash,
            range,
            head_bytes,
            last,
            has_origin,
        }),
        false => Read::Other,
    }
}

/// Fields that make a request more than a GET of pages.
const CHANGES: [&str; 6] = [
    "if-none-match",
    "content-length",
    "transfer-encoding",
    "expect",
    "upgrade",
    "x-request-id",
];

/// What is said to a request.
struct Answer {
    status: StatusCode,
    /// Fields that only errors have.
    fields: HeaderMap,
    /// What goes out with the head, and the pages that come after it.
    begin: Body,
    rest: Option<(Arc<Asset>, Runs)>,
    bytes: u64,
    sent_bytes: u64,
    id: Option<HeaderValue>,
}

type Runs = Box<dyn Iterator<Item = RangeInclusive<u32>> + Send>;

impl Answer {
    /// The pages, the first ones of them in memory, or why there are none.
    async fn new(front: &Front, asked: &Asked<'_>, is_plain: bool) -> Self {
        match Self::pages(front, asked, is_plain).await {
            Ok(answer) => answer,
            Err(error) => {
                let id = new_id();
                let span = tracing::error_span!("request", id = id.to_str().unwrap_or_default());
                let (status, mut fields, text) = span.in_scope(|| error.parts());
                fields.insert(REQUEST_ID, id.clone());
                Self {
                    status,
                    fields,
                    bytes: text.len() as u64,
                    begin: Body::from(text),
                    rest: None,
                    sent_bytes: 0,
                    id: Some(id),
                }
            }
        }
    }

    async fn pages(front: &Front, asked: &Asked<'_>, is_plain: bool) -> Result<Self, HttpError> {
        let shared = &front.state().0;
        let hash = parse_hash(asked.hash)?;
        let (first, last) = pages::parse_pages(asked.range)?;
        let asset = front.state().asset(front.client(), &hash).await?;
        let bytes = pages::bytes_of(&asset, first, last)?;
        let mut answer = Self {
            status: StatusCode::OK,
            fields: HeaderMap::new(),
            begin: Body::default(),
            rest: None,
            bytes: bytes.end - bytes.start,
            sent_bytes: 0,
            id: None,
        };
        let mut run = first..=last;
        if !is_small(answer.bytes) {
            let mut runs = runs(&asset, run.clone());
            run = runs.next().unwrap_or(run);
            answer.rest = Some((Arc::clone(&asset), Box::new(runs)));
        }
        answer.begin = Body::of_pages(front, &asset, run, is_plain).await?;
        shared.metrics.pages_sent((last - first + 1) as u64);
        Ok(answer)
    }

    /// Writes the head over `head`.
    fn write_head(&self, head: &mut Vec<u8>, front: &Front, asked: &Asked<'_>, last: bool) {
        head.clear();
        let mut line = |parts: &[&[u8]]| parts.iter().for_each(|part| head.extend_from_slice(part));
        if self.status == StatusCode::OK {
            line(&[b"HTTP/1.1 200 OK\r\ncontent-type: application/octet-stream\r\netag: \""]);
            line(&[
                asked.hash.as_bytes(),
                b".",
                asked.range.as_bytes(),
                b"\"\r\n",
            ]);
            line(&[
                IMMUTABLE.0.as_bytes(),
                b": ",
                IMMUTABLE.1.as_bytes(),
                b"\r\n",
            ]);
        } else {
            let reason = self
                .status
                .canonical_reason()
                .unwrap_or_default()
                .as_bytes();
            line(&[
                b"HTTP/1.1 ",
                self.status.as_str().as_bytes(),
                b" ",
                reason,
                b"\r\n",
            ]);
            for (name, value) in &self.fields {
                line(&[name.as_str().as_bytes(), b": ", value.as_bytes(), b"\r\n"]);
            }
        }
        line(&[front.cors().lines()]);
        line(&[if last { b"connection: close\r\n" } else { b"" }]);
        // Writing to a vector cannot fail.
        let _ = write!(head, "content-length: {}\r\ndate: ", self.bytes);
        push_date(head);
        head.extend_from_slice(b"\r\n\r\n");
    }

    /// Sends head and pages, run by run; a run that fails cuts the connection, for the status is out by then.
    async fn send<S: OverTcp + AsyncRead + AsyncWrite + Unpin>(
        &mut self,
        socket: &mut Socket<S>,
        front: &Front,
        head: &[u8],
    ) -> io::Result<()> {
        let begin = std::mem::take(&mut self.begin);
        self.sent_bytes = begin.bytes();
        begin.send(socket, head).await?;
        let Some((asset, runs)) = self.rest.take() else {
            return Ok(());
        };
        let is_plain = socket.stream().plain().is_some();
        for run in runs {
            let pages = Body::of_pages(front, &asset, run, is_plain)
                .await
                .map_err(|error| {
                    error_log::cut_short(&error);
                    io::Error::other(error)
                })?;
            let bytes = pages.bytes();
            pages.send(socket, b"").await?;
            self.sent_bytes += bytes;
        }
        Ok(())
    }

    fn finished(&self, front: &Front, path: &str, seconds: f64) {
        let metrics = &front.state().0.metrics;
        metrics.finished(PAGES_ROUTE, self.status.as_u16(), self.sent_bytes, seconds);
        let id = self.id.as_ref().and_then(|id| id.to_str().ok());
        if let Some(access) = front.access(path, id.unwrap_or_default()) {
            access.log(self.status.as_u16(), self.sent_bytes, seconds);
        }
    }
}

/// The time, as RFC 9110 wants it; made once a second.
fn push_date(head: &mut Vec<u8>) {
    thread_local!(static DATE: RefCell<(u64, String)> = const { RefCell::new((0, String::new())) });
    let now = SystemTime::now();
    let secs = now
        .duration_since(UNIX_EPOCH)
        .map_or(0, |since| since.as_secs());
    DATE.with_borrow_mut(|(at, text)| {
        if *at != secs || text.is_empty() {
            (*at, *text) = (secs, httpdate::fmt_http_date(now));
        }
        head.extend_from_slice(text.as_bytes());
    });
}
