//! Bombs: small files that ask for much. Each is read or refused within the memory that the import
//! is given, as a counting allocator tells.

mod counted;
mod json;
mod meshes;
mod mutated;
mod pictures;
mod texts;

use std::path::PathBuf;

use lodestream_server::import::{MeshSource, OpenOptions, OpenedScene, open};

/// The limit of most bombs.
const LIMIT: usize = 64 << 20;

/// Memory limits as `ingest --memory-limit` sets them.
fn within(limit_bytes: usize) -> OpenOptions {
    OpenOptions {
        max_mesh_bytes: limit_bytes as u64 / 8,
        memory_limit_bytes: Some(limit_bytes as u64),
        ..OpenOptions::default()
    }
}

/// Result of an import.
struct Outcome {
    /// The scene with its meshes read, or the error's text.
    scene: Result<OpenedScene, String>,
    /// Bytes allocated at once, beyond those before.
    peak_bytes: usize,
}

impl Outcome {
    fn error(&self) -> &str {
        match &self.scene {
            Ok(_) => "",
            Err(error) => error,
        }
    }
}

/// Imports `bytes` as a file of this extension, and reads all that is left in it.
fn import(extension: &str, bytes: &[u8], options: &OpenOptions) -> Outcome {
    let folder = tempfile::tempdir().expect("a folder");
    let path: PathBuf = folder.path().join(format!("bomb.{extension}"));
    std::fs::write(&path, bytes).expect("writes");
    let (scene, peak_bytes): (Result<_, String>, usize) = counted::peak_bytes(|| {
        let scene = open(&path, options).map_err(|error| error.fault.to_string())?;
        for mesh in &scene.meshes {
            for piece in 0..mesh.piece_count() {
                mesh.piece(piece).map_err(|error| error.fault.to_string())?;
            }
        }
        Ok(scene)
    });
    if let Err(error) = &scene {
        assert!(
            error.lines().count() == 1 && error.chars().count() < 600,
            "{error}"
        );
    }
    if let Ok(scene) = &scene {
        assert!(scene.warnings.len() <= 101);
        assert!(scene.warnings.iter().all(|line| line.chars().count() < 600));
    }
    Outcome { scene, peak_bytes }
}

/// The same within [`LIMIT`].
fn import_within(name: &str, extension: &str, bytes: &[u8]) -> Outcome {
    let outcome = import(extension, bytes, &within(LIMIT));
    let (peak, length) = (outcome.peak_bytes >> 10, bytes.len() >> 10);
    println!("{name}: {length} KiB, peak {peak} KiB, {}", outcome.error());
    assert!(
        outcome.peak_bytes <= LIMIT,
        "{name}: {} bytes take {}",
        bytes.len(),
        outcome.peak_bytes
    );
    outcome
}

/// A `.glb` of these chunks.
fn glb(json: &str, bin: &[u8]) -> Vec<u8> {
    let mut glb = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    for (kind, data) in [(b"JSON", &json[..]), (b"BIN\0", bin)] {
        glb.extend((data.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(data);
    }
    let length = glb.len() as u32;
    glb[8..12].copy_from_slice(&length.to_le_bytes());
    glb
}

/// `count` times `item`, between commas; `#` in it is a number.
fn list(count: usize, item: &str) -> String {
    let items: Vec<String> = (0..count)
        .map(|at| match item.contains('#') {
            true => item.replace('#', &at.to_string()),
            false => item.to_owned(),
        })
        .collect();
    items.join(",")
}
