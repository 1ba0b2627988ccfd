//! What can go wrong between a library and the pool.

use lodestream_format::{ContentHash, FormatError};

/// Every failure of the streaming half: where, what was expected, what was found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StreamError {
    /// Neither a URL nor a library folder.
    #[error(
        "{location}: expected an http(s) URL or a library folder with `scenes` in it, found {found}"
    )]
    Location {
        /// What was given.
        location: String,
        /// What is wrong with it.
        found: String,
    },
    /// Bytes that are not what the format promises.
    #[error("{place}: {error}")]
    Format {
        /// URL, path, or object.
        place: String,
        /// The reader's complaint.
        error: FormatError,
    },
    /// Bytes that are not those that the name promises.
    #[error("{place}: expected bytes that hash to {expected}, found {found}")]
    Hash {
        /// URL, path, or object.
        place: String,
        /// The name.
        expected: ContentHash,
        /// Hash of what came.
        found: ContentHash,
    },
    /// Another number of bytes than the asset says; a server that ignores the range is caught before its body is read.
    #[error("{place}: expected {expected_bytes} bytes, found {found_bytes}")]
    Length {
        /// URL, path, or object.
        place: String,
        /// Bytes that the asset says.
        expected_bytes: u64,
        /// Bytes that came, or that the server announced.
        found_bytes: u64,
    },
    /// The server answered, but not with 200.
    #[error("{url}: expected status 200, found {status}")]
    Status {
        /// The place that was asked for.
        url: String,
        /// HTTP status.
        status: u16,
        /// The server's `Retry-After`, seconds.
        retry_after_secs: Option<f64>,
    },
    /// No answer, or one that broke off.
    #[error("{url}: expected a whole answer, found {found}")]
    Http {
        /// The place that was asked for.
        url: String,
        /// The transport's complaint.
        found: String,
    },
    /// More memory than an opening may take.
    #[error(
        "{place}: expected a scene that opens within {most_bytes} bytes of memory (--open-memory), found one that takes {needed_bytes}"
    )]
    Memory {
        /// URL or object.
        place: String,
        /// Bytes allowed.
        most_bytes: u64,
        /// Bytes with the part that did not fit.
        needed_bytes: u64,
    },
    /// An answer that is too slow.
    #[error(
        "{url}: expected at least {least_bytes_a_sec} bytes a second and no pause of {grace_secs} s, found {found_bytes} bytes in {secs:.1} s"
    )]
    Slow {
        /// The place that was asked for.
        url: String,
        /// Bytes a second that would do.
        least_bytes_a_sec: f64,
        /// Seconds that may pass without any.
        grace_secs: f64,
        /// Bytes that came.
        found_bytes: u64,
        /// Seconds since it was asked for.
        secs: f64,
    },
    /// The server sends elsewhere, and nobody follows: another place may be anybody's.
    #[error("{url}: expected status 200, found {status} to {to:?}, which is not followed")]
    Redirect {
        /// The place that was asked for.
        url: String,
        /// HTTP status.
        status: u16,
        /// The server's `Location`.
        to: String,
    },
    /// The library does not have it.
    #[error("{place}: expected it in the library, found nothing")]
    NotFound {
        /// URL or path.
        place: String,
    },
    /// A file that could not be read.
    #[error("{path}: expected a readable file, found {found}")]
    Io {
        /// The file.
        path: String,
        /// The system's complaint.
        found: String,
    },
    /// A pool that cannot hold what must always be resident.
    #[error(
        "page pool: expected at least {needed_bytes} bytes ({root_bytes} for the root pages and {slots} slots of 128 KiB), found {pool_bytes}"
    )]
    Pool {
        /// Bytes asked for.
        pool_bytes: u64,
        /// Bytes of all root pages at their places.
        root_bytes: u64,
        /// Fewest slots.
        slots: u32,
        /// Fewest bytes that would do.
        needed_bytes: u64,
    },
    /// A setting that the source or the machine cannot serve.
    #[error("{setting}: expected {expected}, found {found}")]
    Setting {
        /// The setting.
        setting: &'static str,
        /// What would do.
        expected: String,
        /// What was given.
        found: String,
    },
}

/// When a failed page may be asked for again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Retry {
    /// After the usual back-off.
    BackOff,
    /// Not before this many seconds, as the server said.
    After(f64),
    /// As late as the back-off allows: the same question gets the same answer.
    Late,
}

impl StreamError {
    /// How soon asking again makes sense.
    pub fn retry(&self) -> Retry {
        match self {
            Self::Status {
                retry_after_secs: Some(secs),
                ..
            } => Retry::After(*secs),
            Self::Status { status, .. }
                if (400..500).contains(status) && *status != 408 && *status != 429 =>
            {
                Retry::Late
            }
            Self::NotFound { .. }
            | Self::Format { .. }
            | Self::Memory { .. }
            | Self::Redirect { .. } => Retry::Late,
            _ => Retry::BackOff,
        }
    }

    pub(crate) fn format(place: impl Into<String>) -> impl FnOnce(FormatError) -> Self {
        let place = place.into();
        move |error| Self::Format { place, error }
    }

    pub(crate) fn io(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.display().to_string();
        move |error| match error.kind() {
            std::io::ErrorKind::NotFound => Self::NotFound { place: path },
            _ => Self::Io {
                path,
                found: error.to_string(),
            },
        }
    }
}

/// Checks that `bytes` are what `expected` names.
pub(crate) fn check_hash(
    place: impl FnOnce() -> String,
    expected: &ContentHash,
    bytes: &[u8],
) -> Result<(), StreamError> {
    let found = ContentHash::of(bytes);
    if found == *expected {
        Ok(())
    } else {
        Err(StreamError::Hash {
            place: place(),
            expected: *expected,
            found,
        })
    }
}
