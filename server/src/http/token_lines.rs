//! Lines of a file of tokens: `TOKEN SCENE...`, where a scene may end with `*`. A line without
//! a meaning is refused by its number, and never quoted: it may be a token.

use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use lodestream_format::ContentHash;

use super::scene_words::SceneWord;

/// Shortest token: what can be guessed is none.
const MIN_TOKEN_BYTES: usize = 16;
/// Longest file.
const MAX_FILE_BYTES: u64 = 16 * 1024 * 1024;
const EXPECTED: &str =
    "TOKEN SCENE..., a token of 16 or more of A-Z a-z 0-9 - . _ ~ + / and scenes";

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
    /// No line with a token.
    #[error("{}: expected lines of {EXPECTED}, found none", file.display())]
    Empty {
        /// The file.
        file: PathBuf,
    },
    /// A line that is not what lines are.
    #[error("{}: line {line}: expected {EXPECTED}, found {found}", file.display())]
    Line {
        /// The file.
        file: PathBuf,
        /// The line, from 1.
        line: usize,
        /// The kind of text that is there; never the text itself.
        found: String,
    },
}

/// A line with a token.
#[derive(Debug)]
pub(super) struct TokenLine {
    /// From 1.
    pub number: usize,
    pub token: ContentHash,
    pub words: Vec<SceneWord>,
}

/// Reads a file; blank lines and those that begin with `#` have no token.
pub(super) fn read(file: &Path) -> Result<Vec<TokenLine>, TokensError> {
    let failed = |cause| TokensError::Read {
        file: file.to_owned(),
        cause,
    };
    let mut text = String::new();
    let opened = File::open(file).map_err(failed)?;
    let read = opened.take(MAX_FILE_BYTES + 1).read_to_string(&mut text);
    if read.map_err(failed)? as u64 > MAX_FILE_BYTES {
        let found = format!("more than {MAX_FILE_BYTES} bytes");
        return Err(failed(std::io::Error::other(found)));
    }
    let mut lines = Vec::new();
    let mut numbers = HashMap::new();
    for (number, text) in (1..).zip(text.split('\n')) {
        let wrong = |found| TokensError::Line {
            file: file.to_owned(),
            line: number,
            found,
        };
        let Some(line) = line(number, text).map_err(wrong)? else {
            continue;
        };
        if let Some(first) = numbers.insert(line.token, number) {
            // Which of the two scopes counts would be a guess.
            return Err(wrong(format!("the token of line {first} again")));
        }
        lines.push(line);
    }
    check_words(file, &lines, &numbers)?;
    match lines.is_empty() {
        true => Err(TokensError::Empty {
            file: file.to_owned(),
        }),
        false => Ok(lines),
    }
}

/// A line of text, or what is wrong with it.
fn line(number: usize, text: &str) -> Result<Option<TokenLine>, String> {
    let text = text.strip_suffix('\r').unwrap_or(text);
    // Some programs show these as ends of lines: a line behind one would hide in a comment.
    let ends_line =
        |it: char| it.is_control() && it != '\t' || matches!(it, '\u{2028}' | '\u{2029}');
    if text.contains(ends_line) {
        return Err("a control character".to_owned());
    }
    let mut words = text.split([' ', '\t']).filter(|word| !word.is_empty());
    let Some(token) = words.next().filter(|word| !word.starts_with('#')) else {
        return Ok(None);
    };
    if token.starts_with('\u{feff}') {
        return Err("a byte order mark".to_owned());
    }
    if !is_token(token) {
        return Err(format!(
            "a first word of {} bytes that is no token",
            token.len()
        ));
    }
    let words = (2..).zip(words).map(|(at, word)| {
        SceneWord::new(word).ok_or_else(|| format!("word {at}, which no scene can be named"))
    });
    Ok(Some(TokenLine {
        number,
        token: ContentHash::of(token.as_bytes()),
        words: words.collect::<Result<_, _>>()?,
    }))
}

/// Whether a header can carry it (RFC 6750, section 2.1), and it is long enough.
fn is_token(word: &str) -> bool {
    let begin = word.trim_end_matches('=');
    let fits = |it: u8| it.is_ascii_alphanumeric() || b"-._~+/".contains(&it);
    word.len() >= MIN_TOKEN_BYTES && !begin.is_empty() && begin.bytes().all(fits)
}

/// That no word is a token: somebody meant something else by that line.
fn check_words(
    file: &Path,
    lines: &[TokenLine],
    numbers: &HashMap<ContentHash, usize>,
) -> Result<(), TokensError> {
    for line in lines {
        for (at, word) in (2..).zip(&line.words) {
            let hash = ContentHash::of(word.to_string().as_bytes());
            if let Some(other) = numbers.get(&hash) {
                return Err(TokensError::Line {
                    file: file.to_owned(),
                    line: line.number,
                    found: format!("word {at}, which is the token of line {other}"),
                });
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIRST: &str = "0123456789abcdef";
    const SECOND: &str = "fedcba9876543210";

    fn of(text: &[u8]) -> Result<Vec<TokenLine>, TokensError> {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("tokens");
        std::fs::write(&file, text).expect("writes");
        read(&file)
    }

    #[test]
    fn lines_are_tokens_and_scenes() {
        let text = format!(
            "# ours\r\n\r\n{FIRST} city\tacme-*\r\n  {SECOND}  \n\t# ä\n~._+/-ABCDEFGHI== *"
        );
        let lines = of(text.as_bytes()).expect("three lines");
        let found: Vec<_> = lines
            .iter()
            .map(|line| (line.number, line.words.len()))
            .collect();
        assert_eq!(found, [(3, 2), (4, 0), (6, 1)]);
        assert_eq!(lines[1].token, ContentHash::of(SECOND.as_bytes()));
    }

    #[test]
    fn lines_that_mean_nothing_are_refused_by_number_and_not_quoted() {
        for (line, found) in [
            ("T secret-*-x", "word 2, which no scene"),
            ("T open secret,open", "word 3, which no scene"),
            ("T secret-plan;", "word 2, which no scene"),
            ("T \"secret\"", "word 2, which no scene"),
            ("T secret # ours", "word 3, which no scene"),
            ("T secret \\", "word 3, which no scene"),
            ("T secret\u{a0}plan", "word 2, which no scene"),
            ("T sеcret", "word 2, which no scene"),
            ("T **", "word 2, which no scene"),
            ("T secret\0", "a control character"),
            ("T secret\rU plan", "a control character"),
            ("# hidden\u{2028}T secret", "a control character"),
            ("# hidden\u{85}T secret", "a control character"),
            ("T\u{b}secret", "a control character"),
            ("\u{feff}T secret", "a byte order mark"),
            ("short secret", "a first word of 5 bytes that is no token"),
            ("secret-plan T", "a first word of 11 bytes"),
            ("\"T\" secret", "a first word of 18 bytes"),
            ("T:secret", "a first word of 23 bytes"),
            ("T=secret", "a first word of 23 bytes"),
            ("Bearer T secret", "a first word of 6 bytes"),
            ("T\u{a0}secret", "a first word of 24 bytes"),
            ("================ secret", "a first word of 16 bytes"),
            ("T secret\nT secret", "the token of line 2 again"),
            ("T secret\nT open", "the token of line 2 again"),
            ("T U secret\nU plan", "word 2, which is the token of line 3"),
            ("T T", "word 2, which is the token of line 2"),
        ] {
            let text = line.replace('T', FIRST).replace('U', SECOND);
            let error = of(format!("# ours\n{text}\n").as_bytes());
            let error = error.expect_err(line).to_string();
            assert!(error.contains(found), "{line:?}: {error}");
            let at = if line.contains('\n') && !line.contains('U') {
                3
            } else {
                2
            };
            assert!(error.contains(&format!("line {at}:")), "{line:?}: {error}");
            for secret in [FIRST, SECOND, "secret", "open"] {
                assert!(!error.contains(secret), "{line:?}: {error}");
            }
        }
        for empty in ["", "\n\n", "# none\n", "#0123456789abcdef secret"] {
            let error = of(empty.as_bytes()).expect_err(empty).to_string();
            assert!(error.ends_with("found none"), "{error}");
        }
        let utf16: Vec<u8> = FIRST.encode_utf16().flat_map(u16::to_le_bytes).collect();
        assert!(of(&utf16).is_err() && of(b"\xff\xfe").is_err());
        let long = vec![b'#'; MAX_FILE_BYTES as usize + 1];
        let error = of(&long).expect_err("too long").to_string();
        assert!(error.contains("more than"), "{error}");
    }
}
