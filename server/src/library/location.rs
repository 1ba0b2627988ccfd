//! A folder or URL becomes an object store.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use object_store::aws::{AmazonS3Builder, Checksum, S3ConditionalPut};
use object_store::local::LocalFileSystem;
use object_store::memory::InMemory;
use object_store::prefix::PrefixStore;
use object_store::{ClientOptions, RetryConfig};

use super::{Library, LibraryError};

/// A library for the time of one process, for trials and measurements.
const MEMORY: &str = "memory://";
/// A bucket of a store that speaks S3.
pub(super) const S3: &str = "s3://";
/// Variable of another checksum, or none, for stores that take no SHA-256.
const CHECKSUM: &str = "AWS_CHECKSUM_ALGORITHM";
/// Longest time for one request to a network store, and for reaching it.
const STORE_TIMEOUT: Duration = Duration::from_secs(30);
const STORE_CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// How often, and for how long, a request that failed is tried again.
#[derive(Debug, Clone, Copy)]
struct Patience {
    retries: usize,
    longest: Duration,
}
/// Where viewers wait meanwhile.
const OF_SERVERS: Patience = Patience {
    retries: 4,
    longest: Duration::from_secs(20),
};
/// Where hours of work would be lost: a store may be away for ten seconds.
const OF_COMMANDS: Patience = Patience {
    retries: 7,
    longest: Duration::from_secs(30),
};

impl Library {
    /// Opens the library at `location`: an existing folder, `s3://bucket/prefix`, or `memory://`. A bucket is not asked for
    /// anything yet; endpoint, region and keys come from the environment, by the names that the AWS tools use.
    /// [`Library::check`] tells whether it is a library.
    ///
    /// # Errors
    /// Where there is no folder, for an URL that names no store, and for settings that mean nothing.
    pub fn open(location: &str) -> Result<Self, LibraryError> {
        Self::open_with(location, OF_COMMANDS)
    }

    /// The same for a server, which rather says soon that its store is down.
    pub fn open_to_serve(location: &str) -> Result<Self, LibraryError> {
        Self::open_with(location, OF_SERVERS)
    }

    fn open_with(location: &str, patience: Patience) -> Result<Self, LibraryError> {
        if location == MEMORY {
            return Ok(Self::over(Arc::new(InMemory::new()), location));
        }
        let wrong = |expected: &str, found: String| LibraryError::Location {
            location: location.to_owned(),
            expected: expected.to_owned(),
            found,
        };
        if let Some(bucket) = location.strip_prefix(S3) {
            return s3(location, bucket, patience).map_err(|found| {
                wrong(
                    "s3://bucket/prefix, and AWS_… settings that a client takes",
                    found,
                )
            });
        }
        if let Some((scheme, _)) = location.split_once("://") {
            let expected = "a folder, s3://bucket/prefix or memory://";
            return Err(wrong(expected, format!("a {scheme}:// URL")));
        }
        let folder = Path::new(location);
        match folder.metadata() {
            Ok(metadata) if metadata.is_dir() => {}
            Ok(_) => return Err(wrong("a folder", "a file".to_owned())),
            Err(error) => return Err(wrong("a folder", error.to_string())),
        }
        let store = LocalFileSystem::new_with_prefix(folder)
            .map_err(|error| wrong("a folder that can be read", error.to_string()))?
            // A reference must never reach the disk before the objects that it names.
            .with_fsync(true);
        Ok(Self {
            folder: Some(folder.into()),
            ..Self::over(Arc::new(store), location)
        })
    }

    /// Opens an existing library.
    ///
    /// # Errors
    /// Those of [`Library::open`] and [`Library::check`].
    pub async fn open_existing(location: &str) -> Result<Self, LibraryError> {
        let library = Self::open(location)?;
        library.check().await?;
        Ok(library)
    }

    /// [`Library::open_or_create`], and makes it a library where it is none yet.
    ///
    /// # Errors
    /// Those of [`Library::open_or_create`] and [`Library::make`].
    pub async fn open_or_make(location: &str) -> Result<Self, LibraryError> {
        let library = Self::open_or_create(location)?;
        library.make().await?;
        Ok(library)
    }

    /// Takes all rights of group and others from the root folder, and so from everything in it.
    /// Stores other than a folder have access rules of their own.
    #[cfg(unix)]
    pub fn shut_out_others(&self) -> Result<(), LibraryError> {
        use std::os::unix::fs::PermissionsExt;
        let Some(folder) = &self.folder else {
            return Ok(());
        };
        let failed = |cause| LibraryError::File {
            file: folder.to_path_buf(),
            cause,
        };
        let mode = folder.metadata().map_err(failed)?.permissions().mode();
        if mode & 0o077 == 0 {
            return Ok(());
        }
        let own = std::fs::Permissions::from_mode(mode & 0o700);
        std::fs::set_permissions(folder, own).map_err(failed)
    }

    /// No file modes on this system; the command line refuses the option.
    #[cfg(not(unix))]
    pub fn shut_out_others(&self) -> Result<(), LibraryError> {
        Ok(())
    }

    /// Like [`Library::open`], and makes the folder where there is none.
    pub fn open_or_create(location: &str) -> Result<Self, LibraryError> {
        if !location.contains("://") {
            std::fs::create_dir_all(location).map_err(|error| LibraryError::Location {
                location: location.to_owned(),
                expected: "a folder that can be made".to_owned(),
                found: error.to_string(),
            })?;
        }
        Self::open(location)
    }
}

/// A bucket, or what lies under a prefix in it.
fn s3(location: &str, bucket: &str, patience: Patience) -> Result<Library, String> {
    let (bucket, prefix) = bucket.split_once('/').unwrap_or((bucket, ""));
    if bucket.is_empty() {
        return Err("an URL without a bucket".to_owned());
    }
    // The first one counts: another part of the program may have chosen.
    let _ = rustls::crypto::ring::default_provider().install_default();
    let mut store = AmazonS3Builder::from_env();
    if std::env::var_os(CHECKSUM).is_none() {
        // What is changed on the way up is refused there, and not found by the next verify.
        store = store.with_checksum_algorithm(Checksum::SHA256);
    }
    let store = store
        .with_bucket_name(bucket)
        .with_conditional_put(S3ConditionalPut::ETagMatch)
        .with_retry(RetryConfig {
            max_retries: patience.retries,
            retry_timeout: patience.longest,
            ..RetryConfig::default()
        })
        .with_client_options(
            ClientOptions::new()
                .with_timeout(STORE_TIMEOUT)
                .with_connect_timeout(STORE_CONNECT_TIMEOUT)
                .with_allow_http(allows_http()),
        )
        .build()
        .map_err(|error| error.to_string())?;
    let prefix = prefix.trim_end_matches('/');
    Ok(match prefix {
        "" => Library::over(Arc::new(store), location),
        prefix => Library::over(Arc::new(PrefixStore::new(store, prefix)), location),
    })
}

/// An endpoint without TLS is taken where the environment says so, as for the AWS tools.
fn allows_http() -> bool {
    std::env::var("AWS_ALLOW_HTTP")
        .is_ok_and(|value| value.eq_ignore_ascii_case("true") || value == "1")
}
