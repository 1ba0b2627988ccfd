//! What is wrong with a file, said once, on one line.

use std::fmt::{Display, Write};
use std::path::{Path, PathBuf};

/// Result of a stage that does not know which file it reads.
pub(super) type Read<T> = Result<T, Fault>;

/// A file that cannot be imported. Its text is one line: file, place, what was expected, what was found.
#[derive(Debug, thiserror::Error)]
#[error("{}: {fault}", one_line(&file.display()))]
pub struct ImportError {
    /// The file that was asked for (not an external file that it names; the fault names that one).
    pub file: PathBuf,
    /// What is wrong in it.
    pub fault: Fault,
}

impl ImportError {
    pub(super) fn new(file: &Path, fault: Fault) -> Self {
        Self {
            file: file.to_owned(),
            fault,
        }
    }
}

/// What is wrong, and where in the document: `meshes[3].primitives[0].attributes.POSITION (accessor 7)`.
#[derive(Clone, Debug, thiserror::Error)]
pub enum Fault {
    /// The bytes or the text break the file's format.
    #[error("{place}: expected {expected}, found {found}")]
    Malformed {
        /// Path in the document.
        place: String,
        /// What the format asks for there.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// Valid perhaps, but beyond this reader.
    #[error("{place}: {what} is not supported; {advice}")]
    Unsupported {
        /// Path in the document.
        place: String,
        /// The extension or feature, by name.
        what: String,
        /// What would make the file readable.
        advice: String,
    },
    /// The operating system refused a file.
    #[error("{place}: cannot read {file}: {cause}")]
    File {
        /// Path in the document of the reference to the file.
        place: String,
        /// The file.
        file: String,
        /// The operating system's reason.
        cause: String,
    },
}

impl Fault {
    /// The fault alone, for a line that names the place itself.
    pub(super) fn reason(&self) -> String {
        match self {
            Self::Malformed {
                expected, found, ..
            } => format!("expected {expected}, found {found}"),
            Self::Unsupported { what, .. } => format!("{what} is not supported"),
            Self::File { file, cause, .. } => format!("cannot read {file}: {cause}"),
        }
    }
}

/// Longest place, and longest text of ours, in characters.
const PLACE_CHARS: usize = 200;
/// Longest text that may be the file's, in characters.
const FOUND_CHARS: usize = 120;
/// Longest quotation, in characters.
const QUOTED_CHARS: usize = 80;

/// A [`Fault::Malformed`]; texts from the file are made printable and short.
pub(super) fn malformed(place: impl Display, expected: impl Display, found: impl Display) -> Fault {
    Fault::Malformed {
        place: shown(&place, PLACE_CHARS),
        expected: shown(&expected, PLACE_CHARS),
        found: shown(&found, FOUND_CHARS),
    }
}

/// A [`Fault::Unsupported`].
pub(super) fn unsupported(place: impl Display, what: impl Display, advice: &str) -> Fault {
    Fault::Unsupported {
        place: shown(&place, PLACE_CHARS),
        what: shown(&what, FOUND_CHARS),
        advice: advice.to_owned(),
    }
}

/// A [`Fault::File`].
pub(super) fn cannot_read(place: impl Display, file: &Path, cause: &std::io::Error) -> Fault {
    Fault::File {
        place: shown(&place, PLACE_CHARS),
        file: shown(&file.display(), PLACE_CHARS),
        cause: shown(cause, PLACE_CHARS),
    }
}

/// A name out of the file, printable and short.
pub(super) fn short(name: &str) -> String {
    shown(&name, QUOTED_CHARS)
}

/// `text` between quotation marks, printable and short.
pub(super) fn quoted(text: &str) -> String {
    format!("\"{}\"", short(text))
}

/// The same of bytes that need not be UTF-8.
pub(super) fn quoted_bytes(bytes: &[u8]) -> String {
    format!("\"{}\"", shown(&bytes.escape_ascii(), QUOTED_CHARS))
}

/// A file's own path, as its caller gave it, on one line.
pub(super) fn one_line(text: &dyn Display) -> String {
    shown(text, 4096)
}

/// Names and values come from the file: what moves a terminal's cursor or turns its text is
/// escaped, and the rest is cut after `most_chars`.
pub(super) fn shown(text: &dyn Display, most_chars: usize) -> String {
    let mut line = Shown {
        line: String::new(),
        left: most_chars,
    };
    // An error means that the line is full; no more of the text is then made.
    if write!(line, "{text}").is_err() {
        line.line.push('…');
    }
    line.line
}

/// A line that takes so many characters.
struct Shown {
    line: String,
    left: usize,
}

impl Write for Shown {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        for character in text.chars() {
            let escaped = character.escape_default();
            let is_plain = !is_unprintable(character);
            let length = if is_plain { 1 } else { escaped.len() };
            self.left = self.left.checked_sub(length).ok_or(std::fmt::Error)?;
            match is_plain {
                true => self.line.push(character),
                false => self.line.extend(escaped),
            }
        }
        Ok(())
    }
}

/// Control characters, the two separators that end a line for many readers, and the marks that
/// turn the direction of text.
fn is_unprintable(character: char) -> bool {
    character.is_control()
        || matches!(character, '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}')
        || matches!(character, '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}')
}

#[cfg(test)]
mod tests {
    use super::{quoted, quoted_bytes, shown};

    #[test]
    fn shown_text_is_short_and_printable() {
        assert_eq!(shown(&"a\u{1b}[0m\n", 20), "a\\u{1b}[0m\\n");
        assert_eq!(shown(&"a\u{202e}b\u{2028}", 40), "a\\u{202e}b\\u{2028}");
        assert_eq!(shown(&"abc", 3), "abc");
        assert_eq!(shown(&"abcd", 3), "abc…");
        let escapes = shown(&"\0".repeat(1000), 80);
        assert!(escapes.chars().count() <= 81, "{escapes}");
        assert_eq!(quoted("näme"), "\"näme\"");
        assert_eq!(quoted_bytes(b"a\xff"), "\"a\\xff\"");
        assert_eq!(quoted_bytes(&[b'a'; 1000]).chars().count(), 83);
    }
}
