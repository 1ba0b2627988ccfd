//! Tokens: each gives its holder the scenes of its line. Their file is read again when it changes;
//! a bad one leaves the old tokens as they are.

use std::collections::HashMap;
use std::fmt::{Display, Formatter};
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};

use axum::http::HeaderMap;
use axum::http::header::AUTHORIZATION;
use lodestream_format::ContentHash;

use super::scene_words::SceneWords;
use super::token_lines::{self, TokenLine};

pub use super::token_lines::TokensError;

/// The tokens of a file; clones share them.
#[derive(Debug, Clone)]
pub struct Tokens(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    file: PathBuf,
    use_of: Use,
    now: RwLock<Arc<Rules>>,
}

/// The use of tokens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Use {
    Read,
    Upload,
}

/// The rules of the file. Tokens are kept as hashes: comparing these tells nothing of how far a
/// guess is right, and looking one up nothing of its line.
#[derive(Debug)]
struct Rules {
    lines: Vec<TokenLine>,
    scopes: HashMap<ContentHash, Scope>,
    /// All that lines name, in lower case.
    named: SceneWords,
}

/// The scenes of a token.
#[derive(Debug)]
enum Scope {
    /// Those that its line names.
    Named(SceneWords),
    /// Its line names none: those that no line of the readers names.
    Unprotected,
}

/// The worth of a request's token for a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Worth {
    /// There is none, or none that is known.
    Unknown,
    /// It is for other scenes.
    Elsewhere,
    /// It is for this one.
    Here,
}

impl Tokens {
    /// Reads `--read-tokens`: each line names the scenes that its token reads, and so protects.
    ///
    /// # Errors
    /// A file that cannot be read, has no token, or a line that means nothing.
    pub fn from_read_file(file: &Path) -> Result<Self, TokensError> {
        Self::new(file, Use::Read)
    }

    /// Reads `--upload-tokens`: the same, but that a token alone is for all that is not protected.
    ///
    /// # Errors
    /// As [`Tokens::from_read_file`].
    pub fn from_upload_file(file: &Path) -> Result<Self, TokensError> {
        Self::new(file, Use::Upload)
    }

    fn new(file: &Path, use_of: Use) -> Result<Self, TokensError> {
        Ok(Self(Arc::new(Shared {
            now: RwLock::new(Arc::new(Rules::read(file, use_of)?)),
            file: file.to_owned(),
            use_of,
        })))
    }

    /// Where they come from.
    pub fn file(&self) -> &Path {
        &self.0.file
    }

    /// Reads the file again. `scenes` are the library's, where they are known.
    ///
    /// # Errors
    /// As the first time, and a token that names a scene: the old tokens stay.
    pub fn read_again(&self, scenes: &[String]) -> Result<(), TokensError> {
        let rules = Rules::read(&self.0.file, self.0.use_of)?;
        self.check_order(&rules, scenes)?;
        *self.0.now.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(rules);
        Ok(())
    }

    /// How many of `scenes`, which are the library's, each line covers; `readers` say what is
    /// protected.
    ///
    /// # Errors
    /// A token that is the name of a scene: its line is the wrong way round, and protects nothing.
    pub fn coverage(
        &self,
        scenes: &[String],
        readers: Option<&Tokens>,
    ) -> Result<Vec<Coverage>, TokensError> {
        let rules = self.rules();
        self.check_order(&rules, scenes)?;
        let does = match self.0.use_of {
            Use::Read => "reads",
            Use::Upload => "uploads to",
        };
        let of_line = |line: &TokenLine| {
            let words = line.words.iter().map(|word| {
                let count = scenes.iter().filter(|scene| word.names(scene)).count();
                (word.to_string(), count)
            });
            let covers = |scene: &&String| match line.words.is_empty() {
                true => !readers.is_some_and(|readers| readers.protects(scene)),
                false => line.words.iter().any(|word| word.names(scene)),
            };
            Coverage {
                file: self.0.file.clone(),
                line: line.number,
                does,
                words: words.collect(),
                scenes: scenes.iter().filter(covers).count(),
            }
        };
        Ok(rules.lines.iter().map(of_line).collect())
    }

    /// Whether users of the machine other than its owner can read the file.
    pub fn is_exposed(&self) -> bool {
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            std::fs::metadata(&self.0.file).is_ok_and(|file| file.mode() & 0o077 != 0)
        }
        #[cfg(not(unix))]
        false
    }

    /// Whether a line names `scene`, in whatever case: some stores do not tell cases apart.
    pub(super) fn protects(&self, scene: &str) -> bool {
        self.rules().named.names(&scene.to_ascii_lowercase())
    }

    /// If the request's token is for all scenes (`*`).
    pub(super) fn covers_all(&self, request: &HeaderMap) -> bool {
        let rules = self.rules();
        let scope = token_of(request).and_then(|token| rules.scopes.get(&token));
        // The empty text begins with the empty prefix alone.
        matches!(scope, Some(Scope::Named(words)) if words.names(""))
    }

    /// The worth of the request's token for `scene`.
    pub(super) fn worth(&self, request: &HeaderMap, scene: &str, is_protected: bool) -> Worth {
        let rules = self.rules();
        let scope = token_of(request).and_then(|token| rules.scopes.get(&token));
        let is_here = |scope: &Scope| match scope {
            Scope::Named(words) => words.names(scene),
            Scope::Unprotected => !is_protected,
        };
        match scope {
            None => Worth::Unknown,
            Some(scope) if is_here(scope) => Worth::Here,
            Some(_) => Worth::Elsewhere,
        }
    }

    fn rules(&self) -> Arc<Rules> {
        // A writer only swaps the pointer.
        let now = self.0.now.read().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(&now)
    }

    fn check_order(&self, rules: &Rules, scenes: &[String]) -> Result<(), TokensError> {
        let is_token = |scene: &&String| {
            let hash = ContentHash::of(scene.as_bytes());
            rules.scopes.contains_key(&hash)
        };
        let Some(scene) = scenes.iter().find(is_token) else {
            return Ok(());
        };
        let token = ContentHash::of(scene.as_bytes());
        let line = rules.lines.iter().find(|line| line.token == token);
        Err(TokensError::Line {
            file: self.0.file.clone(),
            line: line.map_or(0, |line| line.number),
            found: "the name of a scene as token".to_owned(),
        })
    }
}

impl Rules {
    fn read(file: &Path, use_of: Use) -> Result<Self, TokensError> {
        let lines = token_lines::read(file)?;
        let bare = lines.iter().find(|line| line.words.is_empty());
        if let Some(bare) = bare.filter(|_| use_of == Use::Read) {
            return Err(TokensError::Line {
                file: file.to_owned(),
                line: bare.number,
                found: "a token without a scene".to_owned(),
            });
        }
        let scope = |line: &TokenLine| match line.words.is_empty() {
            true => Scope::Unprotected,
            false => Scope::Named(SceneWords::new(line.words.iter().cloned())),
        };
        let words = lines.iter().flat_map(|line| &line.words);
        Ok(Self {
            named: SceneWords::new(words.map(|word| word.to_lower())),
            scopes: lines.iter().map(|line| (line.token, scope(line))).collect(),
            lines,
        })
    }
}

/// How many scenes a line covers now.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Coverage {
    file: PathBuf,
    line: usize,
    does: &'static str,
    /// The line's words, each with its scenes.
    words: Vec<(String, usize)>,
    scenes: usize,
}

impl Coverage {
    /// Warnings for words that cover no scene; it may come later, or the word be a mistake. Not
    /// quoted: it may also be a token.
    pub fn warnings(&self) -> impl Iterator<Item = String> + '_ {
        let idle = (2..)
            .zip(&self.words)
            .filter(|(_, (_, scenes))| *scenes == 0);
        idle.map(|(at, _)| {
            let (file, line) = (self.file.display(), self.line);
            format!("{file}: line {line}: word {at} names no scene of the library")
        })
    }
}

impl Display for Coverage {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let (file, line, does) = (self.file.display(), self.line, self.does);
        write!(f, "{file}: line {line} {does} {} scenes", self.scenes)?;
        if self.words.is_empty() {
            return write!(f, ": all but those that a line of --read-tokens names");
        }
        for (at, (word, scenes)) in (2..).zip(&self.words) {
            let separator = if at == 2 { ":" } else { "," };
            match scenes {
                0 => write!(f, "{separator} word {at} none")?,
                scenes => write!(f, "{separator} {word} {scenes}")?,
            }
        }
        Ok(())
    }
}

/// The hash of the token that a request has; none where it has several.
fn token_of(request: &HeaderMap) -> Option<ContentHash> {
    let mut given = request.get_all(AUTHORIZATION).iter();
    let (Some(only), None) = (given.next(), given.next()) else {
        return None;
    };
    let token = only.as_bytes().strip_prefix(b"Bearer ")?;
    Some(ContentHash::of(token.trim_ascii()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    const FIRST: &str = "0123456789abcdef";
    const SECOND: &str = "fedcba9876543210";

    fn file(folder: &tempfile::TempDir, text: &str) -> PathBuf {
        let file = folder.path().join("tokens");
        std::fs::write(&file, text).expect("writes");
        file
    }

    fn request(values: &[&str]) -> HeaderMap {
        let mut request = HeaderMap::new();
        for value in values {
            let value = HeaderValue::from_str(value).expect("visible");
            request.append(AUTHORIZATION, value);
        }
        request
    }

    fn bearer(token: &str) -> HeaderMap {
        request(&[&format!("Bearer {token}")])
    }

    #[test]
    fn only_one_known_bearer_token_is_worth_anything() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = file(&folder, &format!("# ours\n{FIRST}\n  {SECOND}  \n"));
        let tokens = Tokens::from_upload_file(&file).expect("two");
        for (values, worth) in [
            (&["Bearer 0123456789abcdef"][..], Worth::Here),
            (&["bearer fedcba9876543210"], Worth::Unknown),
            (&["Bearer 0123456789abcde"], Worth::Unknown),
            (&["0123456789abcdef"], Worth::Unknown),
            (&["Basic 0123456789abcdef"], Worth::Unknown),
            (&["Bearer "], Worth::Unknown),
            (&["Bearer"], Worth::Unknown),
            (&["Bearer # ours"], Worth::Unknown),
            (
                &["Bearer 0123456789abcdef", "Bearer 0123456789abcdef"],
                Worth::Unknown,
            ),
            (&["Bearer x", "Bearer 0123456789abcdef"], Worth::Unknown),
            (&[], Worth::Unknown),
        ] {
            let found = tokens.worth(&request(values), "city", false);
            assert_eq!(found, worth, "{values:?}");
        }
        assert!(Tokens::from_read_file(&file).is_err(), "no scenes");
        assert!(Tokens::from_read_file(&folder.path().join("none")).is_err());
    }

    #[test]
    fn a_token_is_worth_something_for_its_scenes_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let text = format!("{FIRST} city acme-*\n# all\n{SECOND} city\n");
        let tokens = Tokens::from_read_file(&file(&folder, &text)).expect("two lines");
        for (scene, is_protected, first, second) in [
            ("rock", false, Worth::Elsewhere, Worth::Elsewhere),
            ("city", true, Worth::Here, Worth::Here),
            ("City", true, Worth::Elsewhere, Worth::Elsewhere),
            ("acme-1", true, Worth::Here, Worth::Elsewhere),
            ("ACME-1", true, Worth::Elsewhere, Worth::Elsewhere),
            ("acme", false, Worth::Elsewhere, Worth::Elsewhere),
        ] {
            assert_eq!(tokens.protects(scene), is_protected, "{scene}");
            assert_eq!(
                tokens.worth(&bearer(FIRST), scene, is_protected),
                first,
                "{scene}"
            );
            assert_eq!(
                tokens.worth(&bearer(SECOND), scene, is_protected),
                second,
                "{scene}"
            );
        }
        let text = format!("{FIRST}\n{SECOND} *\n");
        let uploads = Tokens::from_upload_file(&file(&folder, &text)).expect("two lines");
        let worth = |token, is_protected| uploads.worth(&bearer(token), "city", is_protected);
        assert_eq!(
            (worth(FIRST, false), worth(FIRST, true)),
            (Worth::Here, Worth::Elsewhere)
        );
        assert_eq!(
            (worth(SECOND, false), worth(SECOND, true)),
            (Worth::Here, Worth::Here)
        );
    }

    #[test]
    fn a_file_is_read_again_and_one_that_is_wrong_changes_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = file(&folder, &format!("{FIRST} city\n"));
        let tokens = Tokens::from_read_file(&path).expect("a line");
        let shared = tokens.clone();
        let scenes = ["city".to_owned(), SECOND.to_owned()];
        for bad in [
            "",
            "# none\n",
            &format!("{FIRST} c*ty\n"),
            FIRST,
            &format!("{SECOND} city\n"),
        ] {
            file(&folder, bad);
            let error = tokens.read_again(&scenes).expect_err(bad).to_string();
            assert!(!error.contains(FIRST) && !error.contains(SECOND), "{error}");
            assert_eq!(
                shared.worth(&bearer(FIRST), "city", true),
                Worth::Here,
                "{bad}"
            );
        }
        std::fs::remove_file(&path).expect("removes");
        assert!(tokens.read_again(&scenes).is_err() && tokens.protects("city"));
        file(&folder, "another-token-of-16 rock\n");
        tokens.read_again(&scenes).expect("another line");
        assert_eq!(shared.worth(&bearer(FIRST), "city", true), Worth::Unknown);
        assert!(shared.protects("rock") && !shared.protects("city"));
    }

    #[test]
    fn lines_tell_their_scenes_and_never_their_tokens() {
        let folder = tempfile::tempdir().expect("a folder");
        let scenes = ["acme-1", "acme-2", "city", "rock"].map(str::to_owned);
        let text = format!("{FIRST} acme-* city mistaken-token-1\n\n{SECOND} none\n");
        let readers = Tokens::from_read_file(&file(&folder, &text)).expect("two lines");
        let lines = readers.coverage(&scenes, None).expect("in order");
        let told: Vec<_> = lines.iter().map(Coverage::to_string).collect();
        assert!(
            told[0].ends_with("line 1 reads 3 scenes: acme-* 2, city 1, word 4 none"),
            "{told:?}"
        );
        assert!(
            told[1].ends_with("line 3 reads 0 scenes: word 2 none"),
            "{told:?}"
        );
        let warnings: Vec<_> = lines.iter().flat_map(Coverage::warnings).collect();
        assert!(warnings[0].ends_with("line 1: word 4 names no scene of the library"));
        assert_eq!(warnings.len(), 2);
        let uploads = folder.path().join("uploads");
        std::fs::write(&uploads, format!("{FIRST}\n{SECOND} *\n")).expect("writes");
        let uploads = Tokens::from_upload_file(&uploads).expect("two lines");
        let lines = uploads.coverage(&scenes, Some(&readers)).expect("in order");
        let told: Vec<_> = lines.iter().map(Coverage::to_string).collect();
        assert!(
            told[0].contains("line 1 uploads to 1 scenes: all but"),
            "{told:?}"
        );
        assert!(
            told[1].ends_with("line 2 uploads to 4 scenes: * 4"),
            "{told:?}"
        );
        let turned = [FIRST.to_owned()];
        let error = readers
            .coverage(&turned, None)
            .expect_err("is refused")
            .to_string();
        assert!(
            error.contains("line 1:") && !error.contains(FIRST),
            "{error}"
        );
    }

    #[cfg(unix)]
    #[test]
    fn a_file_that_others_can_read_is_exposed() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a folder");
        let path = file(&folder, &format!("{FIRST} city\n"));
        let tokens = Tokens::from_read_file(&path).expect("a line");
        for (mode, is_exposed) in [(0o600, false), (0o400, false), (0o640, true), (0o604, true)] {
            let mode = std::fs::Permissions::from_mode(mode);
            std::fs::set_permissions(&path, mode).expect("is ours");
            assert_eq!(tokens.is_exposed(), is_exposed);
        }
    }
}
