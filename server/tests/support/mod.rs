//! What the tests of this crate share: a small glTF file, made libraries, a running server.
// Each test binary uses its own part of this.
#![allow(dead_code)]

pub mod binary;
pub mod bumps;
pub mod gltf;
pub mod h2;
pub mod made;
pub mod server;
pub mod stores;
pub mod uploads;
pub mod watched;

/// A runtime of two threads for what is not async.
pub fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .expect("a runtime")
}

/// Files below `folder`, by their paths in it.
pub fn files(folder: &std::path::Path) -> Vec<std::path::PathBuf> {
    let mut found = vec![];
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.expect("works").path();
        match path.is_dir() {
            true => found.extend(files(&path)),
            false => found.push(path),
        }
    }
    found.sort();
    found
}

/// Makes files a week old.
pub fn age(paths: &[std::path::PathBuf]) {
    let long_ago = std::time::SystemTime::now() - std::time::Duration::from_secs(7 * 86_400);
    for path in paths {
        let file = std::fs::File::options().write(true).open(path);
        file.and_then(|file| file.set_modified(long_ago))
            .expect("works");
    }
}
