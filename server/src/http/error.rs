//! The one table from errors to statuses, and the text that a client sees: never what lies behind the server.

use axum::http::header::{
    ALLOW, CACHE_CONTROL, CONTENT_RANGE, CONTENT_TYPE, RETRY_AFTER, WWW_AUTHENTICATE,
};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use lodestream_format::FormatError;

use super::error_log;
use crate::library::LibraryError;

/// Media type of every text answer.
pub(super) const TEXT: HeaderValue = HeaderValue::from_static("text/plain; charset=utf-8");

/// Why a request has no better answer.
#[derive(Debug, thiserror::Error)]
pub(super) enum HttpError {
    /// The request is not what the route takes.
    #[error("{0}")]
    BadRequest(FormatError),
    /// A condition that no scene can meet.
    #[error("{0}")]
    Precondition(FormatError),
    /// No such route, scene, object or page.
    #[error("{0}")]
    NotFound(String),
    /// The route exists for other methods.
    #[error("this route takes other methods")]
    WrongMethod,
    /// No token, or none that is known.
    #[error("expected `Authorization: Bearer TOKEN` with a token that this server knows")]
    NoToken,
    /// A token that is known, for other scenes. It says nothing of whether this one is there.
    #[error("expected a token for this scene, found one for others")]
    OtherScenes,
    /// A scene is not what it should be replaced as, told to who may read it.
    #[error("scene {name}: expected to replace {expected}, found {found}")]
    Replaced {
        /// The scene.
        name: String,
        /// The hash that it should have pointed at, or none.
        expected: String,
        /// The hash that it points at, or none.
        found: String,
    },
    /// The server takes no uploads.
    #[error("this server takes no uploads")]
    NoUploads,
    /// An input of no kind that is known.
    #[error("{0}")]
    UnknownKind(FormatError),
    /// The server has no room for what was sent.
    #[error("no room for what was sent")]
    Full,
    /// The body did not come in time.
    #[error("the body did not come in time")]
    Slow,
    /// The client asks more often than it may.
    #[error("too many requests; the next one is answered in {secs} s")]
    TooMany {
        /// Seconds until the next one is answered.
        secs: u64,
    },
    /// The request asks for more than one answer gives.
    #[error("{0}")]
    TooLarge(FormatError),
    /// No byte of the object lies in the range.
    #[error("the object has {bytes} bytes")]
    OutsideObject {
        /// Bytes of the object.
        bytes: u64,
    },
    /// The server is going down or its store does not answer.
    #[error("not ready")]
    NotReady,
    /// The library failed.
    #[error(transparent)]
    Library(#[from] LibraryError),
}

impl HttpError {
    fn status(&self) -> StatusCode {
        match self {
            Self::BadRequest(_) => StatusCode::BAD_REQUEST,
            Self::NotFound(_) => StatusCode::NOT_FOUND,
            Self::WrongMethod => StatusCode::METHOD_NOT_ALLOWED,
            Self::NoToken => StatusCode::UNAUTHORIZED,
            Self::Precondition(_) | Self::Replaced { .. } => StatusCode::PRECONDITION_FAILED,
            Self::NoUploads | Self::OtherScenes => StatusCode::FORBIDDEN,
            Self::UnknownKind(_) => StatusCode::UNSUPPORTED_MEDIA_TYPE,
            Self::Full => StatusCode::INSUFFICIENT_STORAGE,
            Self::Slow => StatusCode::REQUEST_TIMEOUT,
            Self::TooMany { .. } => StatusCode::TOO_MANY_REQUESTS,
            Self::TooLarge(_) => StatusCode::PAYLOAD_TOO_LARGE,
            Self::OutsideObject { .. } => StatusCode::RANGE_NOT_SATISFIABLE,
            Self::NotReady => StatusCode::SERVICE_UNAVAILABLE,
            Self::Library(error) => match error {
                LibraryError::Name(_) => StatusCode::BAD_REQUEST,
                LibraryError::Changed { .. } => StatusCode::PRECONDITION_FAILED,
                LibraryError::NoScene { .. }
                | LibraryError::NoObject { .. }
                | LibraryError::NoPlan { .. } => StatusCode::NOT_FOUND,
                LibraryError::Damaged { .. }
                | LibraryError::File { .. }
                | LibraryError::Compress(_) => StatusCode::INTERNAL_SERVER_ERROR,
                LibraryError::Store { .. } | LibraryError::Location { .. } => {
                    StatusCode::SERVICE_UNAVAILABLE
                }
            },
        }
    }

    /// What the client reads; the server's folders and the store's words stay in the log.
    fn message(&self) -> String {
        match self {
            Self::Library(LibraryError::Name(error)) => error.to_string(),
            Self::Library(LibraryError::NoScene { name, .. }) => format!("no scene {name}"),
            // The hash of a scene is its readers' secret.
            Self::Library(LibraryError::Changed { name, expected, .. }) => {
                format!("scene {name}: expected to replace {expected}, found something else")
            }
            Self::Library(LibraryError::NoObject { path, .. }) => format!("no object at {path}"),
            Self::Library(LibraryError::Damaged { path, .. }) => {
                format!("the library is damaged at {path}")
            }
            Self::Library(_) => "the store does not answer".to_owned(),
            other => other.to_string(),
        }
    }
}

impl HttpError {
    /// Status, header fields and text of the answer; a server's error goes into the log.
    pub(super) fn parts(&self) -> (StatusCode, HeaderMap, String) {
        let status = self.status();
        if status.is_server_error() {
            error_log::error(status.canonical_reason().unwrap_or("error"), self);
        }
        let mut headers = HeaderMap::new();
        headers.insert(CONTENT_TYPE, TEXT);
        // A missing or refused answer may be there for the next client.
        headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
        match self {
            Self::OutsideObject { bytes } => {
                headers.insert(CONTENT_RANGE, header(&format!("bytes */{bytes}")));
            }
            Self::NoToken => {
                headers.insert(WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
            }
            Self::TooMany { secs } => {
                headers.insert(RETRY_AFTER, HeaderValue::from(*secs));
            }
            Self::WrongMethod => {
                headers.insert(
                    ALLOW,
                    HeaderValue::from_static("GET, HEAD, POST, PUT, OPTIONS"),
                );
            }
            _ if status == StatusCode::SERVICE_UNAVAILABLE => {
                headers.insert(RETRY_AFTER, HeaderValue::from_static("1"));
            }
            _ => {}
        }
        (status, headers, self.message() + "\n")
    }
}

impl IntoResponse for HttpError {
    fn into_response(self) -> Response {
        self.parts().into_response()
    }
}

/// A header value from text of our own making.
pub(super) fn header(text: &str) -> HeaderValue {
    HeaderValue::from_str(text).unwrap_or_else(|_| HeaderValue::from_static(""))
}

/// Any other path.
pub(super) async fn no_route() -> HttpError {
    HttpError::NotFound("no such route".to_owned())
}

/// A known path with another method.
pub(super) async fn wrong_method() -> HttpError {
    HttpError::WrongMethod
}
