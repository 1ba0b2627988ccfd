//! The built program taking uploads, and a client that sends them.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

use reqwest::Response;
use serde_json::Value;

use super::binary::{command, ok};
use super::server::client;

/// A token that uploads.
pub const TOKEN: &str = "a-token-of-this-test";

/// A server; killed when this is dropped.
pub struct Serving {
    pub child: Child,
    pub url: String,
    pub folder: tempfile::TempDir,
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Serving {
    /// Starts one over a library with the scene `base`.
    pub fn start(arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().expect("works");
        let path = |name: &str| folder.path().join(name).to_str().expect("works").to_owned();
        std::fs::write(path("tokens"), format!("# ours\n{TOKEN}\n")).expect("works");
        std::fs::create_dir(path("scratch")).expect("works");
        // A library that is there: serving makes none.
        std::fs::write(path("base.obj"), sheet(4)).expect("works");
        let library = path("library");
        ok(&[
            "ingest",
            &path("base.obj"),
            "--library",
            &library,
            "--scene",
            "base",
            "-q",
        ]);
        Self::over(folder, arguments)
    }

    /// Starts one over a folder with a library, `tokens` and `scratch`.
    pub fn over(folder: tempfile::TempDir, arguments: &[&str]) -> Self {
        let path = |name: &str| folder.path().join(name).to_str().expect("works").to_owned();
        let library = path("library");
        let mut child = command(&["serve", "--library", &library, "--listen", "127.0.0.1:0"])
            .args(["--upload-tokens", &path("tokens")])
            .args(["--upload-scratch", &path("scratch")])
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("works");
        let mut line = String::new();
        BufReader::new(child.stdout.as_mut().expect("works"))
            .read_line(&mut line)
            .expect("works");
        let url = line
            .trim()
            .strip_prefix("listening on ")
            .expect("works")
            .to_owned();
        Self { child, url, folder }
    }

    /// Kills the server; gives the folder that it ran over.
    pub fn kill(mut self) -> tempfile::TempDir {
        self.child.kill().expect("works");
        self.child.wait().expect("works");
        std::mem::replace(&mut self.folder, tempfile::tempdir().expect("works"))
    }

    /// Sends a model.
    pub async fn put(
        &self,
        path: &str,
        token: Option<&str>,
        body: impl Into<reqwest::Body>,
    ) -> Response {
        let mut request = client().put(format!("{}{path}", self.url)).body(body);
        if let Some(token) = token {
            request = request.bearer_auth(token);
        }
        request.send().await.expect("works")
    }

    /// Folders of uploads that are on their way.
    pub fn on_their_way(&self) -> Vec<PathBuf> {
        let entries = |folder: &Path| {
            let entries = std::fs::read_dir(folder).expect("works");
            let paths = entries.map(|entry| entry.expect("works").path());
            paths.filter(|path| path.is_dir())
        };
        let servers: Vec<PathBuf> = entries(&self.folder.path().join("scratch")).collect();
        servers.iter().flat_map(|server| entries(server)).collect()
    }
}

/// A waved sheet of `2 n n` triangles as .obj.
pub fn sheet(n: u32) -> String {
    let mut text = String::new();
    for at in 0..(n + 1) * (n + 1) {
        let (x, z) = (at % (n + 1), at / (n + 1));
        text += &format!(
            "v {x} {} {z}\n",
            (0.3 * f64::from(x)).sin() * (0.2 * f64::from(z)).cos()
        );
    }
    for at in (1..=(n + 1) * n).filter(|at| at % (n + 1) != 0) {
        text += &format!(
            "f {at} {} {}\nf {} {} {}\n",
            at + n + 1,
            at + 1,
            at + 1,
            at + n + 1,
            at + n + 2
        );
    }
    text
}

/// Events of an answer, by name.
pub fn events(text: &str) -> Vec<(String, Value)> {
    let event = |block: &str| {
        let (name, data) = block.split_once('\n')?;
        let name = name.strip_prefix("event: ")?.to_owned();
        Some((
            name,
            serde_json::from_str(data.strip_prefix("data: ")?).ok()?,
        ))
    };
    text.split("\n\n").filter_map(event).collect()
}
