//! `GET /v1/assets/{hash}/pages/{first}-{last}`: the frames of a page range, end to end, as one read of the pack.
//!
//! A plain 200 on a URL that never changes its meaning: browsers and CDNs cache it, as they do not cache 206.

use std::ops::Range;

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE, ETAG};
use axum::http::{HeaderMap, HeaderValue, Method};
use axum::response::{IntoResponse, Response};
use lodestream_format::{Asset, FormatError};

use super::AppState;
use super::body::pages_body;
use super::error::HttpError;
use super::etag::{self, IMMUTABLE};
use super::fair::Asker;
use super::limits::ClientAddress;
use super::objects::parse_hash;
use super::page_cache;

/// The route, as the router and the metrics have it.
pub(super) const PAGES_ROUTE: &str = "/v1/assets/{hash}/pages/{range}";
/// Media type of pages.
pub(super) const OCTETS: HeaderValue = HeaderValue::from_static("application/octet-stream");

/// `GET` and `HEAD /v1/assets/{hash}/pages/{first}-{last}`
pub(super) async fn pages(
    State(state): State<AppState>,
    Path((hash, range)): Path<(String, String)>,
    method: Method,
    asker: Asker,
    client: ClientAddress,
    request: HeaderMap,
) -> Result<Response, HttpError> {
    let hash = parse_hash(&hash)?;
    let (first, last) = parse_pages(&range)?;
    let asset = state.asset(client, &hash).await?;
    let bytes = bytes_of(&asset, first, last)?;
    let tag = etag::tag(format_args!("{hash}.{first}-{last}"));
    if etag::is_held(&request, &tag) {
        return Ok(etag::not_modified(tag, IMMUTABLE));
    }
    let mut headers = HeaderMap::new();
    headers.insert(CONTENT_TYPE, OCTETS);
    headers.insert(ETAG, tag);
    headers.insert(CONTENT_LENGTH, HeaderValue::from(bytes.end - bytes.start));
    let body = match method == Method::HEAD {
        true => Body::empty(),
        false => pages_body(&state, &asset, first..=last, asker).await?,
    };
    if method != Method::HEAD {
        state.0.metrics.pages_sent((last - first + 1) as u64);
    }
    Ok(([IMMUTABLE], headers, body).into_response())
}

/// Hash and range in a path of [`PAGES_ROUTE`].
pub(super) fn split(path: &str) -> Option<(&str, &str)> {
    path.strip_prefix("/v1/assets/")?.split_once("/pages/")
}

/// Where pages `first..=last` lie in the asset's pack.
pub(super) fn bytes_of(asset: &Asset, first: u32, last: u32) -> Result<Range<u64>, HttpError> {
    if last as usize >= asset.pages.len() {
        let pages = asset.pages.len().saturating_sub(1);
        let found = format!("the asset has pages 0..={pages}");
        return Err(HttpError::NotFound(found));
    }
    Ok(page_cache::bytes_of(asset, &(first..=last)))
}

/// One spelling only, so that a cache holds each range once: digits without leading zeros.
pub(super) fn parse_pages(text: &str) -> Result<(u32, u32), HttpError> {
    let number = |text: &str| {
        let plain = text == "0" || !text.starts_with(['0', '+']);
        text.parse::<u32>().ok().filter(|_| plain)
    };
    text.split_once('-')
        .and_then(|(first, last)| Some((number(first)?, number(last)?)))
        .filter(|(first, last)| first <= last)
        .ok_or_else(|| {
            let expected = "FIRST-LAST, first at most last, no leading zeros";
            HttpError::BadRequest(FormatError::new(
                "page range",
                expected,
                format!("{text:?}"),
            ))
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_has_one_spelling() {
        assert_eq!(parse_pages("0-0").ok(), Some((0, 0)));
        assert_eq!(parse_pages("3-17").ok(), Some((3, 17)));
        for bad in [
            "",
            "-",
            "1",
            "1-",
            "-1",
            "2-1",
            "01-2",
            "+1-2",
            "1-2-3",
            "a-b",
            "1 -2",
            "0-4294967296",
        ] {
            assert!(parse_pages(bad).is_err(), "{bad}");
        }
    }
}
