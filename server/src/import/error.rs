//! What is wrong with a file, said once, on one line.

use std::fmt::Display;
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
#[derive(Debug, thiserror::Error)]
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

/// A [`Fault::Malformed`]; texts from the file are made printable and short.
pub(super) fn malformed(place: impl Display, expected: impl Display, found: impl Display) -> Fault {
    Fault::Malformed {
        place: one_line(&place),
        expected: one_line(&expected),
        found: one_line(&found),
    }
}

/// A [`Fault::Unsupported`].
pub(super) fn unsupported(place: impl Display, what: impl Display, advice: &str) -> Fault {
    Fault::Unsupported {
        place: one_line(&place),
        what: one_line(&what),
        advice: advice.to_owned(),
    }
}

/// A [`Fault::File`].
pub(super) fn cannot_read(place: impl Display, file: &Path, cause: &std::io::Error) -> Fault {
    Fault::File {
        place: one_line(&place),
        file: one_line(&file.display()),
        cause: one_line(cause),
    }
}

/// Names and values come from the file: control characters are escaped and the rest is cut, so that an error stays one line.
pub(super) fn one_line(text: &dyn Display) -> String {
    const LONGEST: usize = 400;
    let text = text.to_string();
    let mut line = String::with_capacity(text.len().min(LONGEST));
    for (at, character) in text.chars().enumerate() {
        if at == LONGEST {
            line.push('…');
            break;
        }
        // The two separators end a line for many readers without being control characters.
        if character.is_control() || matches!(character, '\u{2028}' | '\u{2029}') {
            line.extend(character.escape_default());
        } else {
            line.push(character);
        }
    }
    line
}
