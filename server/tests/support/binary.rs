//! Running the built binary, and a library that it made.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use serde_json::Value;

use super::gltf;

pub fn command(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-server"));
    command.args(args).env_remove("RUST_LOG");
    command
}

pub fn run(args: &[&str]) -> Output {
    command(args).output().expect("works")
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).expect("works")
}

/// Runs what must succeed; gives its standard output.
pub fn ok(args: &[&str]) -> String {
    let output = run(args);
    assert_eq!(
        output.status.code(),
        Some(0),
        "{args:?}: {}",
        stderr(&output)
    );
    String::from_utf8(output.stdout).expect("works")
}

/// Runs what must fail with `code` and one line that has all of `words`.
pub fn fails(args: &[&str], code: i32, words: &[&str]) {
    let output = run(args);
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {text}");
    assert_eq!(text.lines().count(), 1, "{args:?}: {text}");
    assert!(text.starts_with("error: "), "{args:?}: {text}");
    for word in words {
        assert!(text.contains(word), "{args:?}: {word:?} in {text}");
    }
}

pub fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("works")).expect("works")
}

/// An ingested library, built once for all tests of a process, copied by those that damage it.
pub fn ingested() -> &'static (tempfile::TempDir, Value) {
    static LIBRARY: OnceLock<(tempfile::TempDir, Value)> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        let folder = tempfile::tempdir().expect("works");
        let model = gltf::write(folder.path());
        let (library, report) = (
            folder.path().join("library"),
            folder.path().join("report.json"),
        );
        ok(&[
            "ingest",
            text(&model),
            "--library",
            text(&library),
            "--scene",
            "pair",
            "--report",
            text(&report),
        ]);
        let report = json(&report);
        (folder, report)
    })
}

pub fn text(path: &Path) -> &str {
    path.to_str().expect("works")
}

pub fn copy_of_library() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("works");
    let to = folder.path().join("library");
    copy(&ingested().0.path().join("library"), &to);
    (folder, to)
}

pub fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("works");
    for entry in std::fs::read_dir(from).expect("works") {
        let entry = entry.expect("works");
        let target = to.join(entry.file_name());
        match entry.file_type().expect("works").is_dir() {
            true => copy(&entry.path(), &target),
            false => drop(std::fs::copy(entry.path(), target).expect("works")),
        }
    }
}
