//! Panics of commands: one line like any other error, without a backtrace.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::OnceLock;

use super::commands::CommandError;

/// The first panic of this process; those of other threads follow from it.
static FIRST: OnceLock<String> = OnceLock::new();

/// Gives a panic of `run`, on whatever thread it was, as an error.
pub(super) fn guarded<T>(run: impl FnOnce() -> Result<T, CommandError>) -> Result<T, CommandError> {
    std::panic::set_hook(Box::new(|panic| {
        let text = panic.payload_as_str().unwrap_or("a panic without a text");
        let place = panic.location().map(|it| (it.file(), it.line()));
        FIRST.get_or_init(|| told(text, place));
    }));
    // Nothing of it is used afterwards.
    let outcome = catch_unwind(AssertUnwindSafe(run));
    let first = FIRST.get().map(String::as_str);
    match outcome {
        Err(_) => {
            let text = first.unwrap_or("a panic without a text");
            Err(CommandError::Internal(text.to_owned()))
        }
        Ok(done) => {
            // One that a task kept to itself.
            if let Some(text) = first {
                tracing::error!("internal error: {text}");
            }
            done
        }
    }
}

/// `index out of bounds (mesh.rs:12)`: neither folders of the machine that built this nor a long
/// quotation.
fn told(text: &str, place: Option<(&str, u32)>) -> String {
    const MOST_CHARS: usize = 200;
    let plain = |character: char| match character.is_control() {
        true => ' ',
        false => character,
    };
    let mut line: String = text.chars().take(MOST_CHARS).map(plain).collect();
    if let Some((file, number)) = place {
        let name = Path::new(file).file_name().unwrap_or_default().display();
        line.push_str(&format!(" ({name}:{number})"));
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_become_errors_of_one_line() {
        let indices: Vec<usize> = vec![7];
        let run = || -> Result<(), CommandError> {
            // As builds run: on another thread.
            rayon::join(
                || (),
                || assert!(indices.is_empty(), "first\nsecond {indices:?}"),
            );
            Ok(())
        };
        let error = guarded(run).expect_err("a panic").to_string();
        drop(std::panic::take_hook());
        assert!(
            error.starts_with("internal error: first second [7] (panics.rs:"),
            "{error}"
        );
    }

    #[test]
    fn places_are_told_without_folders() {
        assert_eq!(told("a", Some(("/root/x/y.rs", 3))), "a (y.rs:3)");
        assert_eq!(told(&"a".repeat(999), None).len(), 200);
    }
}
