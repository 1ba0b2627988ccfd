//! Files that are read again: certificates and tokens, when they change, and when the process is
//! told to (SIGHUP). A bad file is told, and the old one stays.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use super::AppState;
use super::tls::Tls;
use super::tokens::{Coverage, Tokens};
use crate::library::Library;

/// Time between two looks at the files. A changed file is read once two looks found it the same:
/// half of a file may be a file too.
const LOOK_EVERY: Duration = Duration::from_secs(2);
/// Longest wait for the names of the library's scenes.
const NAMES_TIMEOUT: Duration = Duration::from_secs(10);

/// The signal; taken from the moment this is made.
#[derive(Debug)]
pub struct Reload {
    #[cfg(unix)]
    hangups: tokio::signal::unix::Signal,
}

/// Files that are read together, and how they were when that was done last.
struct Watched {
    source: Source,
    files: Vec<PathBuf>,
    seen: Vec<Stamp>,
    read: Vec<Stamp>,
}

enum Source {
    Certificates(Tls),
    Tokens(Tokens),
}

/// Nothing where there is no file.
type Stamp = Option<(SystemTime, u64, u64)>;

impl Reload {
    /// Takes the signal; needs a runtime.
    pub fn install() -> io::Result<Self> {
        Ok(Self {
            #[cfg(unix)]
            hangups: tokio::signal::unix::signal(tokio::signal::unix::SignalKind::hangup())?,
        })
    }

    /// Reads again what changes, for ever.
    pub async fn run(mut self, tls: Option<Tls>, state: AppState) {
        let shared = &state.0;
        let uploads = shared.uploads.as_ref().map(|uploads| uploads.tokens());
        let tokens = shared.readers.iter().chain(uploads).cloned();
        let sources = tls.into_iter().map(Source::Certificates);
        let sources = sources.chain(tokens.map(Source::Tokens));
        let mut watched: Vec<_> = sources.map(Watched::new).collect();
        loop {
            let is_told = self.wait().await;
            for files in &mut watched {
                if files.is_due(is_told) {
                    files.read_again(&state).await;
                }
            }
        }
    }

    /// Until the next look; gives whether the process was told to read everything again.
    async fn wait(&mut self) -> bool {
        #[cfg(unix)]
        tokio::select! {
            // No signal ever comes again where the stream ends.
            Some(()) = self.hangups.recv() => return true,
            () = tokio::time::sleep(LOOK_EVERY) => {}
        }
        #[cfg(not(unix))]
        tokio::time::sleep(LOOK_EVERY).await;
        false
    }
}

impl Watched {
    fn new(source: Source) -> Self {
        let files = match &source {
            Source::Certificates(tls) => tls.files().to_vec(),
            Source::Tokens(tokens) => vec![tokens.file().to_owned()],
        };
        let seen: Vec<_> = files.iter().map(|file| stamp(file)).collect();
        Self {
            source,
            files,
            read: seen.clone(),
            seen,
        }
    }

    fn is_due(&mut self, is_told: bool) -> bool {
        let now: Vec<_> = self.files.iter().map(|file| stamp(file)).collect();
        let is_settled = now == self.seen;
        self.seen = now;
        let is_due = is_told || is_settled && self.seen != self.read;
        if is_due {
            self.read.clone_from(&self.seen);
        }
        is_due
    }

    async fn read_again(&self, state: &AppState) {
        let shared = &state.0;
        match &self.source {
            Source::Certificates(tls) => tls.read_again(),
            Source::Tokens(tokens) => {
                let names = scene_names(&shared.library).await;
                match tokens.read_again(&names) {
                    Ok(()) => match coverage(tokens, &names, shared.readers.as_ref()) {
                        Ok(lines) => lines.iter().for_each(|line| tracing::info!("{line}")),
                        Err(error) => tracing::error!("{error}"),
                    },
                    Err(error) => tracing::error!("the old tokens stay: {error}"),
                }
            }
        }
    }
}

/// How many scenes each line of `tokens` covers; warns of lines that cover none, and of a file that
/// others can read.
///
/// # Errors
/// As [`Tokens::coverage`].
pub fn coverage(
    tokens: &Tokens,
    names: &[String],
    readers: Option<&Tokens>,
) -> Result<Vec<Coverage>, super::tokens::TokensError> {
    let lines = tokens.coverage(names, readers)?;
    for warning in lines.iter().flat_map(Coverage::warnings) {
        tracing::warn!("{warning}");
    }
    if tokens.is_exposed() {
        let file = tokens.file().display();
        tracing::warn!("{file}: other users of this machine can read the tokens (chmod 600)");
    }
    Ok(lines)
}

/// The names of the library's scenes; none, with a warning, where the store does not tell them in
/// time.
pub async fn scene_names(library: &Library) -> Vec<String> {
    let names = library.scene_names(None, usize::MAX);
    let failed = match tokio::time::timeout(NAMES_TIMEOUT, names).await {
        Ok(Ok(names)) => return names,
        Ok(Err(error)) => error.to_string(),
        Err(_) => format!("not listed within {} s", NAMES_TIMEOUT.as_secs()),
    };
    tracing::warn!("tokens are not compared with the library's scenes: {failed}");
    Vec::new()
}

fn stamp(file: &Path) -> Stamp {
    // A file that is not there is told when it is read.
    let metadata = std::fs::metadata(file).ok()?;
    #[cfg(unix)]
    let number = std::os::unix::fs::MetadataExt::ino(&metadata);
    #[cfg(not(unix))]
    let number = 0;
    Some((metadata.modified().ok()?, metadata.len(), number))
}
