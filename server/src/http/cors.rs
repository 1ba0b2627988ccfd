//! Web pages that may show answers: those of all origins, or of the ones that the server is told.
//! Nothing here depends on a browser's own credentials, so that all origins lose nothing: who reads
//! a protected scene sends its token.

use axum::extract::{Request, State};
use axum::http::header::{
    ACCESS_CONTROL_ALLOW_HEADERS, ACCESS_CONTROL_ALLOW_METHODS, ACCESS_CONTROL_ALLOW_ORIGIN,
    ACCESS_CONTROL_EXPOSE_HEADERS, ACCESS_CONTROL_MAX_AGE, ORIGIN, VARY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::sync::Arc;

/// On every answer: a browser takes it for nothing but what it says it is.
const SNIFFS_NOT: (HeaderName, HeaderValue) =
    (X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
/// On answers where all origins may show them.
const OPEN: (HeaderName, HeaderValue) =
    (ACCESS_CONTROL_ALLOW_ORIGIN, HeaderValue::from_static("*"));
/// On them where it depends on the origin.
const VARIES: (HeaderName, HeaderValue) = (VARY, HeaderValue::from_static("origin"));
/// The fields that a page may read.
const EXPOSES: (HeaderName, HeaderValue) = (
    ACCESS_CONTROL_EXPOSE_HEADERS,
    HeaderValue::from_static("etag, content-length, content-range"),
);

/// The origins whose pages may show answers.
#[derive(Debug)]
pub struct Cors {
    /// None: all of them.
    origins: Option<Vec<HeaderValue>>,
    /// The fields of an answer to a request that has no origin.
    lines: Vec<u8>,
}

/// An origin that cannot be one.
#[derive(Debug, thiserror::Error)]
#[error(
    "expected an origin such as https://viewer.example or http://localhost:8080, found {found:?}"
)]
pub struct OriginError {
    found: String,
}

impl Default for Cors {
    fn default() -> Self {
        Self::with(None)
    }
}

impl Cors {
    /// The origins `origins` alone; `*` among them, or none at all, stands for all.
    ///
    /// # Errors
    /// Where one is no scheme, host and port, as browsers write them.
    pub fn of(origins: &[String]) -> Result<Self, OriginError> {
        if origins.is_empty() || origins.iter().any(|origin| origin == "*") {
            return Ok(Self::default());
        }
        let origins = origins.iter().map(|origin| match is_origin(origin) {
            true => HeaderValue::from_str(origin).map_err(|_| wrong(origin)),
            false => Err(wrong(origin)),
        });
        origins.collect::<Result<_, _>>().map(Some).map(Self::with)
    }

    fn with(origins: Option<Vec<HeaderValue>>) -> Self {
        let mut cors = Self {
            origins,
            lines: Vec::new(),
        };
        let mut fields = HeaderMap::new();
        cors.open(&HeaderMap::new(), &mut fields);
        for (name, value) in &fields {
            let parts = [name.as_str().as_bytes(), b": ", value.as_bytes(), b"\r\n"];
            cors.lines.extend(parts.concat());
        }
        cors
    }

    /// Whether all origins may show all answers.
    pub(super) fn is_open(&self) -> bool {
        self.origins.is_none()
    }

    /// As bytes of a head, what [`Cors::open`] adds where a request names no origin.
    pub(super) fn lines(&self) -> &[u8] {
        &self.lines
    }

    /// Opens an answer to who may show it.
    pub(super) fn open(&self, request: &HeaderMap, answer: &mut HeaderMap) {
        answer.extend([SNIFFS_NOT]);
        let Some(origins) = &self.origins else {
            return answer.extend([OPEN, EXPOSES]);
        };
        answer.append(VARIES.0, VARIES.1);
        if let Some(origin) = request
            .get(ORIGIN)
            .filter(|origin| origins.contains(origin))
        {
            answer.insert(ACCESS_CONTROL_ALLOW_ORIGIN, origin.clone());
            answer.extend([EXPOSES]);
        }
    }
}

fn wrong(origin: &str) -> OriginError {
    OriginError {
        found: origin.to_owned(),
    }
}

/// Whether it is a scheme, a host and perhaps a port in lower case, with nothing behind them.
fn is_origin(text: &str) -> bool {
    let is_name = |text: &str, more: &[u8]| {
        let takes =
            |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || more.contains(&byte);
        !text.is_empty() && text.bytes().all(takes)
    };
    text.split_once("://")
        .is_some_and(|(scheme, host)| is_name(scheme, b"+-.") && is_name(host, b"-._:[]"))
}

/// Answers preflights and opens every answer.
pub(super) async fn cors(State(cors): State<Arc<Cors>>, request: Request, next: Next) -> Response {
    let origin = request.headers().get(ORIGIN).cloned();
    let mut response = if request.method() == Method::OPTIONS {
        let headers = [
            (ACCESS_CONTROL_ALLOW_METHODS, "GET, HEAD, POST, PUT"),
            (
                ACCESS_CONTROL_ALLOW_HEADERS,
                "authorization, content-type, if-none-match, range",
            ),
            (ACCESS_CONTROL_MAX_AGE, "86400"),
        ];
        (StatusCode::NO_CONTENT, headers).into_response()
    } else {
        next.run(request).await
    };
    let asked = origin.map(|origin| (ORIGIN, origin));
    cors.open(&HeaderMap::from_iter(asked), response.headers_mut());
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn origins_are_as_browsers_write_them() {
        let of = |origin: &str| Cors::of(&[origin.to_owned()]);
        for origin in [
            "https://viewer.example",
            "http://localhost:8080",
            "http://[::1]:80",
            "capacitor://localhost",
        ] {
            assert!(of(origin).is_ok_and(|cors| !cors.is_open()), "{origin}");
        }
        for wrong in [
            "",
            "viewer.example",
            "https://",
            "https://viewer.example/",
            "https://Viewer.example",
            "https://*.example",
            "https://a, https://b",
            "null",
        ] {
            let error = of(wrong).expect_err(wrong).to_string();
            assert!(error.contains(&format!("{wrong:?}")), "{error}");
        }
        assert!(of("*").is_ok_and(|cors| cors.is_open()));
        assert!(Cors::of(&[]).is_ok_and(|cors| cors.is_open()));
    }

    #[test]
    fn only_the_origins_that_are_told_are_let_in() {
        let cors = Cors::of(&["https://a.example".to_owned()]).expect("an origin");
        for (origin, allowed) in [
            (Some("https://a.example"), true),
            (Some("https://b.example"), false),
            (Some("https://a.example:443"), false),
            (None, false),
        ] {
            let origin = origin.map(|origin| (ORIGIN, HeaderValue::from_static(origin)));
            let mut answer = HeaderMap::from_iter([(VARY, HeaderValue::from_static("x"))]);
            cors.open(&HeaderMap::from_iter(origin.clone()), &mut answer);
            let allows = answer.get(ACCESS_CONTROL_ALLOW_ORIGIN);
            assert_eq!(allows.is_some(), allowed, "{origin:?}");
            let varies: Vec<_> = answer.get_all(VARY).iter().collect();
            assert_eq!(varies, ["x", "origin"]);
            assert_eq!(answer[X_CONTENT_TYPE_OPTIONS], "nosniff");
        }
        let lines = String::from_utf8_lossy(cors.lines());
        assert!(lines.contains("vary: origin\r\n") && !lines.contains("allow-origin"));
    }
}
