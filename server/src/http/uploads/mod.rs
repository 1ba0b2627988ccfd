//! `PUT /v1/scenes/{scene}?kind=glb`: a model becomes a scene on the server.
//!
//! The body goes to a file in a folder of its own as it comes (`folder`). A process of its own
//! ingests it, one at a time (`build`): a time limit is a kill, which an ingest survives without
//! harm to the library. The answer tells its progress as server-sent events (`events`); a client
//! that goes away misses them, and the ingest goes on.

mod build;
mod events;
mod folder;

use std::net::IpAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, BodyDataStream};
use axum::extract::rejection::QueryRejection;
use axum::extract::{Path, Query, Request, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_LENGTH, CONTENT_TYPE, IF_MATCH, IF_NONE_MATCH};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};
use lodestream_format::{FormatError, library::scene_path};
use tokio::io::AsyncWriteExt;
use tokio::sync::{Semaphore, mpsc};

use super::AppState;
use super::budget::{Budget, Claim};
use super::error::HttpError;
use super::limits::ClientAddress;
use super::pace::{Pace, PacedBody};
use super::tokens::Tokens;
use crate::library::Replaces;
use build::Build;
use events::{EVENTS_AHEAD, Told};

pub use folder::UploadsFolder;

/// Models that are received, wait or are built at once, and those of one client.
const MOST_AT_ONCE: usize = 64;
const MOST_OF_CLIENT: usize = 32;
/// The bytes of these, as multiples of the largest model.
const MODELS_ON_DISK: usize = 8;
const MODELS_OF_CLIENT: usize = 4;
/// Longest wait for a place among them.
const WAIT: Duration = Duration::from_secs(20);
/// The slowest body: a model of 4 GiB over 16 Mbit/s takes 36 minutes.
const PACE: Pace = Pace {
    idle: Duration::from_secs(30),
    grace: Duration::from_secs(15),
    min_bytes_per_sec: 8 * 1024,
};
/// A refused body is read on for so many bytes, at this pace: its sender reads the answer only
/// then.
const LINGER_BYTES: usize = 8 * 1024 * 1024;
const LINGER_PACE: Pace = Pace {
    idle: Duration::from_secs(5),
    grace: Duration::from_secs(5),
    min_bytes_per_sec: 256 * 1024,
};
/// Files that can come alone.
const KINDS: [&str; 4] = ["glb", "obj", "ply", "stl"];

/// Uploads and their bounds.
#[derive(Debug)]
pub struct UploadOptions {
    /// Tokens that may upload.
    pub tokens: Tokens,
    /// This program: its `ingest` builds.
    pub program: PathBuf,
    /// Location of the library.
    pub library: String,
    /// Folder for models on their way and builds that do not fit memory.
    pub folder: UploadsFolder,
    /// Largest model.
    pub max_bytes: u64,
    /// Most triangles of a model.
    pub max_triangles: u64,
    /// Longest build.
    pub max_secs: u64,
    /// Most memory of a build.
    pub memory_bytes: u64,
    /// If builds give up their rights to other files and the network.
    pub confined: bool,
}

/// Uploads of this server.
#[derive(Debug)]
pub(super) struct Uploads {
    options: Arc<UploadOptions>,
    places: Arc<Budget>,
    bytes: Arc<Budget>,
    builds: Arc<Semaphore>,
}

impl Uploads {
    pub(super) fn new(options: UploadOptions) -> Self {
        let largest = usize::try_from(options.max_bytes).unwrap_or(usize::MAX);
        Self {
            options: Arc::new(options),
            places: Budget::new(MOST_AT_ONCE, MOST_OF_CLIENT),
            bytes: Budget::new(
                largest.saturating_mul(MODELS_ON_DISK),
                largest.saturating_mul(MODELS_OF_CLIENT),
            ),
            builds: Arc::new(Semaphore::new(1)),
        }
    }

    /// Tokens that upload.
    pub(super) fn tokens(&self) -> &Tokens {
        &self.options.tokens
    }
}

/// Query of an upload.
#[derive(Debug, serde::Deserialize)]
pub(super) struct UploadQuery {
    kind: Option<String>,
}

/// Room that an upload takes until it is built.
#[derive(Debug)]
struct Room {
    _place: Claim,
    bytes: Claim,
}

/// `PUT /v1/scenes/{scene}?kind=glb`
pub(super) async fn upload(
    State(state): State<AppState>,
    Path(scene): Path<String>,
    ClientAddress(client): ClientAddress,
    query: Result<Query<UploadQuery>, QueryRejection>,
    request: Request,
) -> Result<Response, HttpError> {
    let uploads = state.0.uploads.as_ref().ok_or(HttpError::NoUploads)?;
    let options = &uploads.options;
    state.may_upload(request.headers(), &scene)?;
    scene_path(&scene).map_err(HttpError::BadRequest)?;
    let kind = kind(query)?;
    let replaces = replaces(request.headers())?;
    let reads = state.may_read(request.headers(), &scene);
    let reuses = state.reads_all(request.headers());
    let fits = match state.0.library.check_replaced(&scene, replaces).await {
        Ok(()) => check_length(request.headers(), options.max_bytes),
        Err(error) => Err(state.about_scene(request.headers(), &scene, error)),
    };
    let mut body = request.into_body().into_data_stream();
    if let Err(error) = fits {
        linger(&mut body).await;
        return Err(error);
    }
    let mut room = Room {
        _place: place(&uploads.places, client).await?,
        bytes: uploads.bytes.claim(client),
    };
    let folder = options.folder.upload().map_err(|error| no_room(&error))?;
    let file = tokio::fs::File::create_new(folder.model(kind)).await;
    let file = file.map_err(|error| no_room(&error))?;
    if let Err(error) = receive(&mut body, file, options.max_bytes, &mut room.bytes).await {
        linger(&mut body).await;
        return Err(error);
    }
    let (sender, receiver) = mpsc::channel(EVENTS_AHEAD);
    let build = Build {
        state: state.clone(),
        options: Arc::clone(options),
        scene,
        kind,
        replaces,
        reads,
        reuses,
        folder,
        told: Told::new(sender),
    };
    tokio::spawn(build.run(Arc::clone(&uploads.builds), room));
    let headers = [
        (CONTENT_TYPE, "text/event-stream"),
        (CACHE_CONTROL, "no-store"),
    ];
    Ok((headers, Body::from_stream(events::stream(receiver))).into_response())
}

fn kind(query: Result<Query<UploadQuery>, QueryRejection>) -> Result<&'static str, HttpError> {
    let Query(query) = query.map_err(|error| {
        HttpError::BadRequest(FormatError::new("query", "kind=KIND", error.body_text()))
    })?;
    let Some(asked) = query.kind else {
        return Ok(KINDS[0]);
    };
    let known = KINDS.into_iter().find(|kind| *kind == asked);
    known.ok_or_else(|| {
        let expected = format!("one of {}", KINDS.join(", "));
        HttpError::UnknownKind(FormatError::new(
            "query kind",
            expected,
            format!("{asked:?}"),
        ))
    })
}

async fn place(places: &Arc<Budget>, client: IpAddr) -> Result<Claim, HttpError> {
    let mut place = places.claim(client);
    let taken = tokio::time::timeout(WAIT, place.grow(1)).await;
    taken.map_err(|_| HttpError::NotReady).map(|()| place)
}

/// The scene that a conditional upload replaces: `If-None-Match: *` nothing, `If-Match` the scene
/// that a tag of this server names.
fn replaces(headers: &HeaderMap) -> Result<Replaces, HttpError> {
    let wrong = |expected: &str, found: &HeaderValue| {
        HttpError::Precondition(FormatError::new(
            "condition",
            expected,
            format!("{found:?}"),
        ))
    };
    if let Some(tag) = headers.get(IF_MATCH) {
        let scene = tag.to_str().ok().and_then(|tag| {
            // Tags of the reference have its time behind the scene.
            let tag = tag.trim().trim_start_matches("W/").trim_matches('"');
            tag.split('.').next()?.parse().ok()
        });
        let wrong = || wrong("If-Match: one tag of a scene, as GET gives it", tag);
        return scene.map(Replaces::Scene).ok_or_else(wrong);
    }
    match headers.get(IF_NONE_MATCH) {
        None => Ok(Replaces::Anything),
        Some(any) if any == "*" => Ok(Replaces::Nothing),
        Some(tag) => Err(wrong("If-None-Match: *", tag)),
    }
}

fn check_length(headers: &HeaderMap, most: u64) -> Result<(), HttpError> {
    let length = headers.get(CONTENT_LENGTH).and_then(|it| it.to_str().ok());
    match length.and_then(|text| text.parse::<u64>().ok()) {
        Some(bytes) if bytes > most => Err(too_large(most, bytes)),
        _ => Ok(()),
    }
}

fn too_large(most: u64, found: u64) -> HttpError {
    let expected = format!("at most {most} bytes");
    HttpError::TooLarge(FormatError::new("model", expected, found))
}

fn no_room(error: &std::io::Error) -> HttpError {
    tracing::error!("upload: {error}");
    HttpError::Full
}

async fn linger(body: &mut BodyDataStream) {
    let mut left = LINGER_BYTES;
    let mut body = PacedBody::new("model", body, || LINGER_PACE);
    while let Ok(Some(piece)) = body.next().await {
        match left.checked_sub(piece.len()) {
            Some(rest) => left = rest,
            None => return,
        }
    }
}

/// Writes the body to `file`; room for its bytes is claimed as they come.
async fn receive(
    body: &mut BodyDataStream,
    mut file: tokio::fs::File,
    most: u64,
    room: &mut Claim,
) -> Result<(), HttpError> {
    let mut bytes = 0;
    let mut body = PacedBody::new("model", body, || PACE);
    while let Some(piece) = body.next().await? {
        bytes += piece.len() as u64;
        if bytes > most {
            return Err(too_large(most, bytes));
        }
        if !room.try_grow(piece.len()) {
            return Err(HttpError::Full);
        }
        file.write_all(&piece)
            .await
            .map_err(|error| no_room(&error))?;
    }
    if bytes == 0 {
        let error = FormatError::new("model", "at least one byte", "none");
        return Err(HttpError::BadRequest(error));
    }
    file.flush().await.map_err(|error| no_room(&error))
}
