//! Words that name scenes in files of tokens: a name, or with `*` at the end all names that begin
//! so.

use std::collections::HashSet;
use std::fmt::{Display, Formatter};

use lodestream_format::library::scene_path;

/// A word that some scene's name fits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct SceneWord {
    begin: String,
    is_prefix: bool,
}

impl SceneWord {
    /// Reads a word; none where no scene can be named so. `*` alone names all scenes.
    pub(super) fn new(word: &str) -> Option<Self> {
        let (begin, is_prefix) = match word.strip_suffix('*') {
            Some(begin) => (begin, true),
            None => (word, false),
        };
        // Each beginning of a name is a name itself.
        let fits = is_prefix && begin.is_empty() || scene_path(begin).is_ok();
        fits.then(|| Self {
            begin: begin.to_owned(),
            is_prefix,
        })
    }

    /// Whether it names `scene`.
    pub(super) fn names(&self, scene: &str) -> bool {
        match self.is_prefix {
            true => scene.starts_with(&self.begin),
            false => scene == self.begin,
        }
    }

    /// The same in lower case.
    pub(super) fn to_lower(&self) -> Self {
        Self {
            begin: self.begin.to_ascii_lowercase(),
            is_prefix: self.is_prefix,
        }
    }
}

impl Display for SceneWord {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}{}", self.begin, if self.is_prefix { "*" } else { "" })
    }
}

/// Many words; a look costs the same however many they are, nearly.
#[derive(Debug, Default)]
pub(super) struct SceneWords {
    names: HashSet<String>,
    /// In order; none begins with another one.
    prefixes: Vec<String>,
}

impl SceneWords {
    pub(super) fn new(words: impl IntoIterator<Item = SceneWord>) -> Self {
        let mut all = Self::default();
        for word in words {
            match word.is_prefix {
                true => all.prefixes.push(word.begin),
                false => drop(all.names.insert(word.begin)),
            }
        }
        all.prefixes.sort_unstable();
        all.prefixes
            .dedup_by(|later, earlier| later.starts_with(&**earlier));
        all
    }

    /// Whether one of the words names `scene`.
    pub(super) fn names(&self, scene: &str) -> bool {
        // All that lies between a prefix of `scene` and `scene` itself begins with that prefix.
        let after = self.prefixes.partition_point(|prefix| &**prefix <= scene);
        let last = after.checked_sub(1).map(|last| &*self.prefixes[last]);
        last.is_some_and(|prefix| scene.starts_with(prefix)) || self.names.contains(scene)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn words_that_no_scene_can_be_named_are_none() {
        for good in ["a", "A-1._", "a*", "*", &"x".repeat(200), "secret-plan*"] {
            assert_eq!(SceneWord::new(good).expect(good).to_string(), good);
        }
        for bad in [
            "",
            "**",
            "a**",
            "secret-*-x",
            "*a",
            "secret,open",
            "secret-plan;",
            "\"secret\"",
            "'secret'",
            "-secret",
            ".secret*",
            "secret/plan",
            "sécret",
            "sеcret",
            "secret\u{a0}",
            "secret\u{200b}",
            "\u{feff}secret",
            "secret\0",
            "secret?",
            "#secret",
            "\\",
            &"x".repeat(201),
        ] {
            assert_eq!(SceneWord::new(bad), None, "{bad:?}");
        }
    }

    proptest! {
        #[test]
        fn all_words_together_name_what_one_of_them_does(
            words in prop::collection::vec("[ab]{1,3}[*]?|[*]", 0..8),
            scene in "[abc]{1,4}",
        ) {
            let words: Vec<_> = words.iter().filter_map(|word| SceneWord::new(word)).collect();
            let expected = words.iter().any(|word| word.names(&scene));
            prop_assert_eq!(SceneWords::new(words).names(&scene), expected);
        }
    }
}
