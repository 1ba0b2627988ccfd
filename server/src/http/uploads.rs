//! `PUT /v1/scenes/{scene}?kind=glb`: a model becomes a scene on the server.
//!
//! The body goes to a file as it comes. It is ingested by a process of its own, one at a time: what a model can do to an importer stays there,
//! and a time limit is a kill, which an ingest survives without harm to the library. The answer tells its progress as server-sent
//! events; who goes away misses them, and the ingest goes on.

use std::path::PathBuf;
use std::process::Stdio;
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, BodyDataStream};
use axum::extract::rejection::QueryRejection;
use axum::extract::{Path, Query, Request, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_LENGTH, CONTENT_TYPE, IF_MATCH, IF_NONE_MATCH};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use futures_util::{StreamExt, stream};
use lodestream_format::{FormatError, library::scene_path};
use tempfile::TempPath;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};

use super::AppState;
use super::error::HttpError;
use super::tokens::Tokens;
use crate::library::Replaces;

/// Models that are received, wait or are built at once; who comes then is told to come back.
const MOST_AT_ONCE: usize = 8;
/// Longest wait for the next bytes of a body.
const BODY_TIMEOUT: Duration = Duration::from_secs(30);
/// A comment goes out after so long without an event, so that nothing in between takes the connection for dead.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// Events that wait for the connection; what is more than that is left out.
const EVENTS_AHEAD: usize = 64;
/// What is still read of a body that is refused: who writes it reads the answer only then.
const LINGER_BYTES: usize = 8 * 1024 * 1024;
/// What is kept of what a failed ingest said.
const MOST_SAID_BYTES: u64 = 4096;
/// Files that can come alone.
const KINDS: [&str; 4] = ["glb", "obj", "ply", "stl"];

/// What uploads may do.
#[derive(Debug, Clone)]
pub struct UploadOptions {
    /// Who may.
    pub tokens: Tokens,
    /// This program: its `ingest` builds.
    pub program: PathBuf,
    /// Where the library lies.
    pub library: String,
    /// Folder for models on their way and builds that do not fit memory.
    pub scratch: PathBuf,
    /// Largest model.
    pub max_bytes: u64,
    /// Most triangles of a model.
    pub max_triangles: u64,
    /// Longest build.
    pub max_secs: u64,
    /// Most memory of a build.
    pub memory_bytes: u64,
}

/// Uploads of this server.
#[derive(Debug)]
pub(super) struct Uploads {
    options: UploadOptions,
    room: Arc<Semaphore>,
    builds: Arc<Semaphore>,
}

impl Uploads {
    pub(super) fn new(options: UploadOptions) -> Self {
        Self {
            options,
            room: Arc::new(Semaphore::new(MOST_AT_ONCE)),
            builds: Arc::new(Semaphore::new(1)),
        }
    }
}

/// Query of an upload.
#[derive(Debug, serde::Deserialize)]
pub(super) struct UploadQuery {
    kind: Option<String>,
}

/// `PUT /v1/scenes/{scene}?kind=glb`
pub(super) async fn upload(
    State(state): State<AppState>,
    Path(scene): Path<String>,
    query: Result<Query<UploadQuery>, QueryRejection>,
    request: Request,
) -> Result<Response, HttpError> {
    let uploads = state.0.uploads.as_ref().ok_or(HttpError::NoUploads)?;
    let options = &uploads.options;
    options.tokens.check(request.headers())?;
    scene_path(&scene).map_err(HttpError::BadRequest)?;
    let Query(query) = query.map_err(|error| {
        HttpError::BadRequest(FormatError::new("query", "kind=KIND", error.body_text()))
    })?;
    let kind = query.kind.unwrap_or_else(|| KINDS[0].to_owned());
    if !KINDS.contains(&kind.as_str()) {
        let expected = format!("one of {}", KINDS.join(", "));
        let error = FormatError::new("query kind", expected, format!("{kind:?}"));
        return Err(HttpError::UnknownKind(error));
    }
    let replaces = replaces(request.headers())?;
    let fits = match state.0.library.check_replaced(&scene, replaces).await {
        Ok(()) => check_length(request.headers(), options.max_bytes),
        Err(error) => Err(error.into()),
    };
    let mut body = request.into_body().into_data_stream();
    if let Err(error) = fits {
        linger(&mut body).await;
        return Err(error);
    }
    let room = Arc::clone(&uploads.room).try_acquire_owned();
    let room = room.map_err(|_| HttpError::NotReady)?;
    let file = tempfile::Builder::new()
        .prefix("lodestream-upload-")
        .suffix(&format!(".{kind}"))
        .tempfile_in(&options.scratch)
        .map_err(|error| no_room(&error))?;
    let (file, path) = file.into_parts();
    if let Err(error) = receive(&mut body, file.into(), options.max_bytes).await {
        linger(&mut body).await;
        return Err(error);
    }
    let (sender, receiver) = mpsc::channel(EVENTS_AHEAD);
    let job = Job {
        options: options.clone(),
        scene,
        replaces,
        model: path,
        events: sender,
    };
    tokio::spawn(job.run(Arc::clone(&uploads.builds), room));
    let headers = [
        (CONTENT_TYPE, "text/event-stream"),
        (CACHE_CONTROL, "no-store"),
    ];
    Ok((headers, Body::from_stream(told(receiver))).into_response())
}

/// What a conditional upload replaces: `If-None-Match: *` nothing, `If-Match` the scene that a tag of this server names.
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
    while let Ok(Some(Ok(piece))) = tokio::time::timeout(BODY_TIMEOUT, body.next()).await {
        match left.checked_sub(piece.len()) {
            Some(rest) => left = rest,
            None => return,
        }
    }
}

async fn receive(
    body: &mut BodyDataStream,
    mut file: tokio::fs::File,
    most: u64,
) -> Result<(), HttpError> {
    let mut bytes = 0;
    loop {
        let piece = tokio::time::timeout(BODY_TIMEOUT, body.next()).await;
        let Some(piece) = piece.map_err(|_| HttpError::Slow)? else {
            break;
        };
        let piece = piece.map_err(|error| {
            HttpError::BadRequest(FormatError::new("model", "a whole body", error))
        })?;
        bytes += piece.len() as u64;
        if bytes > most {
            return Err(too_large(most, bytes));
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

/// A model on its way to be a scene; the file goes with it.
struct Job {
    options: UploadOptions,
    scene: String,
    replaces: Replaces,
    model: TempPath,
    events: mpsc::Sender<Bytes>,
}

impl Job {
    async fn run(self, builds: Arc<Semaphore>, room: OwnedSemaphorePermit) {
        self.tell("queued", "{}");
        // Never closed.
        let Ok(_turn) = builds.acquire().await else {
            return;
        };
        let last = match self.ingest().await {
            Ok(report) => event("done", &report),
            Err(error) => {
                tracing::warn!("upload of scene {}: {error}", self.scene);
                event("error", &serde_json::json!({ "error": error }).to_string())
            }
        };
        drop(room);
        // How it ended is worth a wait; an error means that nobody listens.
        let _ = self.events.send_timeout(last, BODY_TIMEOUT).await;
    }

    /// Runs `ingest`; gives its report as JSON, or why there is none.
    async fn ingest(&self) -> Result<String, String> {
        let options = &self.options;
        let report = tempfile::Builder::new()
            .prefix("lodestream-report-")
            .tempfile_in(&options.scratch)
            .map_err(|error| format!("no room for the report: {error}"))?
            .into_temp_path();
        let started = tokio::process::Command::new(&options.program)
            .arg("ingest")
            .arg(&self.model)
            .args(["--library", &options.library, "--scene", &self.scene])
            .args(["--memory-limit", &options.memory_bytes.to_string()])
            .args(["--max-triangles", &options.max_triangles.to_string()])
            .args(self.replaces_option())
            .arg("--scratch")
            .arg(&options.scratch)
            .arg("--report")
            .arg(&report)
            .args(["--progress-json", "-q"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .kill_on_drop(true)
            .spawn();
        let mut child = started.map_err(|error| format!("ingest does not start: {error}"))?;
        let (Some(stdout), Some(stderr)) = (child.stdout.take(), child.stderr.take()) else {
            unreachable!("both are piped")
        };
        let progress = async {
            let mut lines = BufReader::new(stdout).lines();
            while let Ok(Some(line)) = lines.next_line().await {
                self.tell("progress", &self.without_paths(&line));
            }
        };
        let said = async {
            let mut said = Vec::new();
            // What cannot be read is not said; the exit status tells the rest.
            let mut stderr = stderr;
            let _ = (&mut stderr)
                .take(MOST_SAID_BYTES)
                .read_to_end(&mut said)
                .await;
            let _ = tokio::io::copy(&mut stderr, &mut tokio::io::sink()).await;
            String::from_utf8_lossy(&said).into_owned()
        };
        let ended = async { tokio::join!(child.wait(), progress, said) };
        let limit = Duration::from_secs(options.max_secs);
        let Ok((status, (), said)) = tokio::time::timeout(limit, ended).await else {
            return Err(format!("not built within {} s", options.max_secs));
        };
        let status = status.map_err(|error| format!("ingest: {error}"))?;
        if !status.success() {
            let said = self.without_paths(said.trim().trim_start_matches("error: "));
            return Err(match said.is_empty() {
                true => format!("ingest ended with {status}"),
                false => said,
            });
        }
        tokio::fs::read_to_string(&report)
            .await
            .map_err(|error| format!("report: {error}"))
            .map(|text| text.lines().map(str::trim).collect::<Vec<_>>().join(""))
    }

    fn replaces_option(&self) -> Vec<String> {
        let scene = match self.replaces {
            Replaces::Anything => return Vec::new(),
            Replaces::Nothing => "none".to_owned(),
            Replaces::Scene(scene) => scene.to_string(),
        };
        vec!["--replaces".to_owned(), scene]
    }

    /// What the ingest said, without where things lie on this server.
    fn without_paths(&self, said: &str) -> String {
        let said = said.replace(&*self.model.to_string_lossy(), "model");
        let said = said.replace(&self.options.library, "library");
        said.replace(&*self.options.scratch.to_string_lossy(), "scratch")
    }

    /// Sends an event; one that nobody waits for is left out.
    fn tell(&self, name: &str, data: &str) {
        let _ = self.events.try_send(event(name, data));
    }
}

fn event(name: &str, data: &str) -> Bytes {
    Bytes::from(format!("event: {name}\ndata: {data}\n\n"))
}

/// The events, and comments where there are none for a while.
fn told(
    receiver: mpsc::Receiver<Bytes>,
) -> impl futures_util::Stream<Item = Result<Bytes, std::convert::Infallible>> {
    stream::unfold(receiver, |mut receiver| async {
        match tokio::time::timeout(KEEP_ALIVE, receiver.recv()).await {
            Ok(event) => Some((Ok(event?), receiver)),
            Err(_) => Some((Ok(Bytes::from_static(b": still here\n\n")), receiver)),
        }
    })
}
