//! The process that builds an uploaded model: `ingest`, with nothing of the server but the model.
//!
//! Its environment is empty, its memory bounded, its rights given up (`crate::confine`), and it
//! ends with the server. The server trusts none of its output: lines, report and errors are
//! bounded.

use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncBufReadExt, AsyncRead, AsyncReadExt, BufReader};
use tokio::process::Command;
use tokio::sync::Semaphore;

use super::events::Told;
use super::folder::UploadFolder;
use super::{Room, UploadOptions};
use crate::http::AppState;
use crate::library::Replaces;

/// Kept of the error text of a failed build.
const MOST_SAID_BYTES: u64 = 4096;
/// Longest line of progress, and longest report.
const MOST_LINE_BYTES: u64 = 1024;
const MOST_REPORT_BYTES: u64 = 4 << 20;
/// Memory that a thread of the build works in (`crate::ingest`): so many threads fit half of the
/// bound.
const THREAD_BYTES: u64 = 96 << 20;
/// Variables of a store that speaks S3: a build whose library lies there needs them.
const STORE_VARIABLES: [&str; 3] = ["AWS_", "SSL_CERT_FILE", "SSL_CERT_DIR"];
/// Begin of the text of a panic.
const INTERNAL: &str = "internal error";
/// Hexadecimal digits that may be a hash.
const HASH_DIGITS: usize = 32;

/// A model that becomes a scene; its folder goes with it.
pub(super) struct Build {
    pub state: AppState,
    pub options: Arc<UploadOptions>,
    pub scene: String,
    pub kind: &'static str,
    pub replaces: Replaces,
    /// If the client may read the scene that it replaces.
    pub reads: bool,
    /// If meshes that the library holds are not built again. A client that may not read every scene
    /// would learn by it which meshes the others have.
    pub reuses: bool,
    pub folder: UploadFolder,
    pub told: Told,
}

/// Why there is no scene.
#[derive(Debug)]
enum Failed {
    /// The model's fault, in words for the client.
    Model(String),
    /// The server's fault, in words for the log.
    Server(String),
}

impl Build {
    /// Waits for its turn, then builds.
    pub(super) async fn run(self, builds: Arc<Semaphore>, room: Room) {
        self.told.tell("queued", "{}");
        // Never closed.
        let Ok(_turn) = builds.acquire().await else {
            return;
        };
        let done = self.ingest().await;
        let (name, data) = match done {
            Ok(report) => {
                self.state.published();
                ("done", report)
            }
            Err(failed) => {
                let words = match failed {
                    Failed::Model(words) => {
                        tracing::warn!("upload of scene {}: {words:?}", self.scene);
                        words
                    }
                    Failed::Server(words) => {
                        tracing::error!("upload of scene {}: {words:?}", self.scene);
                        "the build failed; the server's log says why".to_owned()
                    }
                };
                ("error", serde_json::json!({ "error": words }).to_string())
            }
        };
        let Self { told, folder, .. } = self;
        // A client that sees the last event finds nothing of the upload left.
        drop((folder, room));
        told.end(name, &data).await;
    }

    /// Runs `ingest`; gives its report as one line of JSON.
    async fn ingest(&self) -> Result<String, Failed> {
        let options = &self.options;
        let started = self.command().spawn();
        let mut child =
            started.map_err(|error| Failed::Server(format!("ingest does not start: {error}")))?;
        let (Some(stdin), Some(stdout), Some(stderr)) =
            (child.stdin.take(), child.stdout.take(), child.stderr.take())
        else {
            unreachable!("all three are piped")
        };
        let progress = async {
            let mut lines = BufReader::new(stdout);
            while let Some(line) = next_line(&mut lines).await {
                self.told.tell("progress", &self.for_client(&line));
            }
        };
        let ended = async { tokio::join!(child.wait(), progress, said(stderr)) };
        let limit = Duration::from_secs(options.max_secs);
        let Ok((status, (), said)) = tokio::time::timeout(limit, ended).await else {
            // Gone before its folder is.
            let killed = child.kill().await;
            killed.map_err(|error| Failed::Server(format!("ingest: cannot kill: {error}")))?;
            let words = format!("not built within {} s", options.max_secs);
            return Err(Failed::Model(words));
        };
        drop(stdin);
        let status = status.map_err(|error| Failed::Server(format!("ingest: {error}")))?;
        if !status.success() {
            return Err(self.failed(status, &said));
        }
        report(&self.folder.report()).await.map_err(Failed::Server)
    }

    fn command(&self) -> Command {
        let options = &self.options;
        let memory = options.memory_bytes;
        let threads = std::thread::available_parallelism().map_or(1, |cores| cores.get() as u64);
        let threads = threads.min(memory / 2 / THREAD_BYTES).max(1);
        let mut command = Command::new(&options.program);
        command
            .arg("ingest")
            .arg(self.folder.model(self.kind))
            .args(["--library", &options.library, "--scene", &self.scene])
            .args(["--threads", &threads.to_string()])
            .args(["--memory-limit", &memory.to_string()])
            .args(["--max-triangles", &options.max_triangles.to_string()])
            .args(self.replaces_option())
            .arg("--scratch")
            .arg(self.folder.scratch())
            .arg("--report")
            .arg(self.folder.report())
            .args([
                "--self-contained",
                "--progress-json",
                "--end-with-stdin",
                "-q",
            ])
            .env_clear()
            .envs(variables(&options.library))
            .current_dir(self.folder.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .kill_on_drop(true);
        if !self.reuses {
            command.arg("--rebuild");
        }
        if options.confined {
            command.args(["--confine", &memory.to_string()]);
        }
        command
    }

    fn replaces_option(&self) -> Vec<String> {
        let scene = match self.replaces {
            Replaces::Anything => return Vec::new(),
            Replaces::Nothing => "none".to_owned(),
            Replaces::Scene(scene) => scene.to_string(),
        };
        vec!["--replaces".to_owned(), scene]
    }

    /// Tells the model's faults from the server's: `ingest` ends with 1 where it says what is
    /// wrong.
    fn failed(&self, status: ExitStatus, said: &str) -> Failed {
        if ran_out_of_memory(status) {
            let words = format!(
                "the build needs more memory than {} bytes",
                self.options.memory_bytes
            );
            return Failed::Model(words);
        }
        let line = said.lines().find_map(|line| line.strip_prefix("error: "));
        match (status.code(), line) {
            (Some(1), Some(line)) if !line.starts_with(INTERNAL) => {
                Failed::Model(self.for_client(line))
            }
            _ => Failed::Server(format!("ingest ended with {status}: {said}")),
        }
    }

    /// The text of an error without places on this server, and without hashes of a scene that the
    /// client may not read.
    fn for_client(&self, text: &str) -> String {
        let folder = self.folder.path().to_string_lossy();
        let text = text
            .replace(&*self.folder.model(self.kind).to_string_lossy(), "model")
            .replace(&*folder, "scratch")
            .replace(&self.options.library, "library");
        match self.reads {
            true => text,
            false => without_hashes(&text),
        }
    }
}

/// An allocation that fails aborts the process; a system without memory kills it.
#[cfg(unix)]
fn ran_out_of_memory(status: ExitStatus) -> bool {
    use std::os::unix::process::ExitStatusExt;
    [libc::SIGABRT, libc::SIGKILL]
        .map(Some)
        .contains(&status.signal())
}

#[cfg(not(unix))]
fn ran_out_of_memory(_: ExitStatus) -> bool {
    false
}

/// The variables that a build needs.
fn variables(library: &str) -> impl Iterator<Item = (std::ffi::OsString, std::ffi::OsString)> {
    let in_store = library.contains("://");
    std::env::vars_os().filter(move |(name, _)| {
        let name = name.to_string_lossy();
        in_store && STORE_VARIABLES.iter().any(|begin| name.starts_with(begin))
    })
}

/// The next line that is an object of JSON; none at the end.
async fn next_line(lines: &mut (impl AsyncBufReadExt + Unpin)) -> Option<String> {
    loop {
        let mut line = Vec::new();
        let mut bounded = (&mut *lines).take(MOST_LINE_BYTES);
        // An error of the pipe is its end.
        if bounded.read_until(b'\n', &mut line).await.unwrap_or(0) == 0 {
            return None;
        }
        if let Ok(value @ serde_json::Value::Object(_)) = serde_json::from_slice(&line) {
            return Some(value.to_string());
        }
    }
}

/// The begin of the error text; the rest is read and dropped, so that the process does not wait.
async fn said(mut stderr: impl AsyncRead + Unpin) -> String {
    let mut said = Vec::new();
    let mut bounded = (&mut stderr).take(MOST_SAID_BYTES);
    if let Err(error) = bounded.read_to_end(&mut said).await {
        tracing::warn!("ingest's errors: {error}");
    }
    let _ = tokio::io::copy(&mut stderr, &mut tokio::io::sink()).await;
    String::from_utf8_lossy(&said).into_owned()
}

/// The report as one line of JSON.
async fn report(file: &Path) -> Result<String, String> {
    let read = async {
        let mut text = Vec::new();
        let file = tokio::fs::File::open(file).await?;
        file.take(MOST_REPORT_BYTES).read_to_end(&mut text).await?;
        serde_json::from_slice::<serde_json::Value>(&text).map_err(std::io::Error::from)
    };
    let report: std::io::Result<_> = read.await;
    report
        .map(|report| report.to_string())
        .map_err(|error| format!("the scene is published, its report cannot be read: {error}"))
}

/// Puts `...` in the place of every word that may be a hash.
fn without_hashes(text: &str) -> String {
    let mut kept = String::with_capacity(text.len());
    let mut digits = String::new();
    for letter in text.chars().chain(['\n']) {
        if letter.is_ascii_hexdigit() {
            digits.push(letter);
            continue;
        }
        kept += if digits.len() < HASH_DIGITS {
            &digits
        } else {
            "..."
        };
        digits.clear();
        kept.push(letter);
    }
    kept.pop();
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_left_out_of_a_text_and_words_are_not() {
        let hash = "0123456789abcdef".repeat(4);
        let text = format!("scene dead: found {hash}, expected {hash}");
        assert_eq!(without_hashes(&text), "scene dead: found ..., expected ...");
        assert_eq!(without_hashes(&hash), "...");
        assert_eq!(without_hashes("facade 0x1f, ende"), "facade 0x1f, ende");
    }

    #[cfg(unix)]
    #[test]
    fn a_failed_allocation_is_told_from_an_error_and_from_a_panic() {
        use std::os::unix::process::ExitStatusExt;
        for (wait_status, expected) in [
            (libc::SIGABRT, true),
            (libc::SIGKILL, true),
            (libc::SIGSEGV, false),
            (1 << 8, false),
            (101 << 8, false),
        ] {
            let status = ExitStatus::from_raw(wait_status);
            assert_eq!(ran_out_of_memory(status), expected, "{status}");
        }
    }

    #[tokio::test]
    async fn only_short_lines_of_json_are_progress() {
        let long = "9".repeat(1 << 20);
        let output = format!("{{\"stage\": \"import\"}}\nno json\n\"{long}\"\n{{\"of\":1}}");
        let mut lines = BufReader::new(output.as_bytes());
        let mut found = Vec::new();
        while let Some(line) = next_line(&mut lines).await {
            found.push(line);
        }
        assert!(
            found
                .iter()
                .all(|line| line.len() as u64 <= MOST_LINE_BYTES)
        );
        assert_eq!(
            found.first().map(String::as_str),
            Some("{\"stage\":\"import\"}")
        );
        assert_eq!(found.last().map(String::as_str), Some("{\"of\":1}"));
    }
}
