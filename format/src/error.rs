//! The one error of every reader in this crate.

/// A byte sequence that is not what the format promises: where, what was expected, what was found.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{at}: expected {expected}, found {found}")]
pub struct FormatError {
    /// The place: structure, field, and index where there is one.
    pub at: String,
    /// What the format allows there.
    pub expected: String,
    /// What the bytes say.
    pub found: String,
}

impl FormatError {
    /// Builds the error from anything printable.
    pub fn new(
        at: impl Into<String>,
        expected: impl std::fmt::Display,
        found: impl std::fmt::Display,
    ) -> Self {
        Self {
            at: at.into(),
            expected: expected.to_string(),
            found: found.to_string(),
        }
    }
}

/// Fails with a [`FormatError`] unless `ok` holds. Give `format_args!`, not `format!`: the text is written where it fails only.
pub(crate) fn ensure(
    ok: bool,
    at: impl std::fmt::Display,
    expected: impl std::fmt::Display,
    found: impl std::fmt::Display,
) -> Result<(), FormatError> {
    if ok {
        Ok(())
    } else {
        Err(FormatError::new(at.to_string(), expected, found))
    }
}
