//! Names inside a library: the same in a folder, an object store and a URL.
//!
//! ```text
//! library.json        the mark: this is a library, and of which version
//! objects/ab/ab12…   any immutable object, named by its BLAKE3-256
//! scenes/NAME        JSON: which scene object the name points at; swapped atomically
//! ```

use crate::error::{FormatError, ensure};
use crate::hash::ContentHash;
use crate::limits::MAX_SCENE_NAME_BYTES;

/// Path of the mark.
pub const MARK: &str = "library.json";
/// Version of the layout that this program writes, and the newest one that it reads.
pub const LIBRARY_VERSION: u64 = 1;
/// Longest mark that is read.
pub const MAX_MARK_BYTES: u64 = 4096;
/// Value of `format` in the mark of every version.
pub const MARK_FORMAT: &str = "lodestream-library";
/// Folder of the named references.
pub const SCENES: &str = "scenes";
/// Folder of the immutable objects.
pub const OBJECTS: &str = "objects";

/// Path of an object inside a library, `/`-separated.
pub fn object_path(hash: &ContentHash) -> String {
    let name = hash.to_string();
    format!("{OBJECTS}/{}/{name}", &name[..2])
}

/// Path of a scene's reference; fails unless the name is 1 to 200 of `A-Z a-z 0-9 . _ -` and starts with a letter or digit.
pub fn scene_path(name: &str) -> Result<String, FormatError> {
    let allowed = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
    let ok = (1..=MAX_SCENE_NAME_BYTES).contains(&name.len())
        && name.bytes().all(allowed)
        && name.as_bytes()[0].is_ascii_alphanumeric();
    // A stranger's name may have megabytes.
    let start: String = name.chars().take(MAX_SCENE_NAME_BYTES + 1).collect();
    ensure(
        ok,
        "scene name",
        "1 to 200 of A-Z a-z 0-9 . _ -, a letter or digit first",
        format_args!("{start:?}"),
    )?;
    Ok(format!("{SCENES}/{name}"))
}

/// What `scenes/NAME` holds.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct SceneReference {
    /// The scene object that the name points at.
    pub scene: ContentHash,
    /// When it was published, seconds since 1970 UTC.
    pub published_secs: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_could_leave_the_library_are_rejected() {
        for bad in [
            "",
            ".",
            "..",
            "../x",
            "a/b",
            "a\\b",
            ".hidden",
            "a b",
            "ä",
            &"x".repeat(201),
        ] {
            assert!(scene_path(bad).is_err(), "{bad}");
        }
        assert_eq!(scene_path("city-2.v1_b").unwrap(), "scenes/city-2.v1_b");
    }
}
