//! Tokens: who holds one of them may do what the file that they come from is for.

use std::path::{Path, PathBuf};

use axum::http::HeaderMap;
use axum::http::header::AUTHORIZATION;
use lodestream_format::ContentHash;

use super::error::HttpError;

/// Shortest token: what can be guessed is none.
const MIN_BYTES: usize = 16;

/// Why there are no tokens.
#[derive(Debug, thiserror::Error)]
pub enum TokensError {
    /// The file cannot be read.
    #[error("{}: cannot read: {cause}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// A line that is no token, or no line at all.
    #[error("{}: expected {expected}, found {found}", file.display())]
    Line {
        /// The file.
        file: PathBuf,
        /// What lines are.
        expected: &'static str,
        /// What is there; never the line itself.
        found: String,
    },
}

/// The hashes of some tokens: comparing these tells nothing of how far a guess is right.
#[derive(Debug, Clone)]
pub struct Tokens(Vec<ContentHash>);

impl Tokens {
    /// Reads a file with a token a line; blank lines and those that begin with `#` are none.
    ///
    /// # Errors
    /// A file that cannot be read, has no token, or one that is too short.
    pub fn read(file: &Path) -> Result<Self, TokensError> {
        let lines = lines(
            file,
            "tokens of 16 bytes or more without spaces, one a line",
        )?;
        let tokens = lines.iter().map(|line| match line.words.is_empty() {
            true => Ok(line.token),
            false => Err(line.wrong(file)),
        });
        tokens.collect::<Result<_, _>>().map(Self)
    }

    /// Fails unless the request has one of the tokens.
    pub(super) fn check(&self, request: &HeaderMap) -> Result<(), HttpError> {
        let token = token_of(request);
        match token.is_some_and(|token| self.0.contains(&token)) {
            true => Ok(()),
            false => Err(HttpError::NoToken),
        }
    }
}

/// Which tokens read which scenes. What no line names is open to all, and who knows the hash of an object has been told it by who may
/// read.
#[derive(Debug, Clone)]
pub struct ReadTokens(Vec<(ContentHash, Vec<String>)>);

impl ReadTokens {
    /// Reads a file with lines of a token and the scenes that it reads, `*` at the end of a name for all that begin so.
    ///
    /// # Errors
    /// As [`Tokens::read`], and a line without a scene.
    pub fn read(file: &Path) -> Result<Self, TokensError> {
        let lines = lines(
            file,
            "lines of a token of 16 bytes or more and scenes that it reads",
        )?;
        let tokens = lines.into_iter().map(|line| match line.words.is_empty() {
            true => Err(line.wrong(file)),
            false => Ok((line.token, line.words)),
        });
        tokens.collect::<Result<_, _>>().map(Self)
    }

    /// Fails unless all may read `scene`, or the request has a token that does.
    pub(super) fn check(&self, request: &HeaderMap, scene: &str) -> Result<(), HttpError> {
        let names = |words: &[String]| {
            words.iter().any(|word| match word.strip_suffix('*') {
                Some(begin) => scene.starts_with(begin),
                None => word == scene,
            })
        };
        let mut readers = self.0.iter().filter(|(_, words)| names(words)).peekable();
        let token = token_of(request);
        match readers.peek().is_none() || readers.any(|(reader, _)| Some(*reader) == token) {
            true => Ok(()),
            false => Err(HttpError::NoToken),
        }
    }
}

/// The hash of the token that a request has.
fn token_of(request: &HeaderMap) -> Option<ContentHash> {
    let given = request.get(AUTHORIZATION)?.as_bytes();
    let token = given.strip_prefix(b"Bearer ")?;
    Some(ContentHash::of(token.trim_ascii()))
}

struct Line {
    number: usize,
    expected: &'static str,
    token: ContentHash,
    words: Vec<String>,
}

impl Line {
    fn wrong(&self, file: &Path) -> TokensError {
        TokensError::Line {
            file: file.to_owned(),
            expected: self.expected,
            found: format!("line {} with {} more words", self.number, self.words.len()),
        }
    }
}

fn lines(file: &Path, expected: &'static str) -> Result<Vec<Line>, TokensError> {
    let text = std::fs::read_to_string(file).map_err(|cause| TokensError::Read {
        file: file.to_owned(),
        cause,
    })?;
    let wrong = |found: String| TokensError::Line {
        file: file.to_owned(),
        expected,
        found,
    };
    let mut lines = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let mut words = line.split_whitespace();
        let Some(token) = words.next().filter(|word| !word.starts_with('#')) else {
            continue;
        };
        if token.len() < MIN_BYTES {
            return Err(wrong(format!("one of {} in line {number}", token.len())));
        }
        lines.push(Line {
            number,
            expected,
            token: ContentHash::of(token.as_bytes()),
            words: words.map(str::to_owned).collect(),
        });
    }
    match lines.is_empty() {
        true => Err(wrong("none".to_owned())),
        false => Ok(lines),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    #[test]
    fn tokens_are_lines_and_only_they_pass() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("tokens");
        let read = |text: &str| {
            std::fs::write(&file, text).expect("writes");
            Tokens::read(&file)
        };
        for bad in ["", "# none\n\n", "short\n", "0123456789abcdef behind it\n"] {
            let error = read(bad).expect_err(bad).to_string();
            assert!(!error.contains("behind") && error.contains("one a line"));
        }
        assert!(Tokens::read(&folder.path().join("none")).is_err());
        let tokens = read("# ours\n0123456789abcdef\n  fedcba9876543210  \n").expect("two");
        for (value, passes) in [
            (Some("Bearer 0123456789abcdef"), true),
            (Some("Bearer fedcba9876543210"), true),
            (Some("Bearer 0123456789abcde"), false),
            (Some("0123456789abcdef"), false),
            (Some("Basic 0123456789abcdef"), false),
            (Some("Bearer "), false),
            (Some("Bearer # ours"), false),
            (None, false),
        ] {
            let mut request = HeaderMap::new();
            if let Some(value) = value {
                request.insert(AUTHORIZATION, HeaderValue::from_static(value));
            }
            assert_eq!(tokens.check(&request).is_ok(), passes, "{value:?}");
        }
    }

    #[test]
    fn scenes_that_a_line_names_are_read_with_its_token_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("tokens");
        let read = |text: &str| {
            std::fs::write(&file, text).expect("writes");
            ReadTokens::read(&file)
        };
        for bad in ["", "0123456789abcdef\n", "short city\n"] {
            assert!(read(bad).is_err(), "{bad}");
        }
        let first = "0123456789abcdef";
        let second = "fedcba9876543210";
        let tokens = read(&format!("{first} city acme-*\n# all\n{second} city\n"));
        let tokens = tokens.expect("two lines");
        for (scene, token, passes) in [
            ("rock", None, true),
            ("rock", Some("unknown"), true),
            ("city", None, false),
            ("city", Some(first), true),
            ("city", Some(second), true),
            ("acme-1", Some(first), true),
            ("acme-1", Some(second), false),
            ("acme", Some(second), true),
        ] {
            let mut request = HeaderMap::new();
            if let Some(token) = token {
                let value = HeaderValue::from_str(&format!("Bearer {token}"));
                request.insert(AUTHORIZATION, value.expect("visible"));
            }
            let found = tokens.check(&request, scene).is_ok();
            assert_eq!(found, passes, "{scene} {token:?}");
        }
    }
}
