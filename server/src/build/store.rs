//! Where clusters and blocks wait for the next stage: memory, or a scratch file that lives as long as the build.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::BuildError;

/// Runs of words, written once and read any number of times.
#[derive(Debug)]
pub(super) enum Store {
    Memory(Vec<Option<Arc<[u32]>>>),
    File(ScratchFile),
}

/// A file without a name: gone when the build ends, however it ends.
#[derive(Debug)]
pub(super) struct ScratchFile {
    /// For messages.
    folder: PathBuf,
    file: File,
    /// First byte and number of words of each run.
    runs: Vec<(u64, u32)>,
    end: u64,
}

impl Store {
    /// In `scratch` where a folder is given, else in memory.
    pub fn new(scratch: Option<&Path>) -> Result<Self, BuildError> {
        match scratch {
            None => Ok(Self::Memory(Vec::new())),
            Some(folder) => Ok(Self::File(ScratchFile {
                folder: folder.to_owned(),
                file: tempfile::tempfile_in(folder).map_err(|cause| at(folder, cause))?,
                runs: Vec::new(),
                end: 0,
            })),
        }
    }

    /// Keeps `words`; gives their number.
    pub fn put(&mut self, words: Vec<u32>) -> Result<u32, BuildError> {
        match self {
            Self::Memory(runs) => {
                runs.push(Some(words.into()));
                Ok(runs.len() as u32 - 1)
            }
            Self::File(scratch) => scratch.put(&words),
        }
    }

    /// Words of a run.
    pub fn get(&self, run: u32) -> Result<Arc<[u32]>, BuildError> {
        match self {
            Self::Memory(runs) => Ok(runs[run as usize].clone().unwrap_or_default()),
            Self::File(scratch) => {
                let (first, words) = scratch.runs[run as usize];
                scratch.read(first, words as usize)
            }
        }
    }

    /// Some words of a run.
    pub fn part(&self, run: u32, first: usize, words: usize) -> Result<Part, BuildError> {
        match self {
            Self::Memory(runs) => Ok(Part {
                run: runs[run as usize].clone().unwrap_or_default(),
                first,
                words,
            }),
            Self::File(scratch) => {
                let start = scratch.runs[run as usize].0 + 4 * first as u64;
                Ok(Part {
                    run: scratch.read(start, words)?,
                    first: 0,
                    words,
                })
            }
        }
    }

    /// Lets go of a run that is not read again.
    pub fn forget(&mut self, run: u32) {
        if let Self::Memory(runs) = self {
            runs[run as usize] = None;
        }
    }
}

/// Some words of a run.
#[derive(Debug)]
pub(super) struct Part {
    run: Arc<[u32]>,
    first: usize,
    words: usize,
}

impl std::ops::Deref for Part {
    type Target = [u32];

    fn deref(&self) -> &[u32] {
        &self.run[self.first..self.first + self.words]
    }
}

impl ScratchFile {
    fn put(&mut self, words: &[u32]) -> Result<u32, BuildError> {
        let bytes: &[u8] = bytemuck::cast_slice(words);
        write_at(&self.file, bytes, self.end).map_err(|cause| at(&self.folder, cause))?;
        self.runs.push((self.end, words.len() as u32));
        self.end += bytes.len() as u64;
        Ok(self.runs.len() as u32 - 1)
    }

    fn read(&self, first: u64, words: usize) -> Result<Arc<[u32]>, BuildError> {
        let mut run = vec![0u32; words];
        let bytes = bytemuck::cast_slice_mut(&mut run);
        read_at(&self.file, bytes, first).map_err(|cause| at(&self.folder, cause))?;
        Ok(run.into())
    }
}

fn at(path: &Path, cause: io::Error) -> BuildError {
    BuildError::Scratch {
        path: path.to_owned(),
        cause: cause.to_string(),
    }
}

#[cfg(unix)]
fn write_at(file: &File, bytes: &[u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, at)
}

#[cfg(unix)]
pub(super) fn read_at(file: &File, bytes: &mut [u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, at)
}

#[cfg(windows)]
fn write_at(file: &File, mut bytes: &[u8], mut at: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        let written = std::os::windows::fs::FileExt::seek_write(file, bytes, at)?;
        bytes = &bytes[written..];
        at += written as u64;
    }
    Ok(())
}

#[cfg(windows)]
pub(super) fn read_at(file: &File, mut bytes: &mut [u8], mut at: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        let read = std::os::windows::fs::FileExt::seek_read(file, bytes, at)?;
        if read == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        bytes = &mut bytes[read..];
        at += read as u64;
    }
    Ok(())
}
