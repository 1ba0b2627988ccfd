//! `GET /healthz`: the process answers. `GET /readyz`: it can serve, and is not going down. Both
//! are asked by anybody as often as they like, so that one look a second at what it takes to serve
//! is all that asking costs.

use std::path::Path;
use std::time::Duration;

use axum::extract::State;
use axum::http::HeaderValue;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, HeaderName};
use tokio::sync::Mutex;
use tokio::time::Instant;

use super::AppState;
use super::error::{HttpError, TEXT};
use super::error_log;

/// Longest wait for the store.
const STORE_TIMEOUT: Duration = Duration::from_secs(3);
/// Least time between two looks.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// When it was last looked, and whether the server was ready.
#[derive(Debug, Default)]
pub(super) struct Readiness(Mutex<Option<(Instant, bool)>>);

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
    match !state.is_draining() && is_ready(&state).await {
        true => Ok(text("ready\n")),
        false => Err(HttpError::NotReady),
    }
}

async fn is_ready(state: &AppState) -> bool {
    if let Some(is_ready) = recent(*state.0.readiness.0.lock().await) {
        return is_ready;
    }
    let state = state.clone();
    // A task of its own: those who ask and go away would have each other look again.
    let look = tokio::spawn(async move {
        let mut seen = state.0.readiness.0.lock().await;
        if let Some(is_ready) = recent(*seen) {
            return is_ready;
        }
        let is_ready = look(&state).await;
        *seen = Some((Instant::now(), is_ready));
        is_ready
    });
    look.await.unwrap_or(false)
}

/// The last look, if that is not long ago.
fn recent(seen: Option<(Instant, bool)>) -> Option<bool> {
    let (at, is_ready) = seen?;
    (at.elapsed() < LOOK_EVERY).then_some(is_ready)
}

/// Whether the store answers, and there is a descriptor for what an answer needs.
async fn look(state: &AppState) -> bool {
    let library = &state.0.library;
    let answers = tokio::time::timeout(STORE_TIMEOUT, async {
        library.ready().await.map_err(|error| error.to_string())?;
        let folder = library.folder().map_or(Path::new("/"), |folder| folder);
        let opened = tokio::fs::read_dir(folder).await;
        opened.map(drop).map_err(|error| error.to_string())
    });
    let found = match answers.await {
        Ok(Ok(())) => return true,
        Ok(Err(error)) => error,
        Err(_) => format!("no answer of the store in {} s", STORE_TIMEOUT.as_secs()),
    };
    error_log::error("not ready", &found);
    false
}
