//! Files of tokens of the built binary: what it refuses, tells and warns of, and that it reads them
//! again.
// A failed expectation is the test's failure.
#![cfg(unix)]
#![allow(clippy::unwrap_used)]

mod support;

use std::io::{BufRead, BufReader, Read};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

use lodestream_server::library::Library;
use support::binary::{command, fails, text};
use support::{made, runtime, server};

const FIRST: &str = "reader-of-the-city-1";
const SECOND: &str = "reader-of-the-city-2";

/// A library of the scenes `open`, `secret-a` and `secret-b`, and a file of tokens.
struct Stand {
    folder: tempfile::TempDir,
}

impl Stand {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        runtime().block_on(async {
            let library = folder.path().join("library");
            let library = Library::open_or_create(text(&library)).unwrap();
            let asset = made::asset(&library, 1, 3, 100).await;
            for name in ["open", "secret-a", "secret-b"] {
                made::scene(&library, name, std::slice::from_ref(&asset)).await;
            }
        });
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Replaces the file at once, as editors and secret stores do.
    fn write(&self, name: &str, tokens: &str) {
        let (new, file) = (self.path("new"), self.path(name));
        std::fs::write(&new, tokens).unwrap();
        std::fs::set_permissions(&new, std::fs::Permissions::from_mode(0o600)).unwrap();
        std::fs::rename(new, file).unwrap();
    }

    fn args(&self) -> Vec<String> {
        let text = |path: &Path| path.to_str().unwrap().to_owned();
        let (library, readers) = (self.path("library"), self.path("readers"));
        let args = ["serve", "--listen", "127.0.0.1:0", "--library"];
        let mut args = args.map(str::to_owned).to_vec();
        args.extend([text(&library), "--read-tokens".to_owned(), text(&readers)]);
        let uploaders = self.path("uploaders");
        if uploaders.exists() {
            args.extend(["--upload-tokens".to_owned(), text(&uploaders)]);
        }
        args
    }

    /// Serves; gives the lines that it begins with.
    fn serve(&self, lines: usize) -> (Serving, Vec<String>) {
        let args = self.args();
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        let mut child = command(&args)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(child.stdout.take().unwrap());
        let mut line = || {
            let mut line = String::new();
            said.read_line(&mut line).unwrap();
            line.trim().to_owned()
        };
        let first = line();
        let url = first.strip_prefix("listening on ").unwrap().to_owned();
        let told = (0..lines).map(|_| line()).collect();
        let serving = Serving {
            child,
            url,
            _said: said,
        };
        (serving, told)
    }
}

struct Serving {
    child: Child,
    url: String,
    _said: BufReader<ChildStdout>,
}

impl Serving {
    fn signal(&self, signal: &str) {
        let kill = Command::new("kill")
            .args([signal, &self.child.id().to_string()])
            .status();
        assert!(kill.unwrap().success());
    }

    /// Stops it; gives what it said on standard error.
    fn stop(mut self) -> String {
        self.signal("-TERM");
        let mut said = String::new();
        let stderr = self.child.stderr.as_mut().unwrap();
        stderr.read_to_string(&mut said).unwrap();
        assert_eq!(self.child.wait().unwrap().code(), Some(0), "{said}");
        said
    }

    fn status(&self, scene: &str, token: &str) -> u16 {
        runtime().block_on(async {
            let url = format!("{}/v1/scenes/{scene}", self.url);
            let request = server::client().get(url).bearer_auth(token);
            request.send().await.unwrap().status().as_u16()
        })
    }

    /// Waits until the token reads the scene.
    fn reads_at_last(&self, scene: &str, token: &str) {
        for _ in 0..600 {
            if self.status(scene, token) == 200 {
                return;
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        panic!("{scene} is not read within 30 s");
    }
}

#[test]
fn a_file_with_a_line_that_means_nothing_is_no_start() {
    let stand = Stand::new();
    let swapped = "secret-a-0123456789";
    runtime().block_on(async {
        let library = Library::open(text(&stand.path("library"))).unwrap();
        let scene = library.reference("open").await.unwrap().scene;
        library.publish(swapped, scene).await.unwrap();
    });
    for (line, found) in [
        (format!("{FIRST} secret-*-x"), "word 2, which no scene"),
        (format!("{FIRST} secret-a,open"), "word 2, which no scene"),
        (format!("{FIRST} secret-a;"), "word 2, which no scene"),
        (FIRST.to_owned(), "a token without a scene"),
        (format!("{swapped} {FIRST}"), "the name of a scene as token"),
    ] {
        stand.write("readers", &format!("# ours\n{SECOND} open\n{line}\n"));
        let args = stand.args();
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        fails(&args, 1, &["readers: line 3: expected TOKEN SCENE", found]);
        let said = command(&args).output().unwrap();
        let said = String::from_utf8_lossy(&said.stderr).into_owned();
        assert!(!said.contains(FIRST) && !said.contains(SECOND), "{said}");
    }
}

#[test]
fn each_line_tells_its_scenes_at_the_start() {
    let stand = Stand::new();
    stand.write(
        "readers",
        &format!("{FIRST} secret-* open\n{SECOND} later\n"),
    );
    stand.write("uploaders", &format!("{FIRST}\n{SECOND} *\n"));
    let open_to_all = std::fs::Permissions::from_mode(0o644);
    std::fs::set_permissions(stand.path("uploaders"), open_to_all).unwrap();
    let (serving, told) = stand.serve(4);
    let ends = [
        "readers: line 1 reads 3 scenes: secret-* 2, open 1",
        "readers: line 2 reads 0 scenes: word 2 none",
        "uploaders: line 1 uploads to 0 scenes: all but those that a line of --read-tokens names",
        "uploaders: line 2 uploads to 3 scenes: * 3",
    ];
    for (line, end) in told.iter().zip(ends) {
        assert!(line.ends_with(end), "{line}");
    }
    let said = serving.stop();
    assert!(
        said.contains("readers: line 2: word 2 names no scene"),
        "{said}"
    );
    assert!(
        said.contains("uploaders: other users of this machine can read"),
        "{said}"
    );
    assert!(!said.contains("readers: other users"), "{said}");
    let all = told.join(" ") + &said;
    assert!(!all.contains(FIRST) && !all.contains(SECOND), "{all}");
}

#[test]
fn tokens_are_read_again_and_a_bad_file_keeps_the_old_ones() {
    let stand = Stand::new();
    stand.write("readers", &format!("{FIRST} secret-*\n"));
    let (serving, _) = stand.serve(1);
    assert_eq!(serving.status("secret-a", FIRST), 200);
    assert_eq!(serving.status("secret-a", SECOND), 401);
    // Told to.
    stand.write("readers", &format!("{SECOND} secret-*\n"));
    serving.signal("-HUP");
    serving.reads_at_last("secret-a", SECOND);
    assert_eq!(serving.status("secret-a", FIRST), 401);
    for bad in ["", &format!("{FIRST} secret-*-x\n"), &format!("{FIRST}\n")] {
        stand.write("readers", bad);
        serving.signal("-HUP");
    }
    std::fs::remove_file(stand.path("readers")).unwrap();
    serving.signal("-HUP");
    // By itself.
    stand.write("readers", &format!("{FIRST} secret-* open\n"));
    serving.reads_at_last("secret-b", FIRST);
    assert_eq!(serving.status("open", ""), 401);
    // Signals that follow each other soon are one, so that a bad file may never have been read.
    let said = serving.stop();
    assert!(!said.contains(FIRST) && !said.contains(SECOND), "{said}");
}

#[test]
fn a_bad_file_is_told_and_the_old_tokens_stay() {
    let stand = Stand::new();
    stand.write("readers", &format!("{FIRST} secret-*\n"));
    let (mut serving, _) = stand.serve(1);
    stand.write("readers", &format!("{SECOND} secret-*\n{SECOND} open\n"));
    serving.signal("-HUP");
    let mut said = BufReader::new(serving.child.stderr.take().unwrap());
    let mut line = String::new();
    said.read_line(&mut line).unwrap();
    let found = "the old tokens stay: ";
    assert!(
        line.contains(found) && line.contains("the token of line 1 again"),
        "{line}"
    );
    assert_eq!(serving.status("secret-a", FIRST), 200);
    assert_eq!(serving.status("secret-a", SECOND), 401);
    serving.signal("-TERM");
    assert_eq!(serving.child.wait().unwrap().code(), Some(0));
}
