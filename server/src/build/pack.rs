//! Pack: the frames of all pages in a row, in memory, or in a file where the mesh may be larger than memory.

use std::borrow::Cow;
use std::fs::File;
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lodestream_format::ContentHash;
use lodestream_format::hash::ContentHasher;

use super::error::BuildError;
use super::store::read_at;

/// The frames of all pages.
#[derive(Debug)]
pub enum Pack {
    /// In memory.
    Memory(Frames),
    /// In a file.
    File(PackFile),
}

/// An unnamed file: the system removes it when the process ends, however it ends.
#[derive(Debug)]
pub struct PackFile {
    /// The frames.
    pub file: Arc<File>,
    /// Its folder, for messages.
    pub folder: PathBuf,
}

/// Frames that lie apart: each takes the room of clusters that it lets go of, where one long run would need its own.
#[derive(Debug, Default)]
pub struct Frames {
    frames: Vec<Box<[u8]>>,
    /// First byte of each.
    starts: Vec<u64>,
}

impl Frames {
    /// All of them in a row.
    pub fn concat(self) -> Vec<u8> {
        self.frames.concat()
    }

    fn push(&mut self, start: u64, frame: Vec<u8>) {
        self.starts.push(start);
        self.frames.push(frame.into());
    }

    fn read(&self, range: Range<u64>) -> Option<Cow<'_, [u8]>> {
        let first = self.starts.partition_point(|&start| start <= range.start);
        let first = first.checked_sub(1)?;
        let skipped = (range.start - self.starts[first]) as usize;
        let wanted = range.end.checked_sub(range.start)? as usize;
        if let Some(bytes) = self.frames[first].get(skipped..skipped + wanted) {
            return Some(Cow::Borrowed(bytes));
        }
        let bytes = self.frames[first..].iter().flat_map(|frame| frame.iter());
        let bytes: Vec<u8> = bytes.skip(skipped).take(wanted).copied().collect();
        (bytes.len() == wanted).then_some(Cow::Owned(bytes))
    }
}

impl Pack {
    /// Some bytes of the pack.
    ///
    /// # Errors
    /// A range outside the pack, or what reading the file says.
    pub fn read(&self, range: Range<u64>) -> std::io::Result<Cow<'_, [u8]>> {
        match self {
            Self::Memory(frames) => frames
                .read(range)
                .ok_or_else(|| std::io::ErrorKind::UnexpectedEof.into()),
            Self::File(file) => {
                let mut bytes = vec![0; (range.end - range.start) as usize];
                read_at(&file.file, &mut bytes, range.start)?;
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
            None => Pack::Memory(Frames::default()),
            Some(folder) => Pack::File(PackFile {
                file: Arc::new(
                    tempfile::tempfile_in(folder).map_err(|cause| failed(folder, &cause))?,
                ),
                folder: folder.to_owned(),
            }),
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

    pub fn append(&mut self, frame: Vec<u8>) -> Result<(), BuildError> {
        self.hasher.update(&frame);
        let start = self.bytes;
        self.bytes += frame.len() as u64;
        match &mut self.pack {
            Pack::Memory(frames) => frames.push(start, frame),
            Pack::File(file) => {
                let written = (&*file.file).write_all(&frame);
                written.map_err(|cause| failed(&file.folder, &cause))?;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A killed build leaves nothing in its scratch folder.
    #[test]
    fn a_pack_in_a_file_has_no_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut writer = PackWriter::new(Some(folder.path())).expect("a file");
        writer.append(vec![1, 2, 3]).expect("written");
        writer.append(vec![4, 5]).expect("written");
        let (pack, _) = writer.finish().expect("a pack");
        assert_eq!(*pack.read(2..5).expect("read"), [3, 4, 5]);
        let named = std::fs::read_dir(folder.path()).expect("listed").count();
        assert_eq!(named, 0);
    }

    #[test]
    fn ranges_within_and_across_frames() {
        let mut frames = Frames::default();
        frames.push(0, vec![0, 1, 2]);
        frames.push(3, vec![3]);
        frames.push(4, vec![4, 5, 6, 7]);
        for start in 0..8u8 {
            for end in start..=8 {
                let expected: Vec<u8> = (start..end).collect();
                let found = frames.read(start as u64..end as u64).map(Cow::into_owned);
                assert_eq!(found, Some(expected), "{start}..{end}");
            }
        }
        assert_eq!(frames.read(7..9), None);
        assert_eq!(frames.concat(), (0..8).collect::<Vec<u8>>());
    }
}
