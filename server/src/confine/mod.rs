//! Rights that this process gives up before it reads an input from a stranger.
//!
//! Memory is bounded by the system, files by Landlock, the network and other processes by seccomp.
//! The rights are gone for good and for every thread that starts later, so this runs before any
//! other thread. Only Linux has all three: elsewhere [`confine`] is an error, never a silent
//! nothing.

#[cfg(target_os = "linux")]
mod calls;
#[cfg(target_os = "linux")]
mod files;
#[cfg(target_os = "linux")]
mod memory;

use std::path::PathBuf;

/// The rights that stay.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Rights {
    /// Most bytes of private memory.
    pub memory_bytes: u64,
    /// Folders and files that are read.
    pub read: Vec<PathBuf>,
    /// Folders and files that are read and written.
    pub write: Vec<PathBuf>,
    /// If connections to other machines stay possible.
    pub network: bool,
}

/// A right that could not be given up.
#[derive(Debug, thiserror::Error)]
pub enum ConfineError {
    /// The system refuses, or is too old.
    #[error("--confine: expected {expected}, found {found}")]
    System {
        /// The part of the system that is needed.
        expected: &'static str,
        /// Its answer.
        found: String,
    },
    /// A file or folder that stays cannot be opened.
    #[error("--confine: {}: cannot open: {cause}", path.display())]
    Path {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        cause: String,
    },
}

/// Gives up every right that is not in `rights`.
///
/// # Errors
/// A system without Landlock or seccomp, and a path that cannot be opened. Some rights may be gone
/// then: the process has to end.
#[cfg(target_os = "linux")]
pub fn confine(rights: &Rights) -> Result<(), ConfineError> {
    memory::bound(rights.memory_bytes)?;
    files::restrict(rights)?;
    calls::refuse(rights.network)
}

/// There is no such system elsewhere.
#[cfg(not(target_os = "linux"))]
pub fn confine(_: &Rights) -> Result<(), ConfineError> {
    Err(ConfineError::System {
        expected: "Linux",
        found: std::env::consts::OS.to_owned(),
    })
}

/// Fails where [`confine`] would fail for want of the system.
///
/// # Errors
/// As [`confine`]; nothing is given up.
pub fn check() -> Result<(), ConfineError> {
    #[cfg(target_os = "linux")]
    return files::check();
    #[cfg(not(target_os = "linux"))]
    return confine(&Rights::default());
}

#[cfg(all(test, target_os = "linux"))]
mod tests;
