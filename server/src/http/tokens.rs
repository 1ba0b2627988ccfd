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
    #[error("{}: expected tokens of {MIN_BYTES} bytes or more without spaces, one a line, found {found}", file.display())]
    Line {
        /// The file.
        file: PathBuf,
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
        let text = std::fs::read_to_string(file).map_err(|cause| TokensError::Read {
            file: file.to_owned(),
            cause,
        })?;
        let wrong = |found: String| TokensError::Line {
            file: file.to_owned(),
            found,
        };
        let mut tokens = Vec::new();
        for (number, line) in (1..).zip(text.lines()) {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            if line.len() < MIN_BYTES || line.contains(char::is_whitespace) {
                return Err(wrong(format!("line {number} of {} bytes", line.len())));
            }
            tokens.push(ContentHash::of(line.as_bytes()));
        }
        match tokens.is_empty() {
            true => Err(wrong("none".to_owned())),
            false => Ok(Self(tokens)),
        }
    }

    /// Fails unless the request has one of the tokens.
    pub(super) fn check(&self, request: &HeaderMap) -> Result<(), HttpError> {
        let given = request.get(AUTHORIZATION).map(|value| value.as_bytes());
        let token = given.and_then(|given| given.strip_prefix(b"Bearer "));
        let hash = token.map(|token| ContentHash::of(token.trim_ascii()));
        match hash.is_some_and(|hash| self.0.contains(&hash)) {
            true => Ok(()),
            false => Err(HttpError::NoToken),
        }
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
        for bad in ["", "# none\n\n", "short\n", "with a space in the middle\n"] {
            let error = read(bad).expect_err(bad).to_string();
            assert!(!error.contains("space in") && error.contains("one a line"));
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
}
