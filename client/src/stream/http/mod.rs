//! A Lodestream server. Plain-text URLs speak HTTP/2 from the first byte, so that hundreds of
//! fetches share one connection; a proxy that knows HTTP/1 only is found out by the first request.

mod answer;
mod asked;
mod pace;
mod unpack;

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use bytes::Bytes;
use lodestream_format::library::scene_path;
use lodestream_format::wire::{Block, BlockEvent, PageStatus, PagesPost, SceneEntry, ScenesPage};
use lodestream_format::{ContentHash, FormatError};
use reqwest::header::{ACCEPT_ENCODING, AUTHORIZATION, HeaderMap, HeaderValue, LOCATION};
use reqwest::{Client, RequestBuilder, Response, redirect};

use self::answer::{Answer, http_error};
use self::asked::Asked;
use self::pace::{Link, Pace};
use super::error::StreamError;
use super::limits::StreamLimits;
use super::open_parts::OpenParts;
use super::opened_scene::OpenedAsset;
use super::source::blocking;

/// Variable with the token of who reads scenes that need one.
const TOKEN: &str = "LODESTREAM_TOKEN";
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// Scenes asked for at once.
const LIST_PAGE_SCENES: u32 = 1000;
/// Most bytes of one page of the list of scenes; servers send a tenth of it.
const LIST_PAGE_BYTES: u64 = 4 << 20;
/// Most bytes of the whole list, a fifth of a million scenes.
const LIST_BYTES: u64 = 64 << 20;
/// A page of the list counts for at least so many: empty ones would never end.
const LEAST_LIST_PAGE_BYTES: u64 = 64 << 10;
/// Waits before a scene is asked for again whose answer broke off.
const OPEN_AGAIN: [Duration; 2] = [Duration::from_millis(200), Duration::from_millis(800)];
/// A window of this much keeps 1 Gbps at 200 ms busy.
const CONNECTION_WINDOW_BYTES: u32 = 32 << 20;
const STREAM_WINDOW_BYTES: u32 = 4 << 20;

#[derive(Debug)]
pub(crate) struct HttpSource {
    base: String,
    /// Without HTTP/2 by prior knowledge; over TLS the handshake agrees on the version.
    negotiated: Client,
    /// With it, for plain-text URLs.
    http2: Option<Client>,
    /// Whether HTTP/2 by prior knowledge works; known after the first answer.
    http2_works: OnceLock<bool>,
    limits: StreamLimits,
    link: Arc<Link>,
}

/// How the post for one page went.
#[derive(Debug, Clone, PartialEq)]
pub struct PageAnswer {
    /// The asset.
    pub asset: ContentHash,
    /// The page in it.
    pub page: u32,
    /// Its frame, not yet checked.
    pub frame: Result<Bytes, StreamError>,
}

impl HttpSource {
    pub(crate) fn new(url: &str, limits: &StreamLimits) -> Result<Self, StreamError> {
        let wrong = |found: String| StreamError::Location {
            location: url.to_owned(),
            found,
        };
        let plain = url.starts_with("http://");
        if !plain && !url.starts_with("https://") {
            return Err(wrong("another scheme".to_owned()));
        }
        reqwest::Url::parse(url).map_err(|error| wrong(error.to_string()))?;
        let token = token().map_err(|found| wrong(found.to_owned()))?;
        // Fails where a provider is installed already, which then serves.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let builder = || {
            Client::builder()
                .connect_timeout(CONNECT_TIMEOUT)
                // The token is for this server alone.
                .redirect(redirect::Policy::none())
                .default_headers(token.clone())
                .http2_initial_connection_window_size(CONNECTION_WINDOW_BYTES)
                .http2_initial_stream_window_size(STREAM_WINDOW_BYTES)
                .tcp_nodelay(true)
        };
        let wrong = |error: reqwest::Error| wrong(error.to_string());
        let http2 = plain.then(|| builder().http2_prior_knowledge().build());
        Ok(Self {
            base: url.trim_end_matches('/').to_owned(),
            negotiated: builder().build().map_err(wrong)?,
            http2: http2.transpose().map_err(wrong)?,
            http2_works: OnceLock::new(),
            limits: *limits,
            link: Arc::default(),
        })
    }

    /// Sends what `request` makes of a client; a status other than 200 is an error.
    async fn send<'a>(
        &self,
        url: &'a str,
        request: impl Fn(&Client) -> RequestBuilder,
    ) -> Result<Answer<'a>, StreamError> {
        let mut pace = Pace::new(&self.link, &self.limits);
        let response = pace.keep(url, self.respond(url, request)).await??;
        let status = response.status();
        match status.as_u16() {
            200 => Ok(Answer {
                url,
                response,
                pace,
            }),
            404 => Err(StreamError::NotFound {
                place: url.to_owned(),
            }),
            status if (300..400).contains(&status) => Err(StreamError::Redirect {
                url: url.to_owned(),
                status,
                to: location(&response),
            }),
            status => Err(StreamError::Status {
                url: url.to_owned(),
                status,
                retry_after_secs: retry_after_secs(&response),
            }),
        }
    }

    async fn respond(
        &self,
        url: &str,
        request: impl Fn(&Client) -> RequestBuilder,
    ) -> Result<Response, StreamError> {
        let failed = |error| http_error(url, error);
        match (&self.http2, self.http2_works.get()) {
            (None, _) | (_, Some(false)) => request(&self.negotiated).send().await.map_err(failed),
            (Some(http2), Some(true)) => request(http2).send().await.map_err(failed),
            (Some(http2), None) => match request(http2).send().await {
                Ok(response) => {
                    let _ = self.http2_works.set(true);
                    Ok(response)
                }
                Err(error) if error.is_timeout() => Err(failed(error)),
                Err(error) => {
                    let response = request(&self.negotiated).send().await.map_err(failed)?;
                    // A request that waited for another's connection fails with it, as if no
                    // connection were to be had: it tells nothing of HTTP/2.
                    if !error.is_connect() {
                        tracing::warn!(url, %error, "no HTTP/2 without TLS; HTTP/1.1 serves, with a connection a fetch");
                        let _ = self.http2_works.set(false);
                    }
                    Ok(response)
                }
            },
        }
    }

    async fn get<'a>(&self, url: &'a str) -> Result<Answer<'a>, StreamError> {
        self.send(url, |client| client.get(url)).await
    }

    pub(crate) async fn scenes(&self) -> Result<Vec<SceneEntry>, StreamError> {
        let mut scenes: Vec<SceneEntry> = Vec::new();
        let list = format!("{}/v1/scenes?limit={LIST_PAGE_SCENES}", self.base);
        let mut url = list.clone();
        let mut last = String::new();
        let mut list_bytes = 0;
        loop {
            let json = self.get(&url).await?.at_most(LIST_PAGE_BYTES).await?;
            let wrong = |error| StreamError::format(&url)(error);
            list_bytes += (json.len() as u64).max(LEAST_LIST_PAGE_BYTES);
            if list_bytes > LIST_BYTES {
                let expected = format!("at most {LIST_BYTES} bytes");
                let found = format!("more, with {} scenes so far", scenes.len());
                return Err(wrong(FormatError::new("scenes", expected, found)));
            }
            let page: ScenesPage = serde_json::from_slice(&json)
                .map_err(|error| wrong(FormatError::new("scenes", "their JSON", error)))?;
            // Names go into URLs and before users, and pages that do not advance would never end.
            for name in page
                .scenes
                .iter()
                .map(|scene| &scene.name)
                .chain(&page.next)
            {
                scene_path(name).map_err(wrong)?;
            }
            scenes.extend(page.scenes);
            let Some(after) = page.next else {
                return Ok(scenes);
            };
            if after <= last {
                let expected = format!("a name after {last:?}");
                return Err(wrong(FormatError::new("next", expected, &after)));
            }
            url = format!("{list}&after={after}");
            last = after;
        }
    }

    pub(crate) async fn open(&self, scene: &str) -> Result<OpenParts, StreamError> {
        scene_path(scene).map_err(StreamError::format("open"))?;
        let url = format!("{}/v1/scenes/{scene}/open", self.base);
        for wait in OPEN_AGAIN {
            match self.open_once(&url).await {
                // The server went while it answered: another one may stand behind the same name.
                Err(Broken::InAnswer(error @ StreamError::Http { .. })) => {
                    tracing::info!(%error, ?wait, "asking again");
                    tokio::time::sleep(wait).await;
                }
                read => return read.map_err(Broken::into_error),
            }
        }
        self.open_once(&url).await.map_err(Broken::into_error)
    }

    async fn open_once(&self, url: &str) -> Result<OpenParts, Broken> {
        // Half of it is hierarchies, which are stored as they are.
        let request = |client: &Client| client.get(url).header(ACCEPT_ENCODING, unpack::ZSTD);
        let answer = self.send(url, request).await.map_err(Broken::Before)?;
        self.read_open(answer).await.map_err(Broken::InAnswer)
    }

    async fn read_open(&self, answer: Answer<'_>) -> Result<OpenParts, StreamError> {
        let mut parts = OpenParts::new(self.limits.open_memory_bytes);
        let mut blocks = answer.blocks()?;
        while let Some(event) = blocks.next_event().await? {
            match event {
                BlockEvent::Announced(header) => parts.announced(&header)?,
                BlockEvent::Whole(block) => {
                    // Hashing and reading take their time.
                    let taken = move || parts.take(block).map(|()| parts);
                    parts = blocking(taken).await?;
                }
            }
        }
        parts.read_bytes = blocks.read_bytes;
        Ok(parts)
    }

    pub(crate) async fn pages(
        &self,
        asset: &ContentHash,
        first: u32,
        last: u32,
        expected_bytes: u64,
    ) -> Result<Bytes, StreamError> {
        let url = format!("{}/v1/assets/{asset}/pages/{first}-{last}", self.base);
        self.get(&url).await?.exactly(expected_bytes).await
    }

    pub(crate) async fn post_pages(
        &self,
        post: &PagesPost,
        assets: &[OpenedAsset],
        mut take: impl FnMut(PageAnswer),
    ) -> Result<(), StreamError> {
        let url = format!("{}/v1/pages", self.base);
        let body = serde_json::to_vec(post).map_err(|error| {
            StreamError::format(&url)(FormatError::new("post", "to encode", error))
        })?;
        let body = Bytes::from(body);
        let request = |client: &Client| {
            client
                .post(&url)
                .header("content-type", "application/json")
                .body(body.clone())
        };
        let mut asked = Asked::new(post, assets);
        let mut blocks = self.send(&url, request).await?.blocks()?;
        while let Some(event) = blocks.next_event().await? {
            match event {
                BlockEvent::Announced(header) => asked
                    .announced(&header)
                    .map_err(StreamError::format(&url))?,
                BlockEvent::Whole(block) => take(PageAnswer {
                    asset: block.hash,
                    page: block.page,
                    frame: frame_of(&url, block),
                }),
            }
        }
        Ok(())
    }

    pub(crate) async fn object(
        &self,
        hash: &ContentHash,
        most_bytes: u64,
    ) -> Result<Bytes, StreamError> {
        let url = format!("{}/v1/objects/{hash}", self.base);
        self.get(&url).await?.at_most(most_bytes).await
    }
}

/// How an opening failed: only an answer that broke off is asked for again.
enum Broken {
    Before(StreamError),
    InAnswer(StreamError),
}

impl Broken {
    fn into_error(self) -> StreamError {
        match self {
            Self::Before(error) | Self::InAnswer(error) => error,
        }
    }
}

/// Where a redirect leads, as far as it can be printed.
fn location(response: &Response) -> String {
    let field = response.headers().get(LOCATION);
    let mut to = field.map_or(String::new(), |to| to.as_bytes().escape_ascii().to_string());
    to.truncate(unpack::QUOTED_BYTES);
    to
}

fn frame_of(url: &str, block: Block) -> Result<Bytes, StreamError> {
    let place = || format!("{url} page {} of asset {}", block.page, block.hash);
    match block.status {
        PageStatus::Ok => Ok(Bytes::from(block.payload)),
        PageStatus::NotFound => Err(StreamError::NotFound { place: place() }),
        PageStatus::Failed => Err(StreamError::Http {
            url: place(),
            found: "a failure of the store".to_owned(),
        }),
    }
}

fn retry_after_secs(response: &Response) -> Option<f64> {
    let header = response.headers().get("retry-after")?.to_str().ok()?;
    let secs: f64 = header.trim().parse().ok()?;
    (secs.is_finite() && secs >= 0.0).then_some(secs)
}

/// The field that says who asks, from [`TOKEN`].
fn token() -> Result<HeaderMap, &'static str> {
    let mut fields = HeaderMap::new();
    if let Ok(token) = std::env::var(TOKEN) {
        let value = HeaderValue::from_str(&format!("Bearer {token}"));
        let mut value = value.map_err(|_| "LODESTREAM_TOKEN with bytes that no header takes")?;
        value.set_sensitive(true);
        fields.insert(AUTHORIZATION, value);
    }
    Ok(fields)
}
