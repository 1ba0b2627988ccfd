//! File bytes: ranges of memory and of files, read by position, so that nobody holds more than what is asked for.
//!
//! Files are read with positioned reads and not mapped: mapped pages count as resident memory.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::{Fault, Read, cannot_read};

/// A regular file, opened for reading. Threads may share it.
pub(super) struct InputFile {
    file: Positioned,
    path: PathBuf,
    length_bytes: u64,
}

impl InputFile {
    /// Opens `path`, which `place` names.
    pub(super) fn open(path: &Path, place: &str) -> Read<Arc<Self>> {
        let refuse = |cause| cannot_read(place, path, &cause);
        let file = File::open(path).map_err(refuse)?;
        let metadata = file.metadata().map_err(refuse)?;
        if metadata.is_dir() {
            return Err(refuse(std::io::ErrorKind::IsADirectory.into()));
        }
        Ok(Arc::new(Self {
            file: Positioned::new(file),
            path: path.to_owned(),
            length_bytes: metadata.len(),
        }))
    }
}

/// A range of bytes. Cheap to clone and to cut.
#[derive(Clone)]
pub(super) struct Extent {
    origin: Origin,
    /// From the start of the origin.
    offset: u64,
    length: u64,
}

#[derive(Clone)]
enum Origin {
    Memory(Arc<Vec<u8>>),
    File(Arc<InputFile>),
}

impl Extent {
    pub(super) fn memory(bytes: Vec<u8>) -> Self {
        Self {
            length: bytes.len() as u64,
            origin: Origin::Memory(Arc::new(bytes)),
            offset: 0,
        }
    }

    /// All of a file.
    pub(super) fn file(file: Arc<InputFile>) -> Self {
        Self {
            length: file.length_bytes,
            origin: Origin::File(file),
            offset: 0,
        }
    }

    pub(super) fn len(&self) -> u64 {
        self.length
    }

    /// `length` bytes from `offset`; `None` where they leave this range.
    pub(super) fn slice(&self, offset: u64, length: u64) -> Option<Self> {
        (offset.checked_add(length)? <= self.length).then(|| Self {
            origin: self.origin.clone(),
            offset: self.offset + offset,
            length,
        })
    }

    /// Fills `out` from `offset`.
    ///
    /// # Errors
    /// The operating system's, a file that became shorter among them; also a range that leaves this one.
    pub(super) fn read_at(&self, offset: u64, out: &mut [u8]) -> Read<()> {
        let end = offset.checked_add(out.len() as u64);
        let inside = end.is_some_and(|end| end <= self.length);
        let start = self.offset.saturating_add(offset);
        match &self.origin {
            _ if !inside => {
                Err(self.refuse(start, out.len(), &std::io::ErrorKind::UnexpectedEof.into()))
            }
            Origin::Memory(bytes) => {
                let start = start as usize;
                out.copy_from_slice(&bytes[start..start + out.len()]);
                Ok(())
            }
            Origin::File(file) => file
                .file
                .read_exact_at(out, start)
                .map_err(|cause| self.refuse(start, out.len(), &cause)),
        }
    }

    fn refuse(&self, start: u64, length: usize, cause: &std::io::Error) -> Fault {
        let place = format!("{length} bytes at byte {start}");
        match &self.origin {
            Origin::Memory(_) => cannot_read(place, Path::new("memory"), cause),
            Origin::File(file) => cannot_read(place, &file.path, cause),
        }
    }

    /// All of the range.
    pub(super) fn to_vec(&self) -> Read<Vec<u8>> {
        let mut bytes = vec![0; self.length as usize];
        self.read_at(0, &mut bytes)?;
        Ok(bytes)
    }

    /// The first bytes, `most` of them where the range is as long.
    pub(super) fn head(&self, most: u64) -> Read<Vec<u8>> {
        let mut bytes = vec![0; most.min(self.length) as usize];
        self.read_at(0, &mut bytes)?;
        Ok(bytes)
    }

    /// Reads from `offset` to the end, buffered.
    pub(super) fn reader(&self, offset: u64) -> Reader {
        const BUFFER_BYTES: usize = 1 << 18;
        let rest = Rest {
            extent: self.clone(),
            at: offset,
        };
        std::io::BufReader::with_capacity(BUFFER_BYTES, rest)
    }
}

/// A buffered reader over the rest of an extent.
pub(super) type Reader = std::io::BufReader<Rest>;

/// The unread rest of an extent.
pub(super) struct Rest {
    extent: Extent,
    at: u64,
}

impl std::io::Read for Rest {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let left = self.extent.length.saturating_sub(self.at);
        let length = left.min(out.len() as u64) as usize;
        self.extent
            .read_at(self.at, &mut out[..length])
            .map_err(|fault| std::io::Error::other(fault.to_string()))?;
        self.at += length as u64;
        Ok(length)
    }
}

/// Reads that name their position, on systems with and without them.
struct Positioned {
    #[cfg(unix)]
    file: File,
    #[cfg(not(unix))]
    file: std::sync::Mutex<File>,
}

#[cfg(unix)]
impl Positioned {
    fn new(file: File) -> Self {
        Self { file }
    }

    fn read_exact_at(&self, out: &mut [u8], offset: u64) -> std::io::Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(&self.file, out, offset)
    }
}

#[cfg(not(unix))]
impl Positioned {
    fn new(file: File) -> Self {
        Self {
            file: std::sync::Mutex::new(file),
        }
    }

    /// One thread at a time moves the file's cursor and reads.
    fn read_exact_at(&self, out: &mut [u8], offset: u64) -> std::io::Result<()> {
        use std::io::{Read as _, Seek as _};
        let mut file = self.file.lock().unwrap_or_else(|held| held.into_inner());
        file.seek(std::io::SeekFrom::Start(offset))?;
        file.read_exact(out)
    }
}
