//! Which crate may use what (docs/ARCHITECTURE.md, "Edges"), checked against every Cargo.toml and every source file.
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Names under `[dependencies]` of a crate.
fn dependencies(folder: &str) -> Vec<String> {
    let text = fs::read_to_string(root().join(folder).join("Cargo.toml")).unwrap();
    text.lines()
        .skip_while(|line| *line != "[dependencies]")
        .skip(1)
        .take_while(|line| !line.starts_with('['))
        .filter_map(|line| line.split(['.', ' ', '=']).next().map(str::to_owned))
        .filter(|name| !name.is_empty() && !name.starts_with('#'))
        .collect()
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files
}

#[test]
fn crates_depend_only_downwards() {
    for (folder, allowed) in [
        ("format", &[][..]),
        ("shaders", &["format"]),
        ("server", &["format"]),
        ("client", &["format", "shaders"]),
        ("loadtests", &["format", "shaders", "client", "server"]),
    ] {
        let used: Vec<_> = dependencies(folder)
            .iter()
            .filter_map(|name| name.strip_prefix("lodestream-").map(str::to_owned))
            .collect();
        assert_eq!(used, sorted(allowed), "{folder}");
    }
}

fn sorted(names: &[&str]) -> Vec<String> {
    let mut names: Vec<_> = names.iter().map(|name| name.to_string()).collect();
    names.sort();
    names
}

#[test]
fn heavy_packages_have_one_home() {
    for (package, homes) in [
        ("wgpu", &["client"][..]),
        ("winit", &["client"]),
        ("axum", &["server"]),
        ("gltf", &["server"]),
        // The load tests hold its clusterlod against our builder.
        ("meshopt", &["server", "loadtests"]),
        ("metis", &["loadtests"]),
    ] {
        for folder in ["format", "shaders", "server", "client", "loadtests"] {
            let named = dependencies(folder).iter().any(|name| name == package);
            assert_eq!(named, homes.contains(&folder), "{package} in {folder}");
        }
    }
    for package in ["tokio", "wgpu", "axum"] {
        assert!(
            !dependencies("format").iter().any(|name| name == package),
            "format uses {package}"
        );
    }
}

/// The stream half runs without a GPU: it names neither wgpu nor winit.
#[test]
fn the_stream_half_knows_no_gpu() {
    for file in sources(&root().join("client/src/stream")) {
        let text = fs::read_to_string(&file).unwrap();
        for package in ["wgpu", "winit", "crate::gpu"] {
            assert!(
                !text.contains(package),
                "{} names {package}",
                file.display()
            );
        }
    }
}

/// The byte-exact specification names every magic and every limit as the code has it.
#[test]
fn format_md_states_the_constants() {
    use lodestream_format::{disk_form, hierarchy, limits, memory_form, wire};
    let text = fs::read_to_string(root().join("format/FORMAT.md")).unwrap();
    let magic = |word: u32| String::from_utf8(word.to_le_bytes().to_vec()).unwrap();
    for phrase in [
        format!("`{}`", magic(memory_form::MAGIC)),
        format!("`{}`", magic(disk_form::MAGIC)),
        format!("`{}`", magic(hierarchy::MAGIC)),
        format!("PAGE_BYTES = {}", limits::PAGE_BYTES),
        format!("MAX_CLUSTER_TRIANGLES = {}", limits::MAX_CLUSTER_TRIANGLES),
        format!("MAX_CLUSTER_VERTICES = {}", limits::MAX_CLUSTER_VERTICES),
        format!("MAX_PAGE_CLUSTERS = {}", limits::MAX_PAGE_CLUSTERS),
        format!("MAX_GROUP_PARTS = {}", limits::MAX_GROUP_PARTS),
        format!("MAX_COORDINATE_BITS = {}", limits::MAX_COORDINATE_BITS),
        format!("PAGE_HEADER_WORDS = {}", memory_form::PAGE_HEADER_WORDS),
        format!(
            "CLUSTER_HEADER_WORDS = {}",
            memory_form::CLUSTER_HEADER_WORDS
        ),
        format!("HEADER_WORDS = {}", disk_form::HEADER_WORDS),
        format!("BLOCK_HEADER_BYTES = {}", wire::BLOCK_HEADER_BYTES),
        format!(
            "NORMAL_BITS = {}",
            lodestream_format::octahedral::NORMAL_BITS
        ),
    ] {
        assert!(text.contains(&phrase), "FORMAT.md does not say {phrase:?}");
    }
}
