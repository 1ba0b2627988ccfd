//! What goes to standard output and error.

use std::io::{self, Write};
use std::path::Path;

use super::commands::CommandError;

/// Prints a line. A reader that is gone is no failure of the command.
pub(super) fn line(text: impl std::fmt::Display) {
    let _ = writeln!(io::stdout().lock(), "{text}");
}

/// The one line of an error; line breaks and control characters of whatever it quotes become
/// spaces.
pub(super) fn error_line(text: &str) {
    let line = text.replace(char::is_control, " ");
    let _ = writeln!(io::stderr().lock(), "error: {}", line.trim_end());
}

/// Writes `--report FILE`.
pub(super) fn report(
    file: Option<&Path>,
    report: &impl serde::Serialize,
) -> Result<(), CommandError> {
    let Some(file) = file else { return Ok(()) };
    let failed = |cause: io::Error| CommandError::Report {
        file: file.to_owned(),
        cause,
    };
    let mut json = serde_json::to_vec_pretty(report).map_err(|error| failed(error.into()))?;
    json.push(b'\n');
    std::fs::write(file, json).map_err(failed)
}
