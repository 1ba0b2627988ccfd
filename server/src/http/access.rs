//! Access to scenes by token, and the limits on answers about protected ones.

use axum::http::header::{AUTHORIZATION, CACHE_CONTROL, VARY};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::Response;

use super::AppState;
use super::error::HttpError;
use super::tokens::Worth;
use crate::library::LibraryError;

/// Nobody but the client itself keeps what only some may read.
const PRIVATE: HeaderValue = HeaderValue::from_static("private, no-cache");

impl AppState {
    /// Whether only holders of tokens read `scene`; it need not be there.
    pub(super) fn is_protected(&self, scene: &str) -> bool {
        let readers = self.0.readers.as_ref();
        readers.is_some_and(|readers| readers.protects(scene))
    }

    /// Whether the request may read `scene`.
    pub(super) fn may_read(&self, request: &HeaderMap, scene: &str) -> bool {
        let Some(readers) = &self.0.readers else {
            return true;
        };
        !readers.protects(scene) || readers.worth(request, scene, true) == Worth::Here
    }

    /// If the request may read every scene, those to come included.
    pub(super) fn reads_all(&self, request: &HeaderMap) -> bool {
        let readers = self.0.readers.as_ref();
        readers.is_none_or(|readers| readers.covers_all(request))
    }

    /// Fails unless the request may read `scene`, whether it is there or not.
    pub(super) fn check_read(&self, request: &HeaderMap, scene: &str) -> Result<(), HttpError> {
        match self.may_read(request, scene) {
            true => Ok(()),
            false => Err(HttpError::NoToken),
        }
    }

    /// Fails unless the request may upload to `scene`, whether it is there or not.
    pub(super) fn may_upload(&self, request: &HeaderMap, scene: &str) -> Result<(), HttpError> {
        let uploads = self.0.uploads.as_ref().ok_or(HttpError::NoUploads)?;
        let is_protected = self.is_protected(scene);
        match uploads.tokens().worth(request, scene, is_protected) {
            Worth::Here => Ok(()),
            Worth::Elsewhere => Err(HttpError::OtherScenes),
            Worth::Unknown => Err(HttpError::NoToken),
        }
    }

    /// An error of the library about `scene`, which tells what was found only to who may read it.
    pub(super) fn about_scene(
        &self,
        request: &HeaderMap,
        scene: &str,
        error: LibraryError,
    ) -> HttpError {
        match error {
            LibraryError::Changed {
                name,
                expected,
                found,
                ..
            } if self.may_read(request, scene) => HttpError::Replaced {
                name,
                expected,
                found,
            },
            error => error.into(),
        }
    }

    /// An answer about `scene`, kept by no cache between if it is protected.
    pub(super) fn guarded(&self, scene: &str, response: Response) -> Response {
        match self.is_protected(scene) {
            true => private(response),
            false => response,
        }
    }

    /// The same for a list, which depends on who asks where anything is protected.
    pub(super) fn guarded_list(&self, response: Response) -> Response {
        match self.0.readers.is_some() {
            true => private(response),
            false => response,
        }
    }

    /// Something was published by this server: it shows at once.
    pub(super) fn published(&self) {
        self.0.lookups.forget();
        self.0.listing.forget();
    }
}

fn private(mut response: Response) -> Response {
    let headers = response.headers_mut();
    headers.insert(CACHE_CONTROL, PRIVATE);
    headers.append(VARY, HeaderValue::from_name(AUTHORIZATION));
    response
}
