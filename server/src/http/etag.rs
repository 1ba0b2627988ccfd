//! Entity tags and what depends on them.

use axum::http::header::{ETAG, IF_NONE_MATCH};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};

use super::error::header;

/// `"text"` as a strong tag.
pub(super) fn tag(text: impl std::fmt::Display) -> HeaderValue {
    header(&format!("\"{text}\""))
}

/// Whether the client holds what `tag` names (RFC 9110, 13.1.2: weak comparison over a list, or `*`).
pub(super) fn is_held(request: &HeaderMap, tag: &HeaderValue) -> bool {
    let opaque = |text: &str| text.trim().trim_start_matches("W/").to_owned();
    let own = tag.to_str().map(opaque).unwrap_or_default();
    request
        .get_all(IF_NONE_MATCH)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .any(|held| held.trim() == "*" || opaque(held) == own)
}

/// 304 with the headers that a 200 would carry for caches.
pub(super) fn not_modified(
    tag: HeaderValue,
    cache_control: (&'static str, &'static str),
) -> Response {
    (StatusCode::NOT_MODIFIED, [cache_control], [(ETAG, tag)]).into_response()
}

/// What never changes under its URL.
pub(super) const IMMUTABLE: (&str, &str) = ("cache-control", "public, max-age=31536000, immutable");
/// What has to be asked for again each time.
pub(super) const REVALIDATE: (&str, &str) = ("cache-control", "no-cache");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_weak_tags_and_the_star_match() {
        let own = tag("abc");
        for (value, held) in [
            ("\"abc\"", true),
            ("W/\"abc\"", true),
            ("\"x\", \"abc\"", true),
            ("*", true),
            ("\"abcd\"", false),
            ("abc", false),
            ("", false),
        ] {
            let mut request = HeaderMap::new();
            request.insert(IF_NONE_MATCH, HeaderValue::from_static(value));
            assert_eq!(is_held(&request, &own), held, "{value}");
        }
    }
}
