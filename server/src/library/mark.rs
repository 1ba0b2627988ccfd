//! The mark that says that a folder or prefix is a library, and of which version.
//!
//! It tells a mistyped path from an empty library. Libraries older than the mark are recognised by
//! their files.

use futures_util::{StreamExt, TryStreamExt};
use lodestream_format::FormatError;
use lodestream_format::library::{
    LIBRARY_VERSION, MARK, MARK_FORMAT, MAX_MARK_BYTES, OBJECTS, SCENES,
};
use object_store::path::Path;
use object_store::{ObjectStoreExt, PutPayload};
use serde::Deserialize;

use super::{LOCK, Library, LibraryError};

/// Most names looked at below `objects/` and `scenes/`, which may be another program's.
const MOST_NAMES: usize = 1000;
/// Most files read to find a reference.
const MOST_REFERENCES: usize = 16;

/// Contents of a location.
#[derive(Debug, PartialEq, Eq)]
enum Place {
    /// A library with its mark.
    Marked,
    /// A library older than the mark.
    Unmarked,
    /// No file.
    Empty,
    /// Other files; the first one found.
    Foreign(String),
}

/// Fields of the mark in every version.
#[derive(Deserialize)]
struct Mark {
    format: String,
    version: u64,
}

impl Library {
    /// Checks that this is a library.
    ///
    /// # Errors
    /// [`LibraryError::Location`] if it is none, [`LibraryError::Damaged`] for a mark of a newer
    /// version and for an invalid one.
    pub async fn check(&self) -> Result<(), LibraryError> {
        match self.place().await? {
            Place::Marked | Place::Unmarked => Ok(()),
            Place::Empty => Err(self.no_library("a library (ingest and copy make one)", "nothing")),
            Place::Foreign(file) => Err(self.no_library("a library", &foreign(&file))),
        }
    }

    /// Writes the mark into an empty location, or into a library older than the mark.
    ///
    /// # Errors
    /// [`LibraryError::Location`] if other files are there, and the errors of [`Library::check`].
    pub async fn make(&self) -> Result<(), LibraryError> {
        match self.place().await? {
            Place::Marked => Ok(()),
            Place::Unmarked | Place::Empty => {
                let path = Path::from(MARK);
                let put = self.store.put(&path, PutPayload::from(encode()));
                put.await.map_err(|error| self.store_error(&path, error))?;
                Ok(())
            }
            Place::Foreign(file) => {
                let expected = "a library, or an empty place to make one";
                Err(self.no_library(expected, &foreign(&file)))
            }
        }
    }

    async fn place(&self) -> Result<Place, LibraryError> {
        if self.is_marked().await? {
            return Ok(Place::Marked);
        }
        match self.unmarked_place().await? {
            // Another writer may have made the library since: its mark is the first file.
            Place::Foreign(_) if self.is_marked().await? => Ok(Place::Marked),
            place => Ok(place),
        }
    }

    async fn is_marked(&self) -> Result<bool, LibraryError> {
        let path = Path::from(MARK);
        let failed = |error| self.store_error(&path, error);
        match self.store.get(&path).await {
            Ok(found) => {
                let checked = match found.meta.size {
                    0..=MAX_MARK_BYTES => check(&found.bytes().await.map_err(failed)?),
                    bytes => Err(no_mark(format!("{bytes} bytes"))),
                };
                checked.map_err(|error| self.damaged(MARK, error))?;
                Ok(true)
            }
            Err(object_store::Error::NotFound { .. }) => Ok(false),
            Err(error) => Err(failed(error)),
        }
    }

    async fn unmarked_place(&self) -> Result<Place, LibraryError> {
        if self.has_object().await? || self.has_scene().await? {
            return Ok(Place::Unmarked);
        }
        let root = Path::default();
        let mut files = self.store.list(None);
        while let Some(file) = files.next().await {
            let file = file.map_err(|error| self.store_error(&root, error))?;
            if file.location.as_ref() != LOCK {
                return Ok(Place::Foreign(file.location.to_string()));
            }
        }
        // Every scene was removed, and gc removed the objects.
        let emptied = self.folder.as_ref().is_some_and(|folder| {
            [SCENES, OBJECTS]
                .iter()
                .all(|name| folder.join(name).is_dir())
        });
        Ok(match emptied {
            true => Place::Unmarked,
            false => Place::Empty,
        })
    }

    /// Whether a readable reference is there: other programs have `scenes/` folders too.
    async fn has_scene(&self) -> Result<bool, LibraryError> {
        let folder = Path::from(SCENES);
        let listed = self.store.list(Some(&folder)).take(MOST_NAMES);
        let small = listed.try_filter(|file| std::future::ready(file.size <= MAX_MARK_BYTES));
        let files: Vec<_> = small
            .take(MOST_REFERENCES)
            .try_collect()
            .await
            .map_err(|error| self.store_error(&folder, error))?;
        for file in files {
            match self
                .reference(file.location.filename().unwrap_or_default())
                .await
            {
                Ok(_) => return Ok(true),
                Err(error) if error.is_missing() => {}
                Err(LibraryError::Damaged { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(false)
    }

    async fn has_object(&self) -> Result<bool, LibraryError> {
        let objects = self.objects().take(MOST_NAMES);
        let named = objects.try_filter(|entry| std::future::ready(entry.hash.is_some()));
        Ok(std::pin::pin!(named).try_next().await?.is_some())
    }

    fn no_library(&self, expected: &str, found: &str) -> LibraryError {
        LibraryError::Location {
            location: self.location.to_string(),
            expected: expected.to_owned(),
            found: found.to_owned(),
        }
    }
}

fn foreign(file: &str) -> String {
    format!("other files ({file})")
}

fn encode() -> String {
    format!("{{\"format\": \"{MARK_FORMAT}\", \"version\": {LIBRARY_VERSION}}}\n")
}

fn no_mark(found: String) -> FormatError {
    let expected = format!(
        "JSON with \"format\": {MARK_FORMAT:?} and a version (without the file, ingest and copy write it anew)"
    );
    FormatError::new("library mark", expected, found)
}

fn check(bytes: &[u8]) -> Result<(), FormatError> {
    let mark: Mark = serde_json::from_slice(bytes).map_err(|error| no_mark(error.to_string()))?;
    if mark.format != MARK_FORMAT {
        return Err(no_mark(format!("format {:?}", mark.format)));
    }
    match mark.version {
        1..=LIBRARY_VERSION => Ok(()),
        found => {
            let expected = format!("at most {LIBRARY_VERSION}, the newest that this program reads");
            Err(FormatError::new("library version", expected, found))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mark_has_golden_bytes_and_nothing_else_passes() {
        let mark = encode();
        assert_eq!(
            mark,
            "{\"format\": \"lodestream-library\", \"version\": 1}\n"
        );
        check(mark.as_bytes()).expect("passes");
        let newer = r#"{"format": "lodestream-library", "version": 2, "shards": 4}"#;
        let error = check(newer.as_bytes()).expect_err("refused").to_string();
        assert!(
            error.contains("at most 1") && error.contains("found 2"),
            "{error}"
        );
        for garbage in [
            "",
            "{}",
            "[]",
            "lodestream-library",
            &mark[..20],
            &mark.replace('1', "0"),
            &mark.replace('1', "-1"),
            &mark.replace('1', "1.5"),
            &mark.replace('1', "\"1\""),
            &mark.replace("lodestream", "another"),
            &(mark.clone() + &mark),
        ] {
            check(garbage.as_bytes()).expect_err(garbage);
        }
        check(&[0xff; 70]).expect_err("no text");
    }
}
