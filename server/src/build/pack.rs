//! Pack: the frames of all pages in a row, in memory, or in a file where the mesh may be larger than memory.

use std::borrow::Cow;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use lodestream_format::ContentHash;
use lodestream_format::hash::ContentHasher;

use super::error::BuildError;

/// The frames of all pages.
#[derive(Debug)]
pub enum Pack {
    /// In memory.
    Memory(Vec<u8>),
    /// In a file that goes when this does.
    File(tempfile::NamedTempFile),
}

impl Pack {
    /// Some bytes of the pack.
    ///
    /// # Errors
    /// A range outside the pack, or what reading the file says.
    pub fn read(&self, range: Range<u64>) -> std::io::Result<Cow<'_, [u8]>> {
        match self {
            Self::Memory(bytes) => bytes
                .get(range.start as usize..range.end as usize)
                .map(Cow::Borrowed)
                .ok_or_else(|| std::io::ErrorKind::UnexpectedEof.into()),
            Self::File(file) => {
                let mut file = File::open(file.path())?;
                file.seek(SeekFrom::Start(range.start))?;
                let mut bytes = vec![0; (range.end - range.start) as usize];
                file.read_exact(&mut bytes)?;
                Ok(Cow::Owned(bytes))
            }
        }
    }
}

/// A pack that is being written.
pub(super) struct PackWriter {
    pack: Pack,
    bytes: u64,
    hasher: ContentHasher,
}

impl PackWriter {
    pub fn new(scratch: Option<&Path>) -> Result<Self, BuildError> {
        let pack = match scratch {
            None => Pack::Memory(Vec::new()),
            Some(folder) => Pack::File(
                tempfile::NamedTempFile::new_in(folder).map_err(|cause| failed(folder, &cause))?,
            ),
        };
        Ok(Self {
            pack,
            bytes: 0,
            hasher: ContentHasher::default(),
        })
    }

    /// Bytes so far.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    pub fn append(&mut self, frame: &[u8]) -> Result<(), BuildError> {
        self.hasher.update(frame);
        self.bytes += frame.len() as u64;
        match &mut self.pack {
            Pack::Memory(bytes) => bytes.extend_from_slice(frame),
            Pack::File(file) => {
                let path: PathBuf = file.path().to_owned();
                file.write_all(frame)
                    .map_err(|cause| failed(&path, &cause))?;
            }
        }
        Ok(())
    }

    pub fn finish(self) -> Result<(Pack, ContentHash), BuildError> {
        Ok((self.pack, self.hasher.finish()))
    }
}

fn failed(path: &Path, cause: &std::io::Error) -> BuildError {
    BuildError::Scratch {
        path: path.to_owned(),
        cause: cause.to_string(),
    }
}
