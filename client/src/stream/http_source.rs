//! A Lodestream server. Plain-text URLs speak HTTP/2 from the first byte, so that hundreds of fetches share one
//! connection; a proxy that knows HTTP/1 only is found out by the first request.

use std::sync::OnceLock;
use std::time::Duration;

use bytes::Bytes;
use lodestream_format::library::scene_path;
use lodestream_format::wire::{
    Block, BlockKind, BlockReader, PageStatus, PagesPost, SceneEntry, ScenesPage,
};
use lodestream_format::{ContentHash, FormatError};
use reqwest::header::{ACCEPT_ENCODING, AUTHORIZATION, HeaderMap, HeaderValue};
use reqwest::{Client, RequestBuilder, Response};

use super::error::StreamError;
use super::opened_scene::OpenParts;
use super::unpack::{self, Unpack};

/// Variable with the token of who reads scenes that need one.
const TOKEN: &str = "LODESTREAM_TOKEN";
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest silence of a server in the middle of an answer. A slow link may take longer for the whole.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(30);
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
    pub(crate) fn new(url: &str) -> Result<Self, StreamError> {
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
                .read_timeout(SILENCE_TIMEOUT)
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
        })
    }

    /// Sends what `request` makes of a client; a status other than 200 is an error.
    async fn send(
        &self,
        url: &str,
        request: impl Fn(&Client) -> RequestBuilder,
    ) -> Result<Response, StreamError> {
        let failed = |error| http_error(url, error);
        let response = match (&self.http2, self.http2_works.get()) {
            (None, _) | (_, Some(false)) => {
                request(&self.negotiated).send().await.map_err(failed)?
            }
            (Some(http2), Some(true)) => request(http2).send().await.map_err(failed)?,
            (Some(http2), None) => match request(http2).send().await {
                Ok(response) => {
                    let _ = self.http2_works.set(true);
                    response
                }
                Err(error) if error.is_connect() || error.is_timeout() => {
                    return Err(failed(error));
                }
                Err(error) => {
                    let response = request(&self.negotiated).send().await.map_err(failed)?;
                    tracing::warn!(url, %error, "no HTTP/2 without TLS; HTTP/1.1 serves, with a connection a fetch");
                    let _ = self.http2_works.set(false);
                    response
                }
            },
        };
        let status = response.status().as_u16();
        match status {
            200 => Ok(response),
            404 => Err(StreamError::NotFound {
                place: url.to_owned(),
            }),
            _ => Err(StreamError::Status {
                url: url.to_owned(),
                status,
                retry_after_secs: retry_after_secs(&response),
            }),
        }
    }

    async fn get(&self, url: &str) -> Result<Response, StreamError> {
        self.send(url, |client| client.get(url)).await
    }

    async fn get_bytes(&self, url: &str) -> Result<Bytes, StreamError> {
        let response = self.get(url).await?;
        response
            .bytes()
            .await
            .map_err(|error| http_error(url, error))
    }

    pub(crate) async fn scenes(&self) -> Result<Vec<SceneEntry>, StreamError> {
        let mut scenes: Vec<SceneEntry> = Vec::new();
        let mut url = format!("{}/v1/scenes", self.base);
        let mut last = String::new();
        loop {
            let json = self.get_bytes(&url).await?;
            let page: ScenesPage = serde_json::from_slice(&json).map_err(|error| {
                StreamError::format(&url)(FormatError::new("scenes", "their JSON", error))
            })?;
            scenes.extend(page.scenes);
            let Some(after) = page.next else {
                return Ok(scenes);
            };
            // Checked: the name goes into a URL, and pages that do not advance would never end.
            scene_path(&after).map_err(StreamError::format(&url))?;
            if after <= last {
                let expected = format!("a name after {last:?}");
                let error = FormatError::new("next", expected, &after);
                return Err(StreamError::format(&url)(error));
            }
            url = format!("{}/v1/scenes?after={after}", self.base);
            last = after;
        }
    }

    pub(crate) async fn open(&self, scene: &str) -> Result<OpenParts, StreamError> {
        scene_path(scene).map_err(StreamError::format("open"))?;
        let url = format!("{}/v1/scenes/{scene}/open", self.base);
        // Half of it is hierarchies, which are stored as they are.
        let request = |client: &Client| client.get(&url).header(ACCEPT_ENCODING, unpack::ZSTD);
        for wait in OPEN_AGAIN {
            let response = self.send(&url, request).await?;
            match Self::read_open(&url, response).await {
                // The server went while it answered: another one may stand behind the same name.
                Err(error @ StreamError::Http { .. }) => {
                    tracing::info!(%error, ?wait, "asking again");
                    tokio::time::sleep(wait).await;
                }
                read => return read,
            }
        }
        let response = self.send(&url, request).await?;
        Self::read_open(&url, response).await
    }

    async fn read_open(url: &str, response: Response) -> Result<OpenParts, StreamError> {
        let mut parts = OpenParts::default();
        parts.read_bytes = read_blocks(url, response, |block| {
            let payload = Bytes::from(block.payload);
            match block.kind {
                BlockKind::Scene => {
                    parts.scene = Some(block.hash);
                    parts.objects.insert(block.hash, payload);
                }
                BlockKind::Asset | BlockKind::Hierarchy => {
                    parts.objects.insert(block.hash, payload);
                }
                BlockKind::RootPages => {
                    parts.root_pages.insert(block.hash, payload);
                }
                BlockKind::Page | BlockKind::End => {}
            }
        })
        .await?;
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
        let response = self.get(&url).await?;
        let wrong = |found_bytes| StreamError::Length {
            place: url.clone(),
            expected_bytes,
            found_bytes,
        };
        // A server that ignores the range is left before it sends a gigabyte.
        if let Some(announced) = response.content_length()
            && announced != expected_bytes
        {
            return Err(wrong(announced));
        }
        let mut bytes = Vec::with_capacity(expected_bytes as usize);
        read_chunks(&url, response, |chunk| {
            bytes.extend_from_slice(&chunk);
            match bytes.len() as u64 > expected_bytes {
                true => Err(wrong(bytes.len() as u64)),
                false => Ok(()),
            }
        })
        .await?;
        match bytes.len() as u64 == expected_bytes {
            true => Ok(Bytes::from(bytes)),
            false => Err(wrong(bytes.len() as u64)),
        }
    }

    pub(crate) async fn post_pages(
        &self,
        post: &PagesPost,
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
        let response = self.send(&url, request).await?;
        read_blocks(&url, response, |block| {
            if block.kind == BlockKind::Page {
                take(PageAnswer {
                    asset: block.hash,
                    page: block.page,
                    frame: frame_of(&url, block),
                });
            }
        })
        .await?;
        Ok(())
    }

    pub(crate) async fn object(&self, hash: &ContentHash) -> Result<Bytes, StreamError> {
        let url = format!("{}/v1/objects/{hash}", self.base);
        self.get_bytes(&url).await
    }
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

/// Calls `take` with every block; gives the bytes of the whole answer, as they came.
async fn read_blocks(
    url: &str,
    response: Response,
    mut take: impl FnMut(Block),
) -> Result<u64, StreamError> {
    let wrong = |error| StreamError::format(url)(error);
    let mut unpack = Unpack::of(response.headers()).map_err(wrong)?;
    let mut reader = BlockReader::default();
    let mut bytes = 0;
    read_chunks(url, response, |chunk| {
        bytes += chunk.len() as u64;
        let unpacked = unpack.push(&chunk, |bytes| reader.push(bytes));
        unpacked.map_err(wrong)?;
        while let Some(block) = reader.next_block().map_err(wrong)? {
            take(block);
        }
        Ok(())
    })
    .await?;
    if reader.is_ended() {
        return Ok(bytes);
    }
    Err(StreamError::Http {
        url: url.to_owned(),
        found: "no end block".to_owned(),
    })
}

async fn read_chunks(
    url: &str,
    mut response: Response,
    mut take: impl FnMut(Bytes) -> Result<(), StreamError>,
) -> Result<(), StreamError> {
    while let Some(chunk) = response
        .chunk()
        .await
        .map_err(|error| http_error(url, error))?
    {
        take(chunk)?;
    }
    Ok(())
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

/// The innermost reason says what happened; the outer ones repeat the URL.
fn http_error(url: &str, error: reqwest::Error) -> StreamError {
    let mut reason: &dyn std::error::Error = &error;
    while let Some(source) = reason.source() {
        reason = source;
    }
    StreamError::Http {
        url: url.to_owned(),
        found: reason.to_string(),
    }
}
