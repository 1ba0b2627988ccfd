//! `GET /healthz`: the process answers. `GET /readyz`: it can serve, and is not going down.

use std::time::Duration;

use axum::extract::State;
use axum::http::HeaderValue;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, HeaderName};

use super::AppState;
use super::error::{HttpError, TEXT};

/// Longest wait for the store.
const STORE_TIMEOUT: Duration = Duration::from_secs(3);

type Text = ([(HeaderName, HeaderValue); 2], &'static str);

fn text(text: &'static str) -> Text {
    let no_store = HeaderValue::from_static("no-store");
    ([(CONTENT_TYPE, TEXT), (CACHE_CONTROL, no_store)], text)
}

/// `GET /healthz`
pub(super) async fn healthz() -> Text {
    text("ok\n")
}

/// `GET /readyz`
pub(super) async fn readyz(State(state): State<AppState>) -> Result<Text, HttpError> {
    if state.is_draining() {
        return Err(HttpError::NotReady);
    }
    match tokio::time::timeout(STORE_TIMEOUT, state.0.library.ready()).await {
        Ok(answered) => answered.map(|()| text("ready\n")).map_err(HttpError::from),
        Err(_) => Err(HttpError::NotReady),
    }
}
