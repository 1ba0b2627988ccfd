//! Peak resident memory of one build, in a process of its own: what one builder frees must not be counted for the next.

use std::path::Path;
use std::process::{Command, Stdio};

use lodestream_server::build::BuildOptions;
use serde::{Deserialize, Serialize};

use super::process::{peak_resident_bytes, reset_peak, resident_bytes};
use super::rows::{Builder, run_clusterlod, run_ours};
use super::target::{MeshesOf, Part, StudyError};

/// What a process held, bytes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Memory {
    /// Resident with the input loaded, before the build.
    pub before_bytes: Option<u64>,
    /// Largest resident set during the build, input included.
    pub peak_bytes: Option<u64>,
}

/// Which build.
#[derive(Debug, Clone, PartialEq)]
pub struct MemoryOf {
    /// The input.
    pub input: MeshesOf,
    /// Which of its meshes.
    pub part: Part,
    /// Whose builder.
    pub builder: Builder,
    /// Threads of ours.
    pub threads: usize,
}

/// Builds once in this process and tells the peak.
///
/// # Errors
/// An input that cannot be read, or threads that cannot start.
pub fn measure(of: &MemoryOf) -> Result<Memory, StudyError> {
    let mut meshes = of.input.load()?;
    if let Part::Mesh(index) = of.part {
        meshes.truncate(index + 1);
        meshes.drain(..meshes.len() - 1);
    }
    let pool = thread_pool(of.threads)?;
    // Without a reset the peak of loading counts too: better too much than hidden.
    reset_peak();
    let before_bytes = resident_bytes();
    match of.builder {
        Builder::Lodestream => run_ours(&meshes, &BuildOptions::default(), &pool, drop),
        Builder::Clusterlod(preset) => run_clusterlod(&meshes, preset),
    };
    Ok(Memory {
        before_bytes,
        peak_bytes: peak_resident_bytes(),
    })
}

/// Runs [`measure`] in a new process of `program`, which must know the command `build-memory`.
///
/// # Errors
/// A process that does not start, fails, or says something else.
pub fn in_own_process(program: &Path, of: &MemoryOf) -> Result<Memory, StudyError> {
    let wrong = |found: String| StudyError::Child {
        input: of.input.to_string(),
        found,
    };
    let output = Command::new(program)
        .arg("build-memory")
        .arg(of.input.to_string())
        .args(["--part", &of.part.to_string()])
        .args(["--builder", of.builder.name()])
        .args(["--threads", &of.threads.to_string()])
        .stdin(Stdio::null())
        .output()
        .map_err(|error| wrong(error.to_string()))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        return Err(wrong(format!("{}: {}", output.status, said.trim())));
    }
    serde_json::from_slice(&output.stdout).map_err(|error| wrong(error.to_string()))
}

/// Threads for our builder.
///
/// # Errors
/// Threads that the system does not give.
pub fn thread_pool(threads: usize) -> Result<rayon::ThreadPool, StudyError> {
    let builder = rayon::ThreadPoolBuilder::new().num_threads(threads);
    builder.build().map_err(|error| StudyError::Threads {
        threads,
        found: error.to_string(),
    })
}
