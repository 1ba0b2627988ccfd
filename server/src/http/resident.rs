//! Pages of a library in a folder that the system has in memory: read from their pack's file at once, without a thread that may block and
//! without a copy in the cache, or sent from where the system has them, where nothing has to be done to them on the way. What is not in the
//! system's memory is read as from any store.
//!
//! A page is held against its hash when it is first read, and again when the pack was changed or the system has let go of it or of what lies
//! within [`REGION_BYTES`], and so reads from the disk anew. What the system alone, unasked by us, let go of and read again in between is
//! not; viewers check for themselves.

use std::collections::HashMap;
use std::fs::File;
use std::io;
use std::ops::{Range, RangeInclusive};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, SystemTime};

use bytes::Bytes;
use lodestream_format::library::object_path;
use lodestream_format::{Asset, ContentHash};
use tokio::net::TcpStream;
use tokio::time::Instant;

use super::buffers::Buffer;
use super::descriptors;
use super::mapped::MappedFile;
use super::memory::Memory;
use super::page_cache::bytes_of;

/// Packs that nobody asked for so long are closed: a pack that `gc` removed takes its place on the disk while it is open.
const UNUSED: Duration = Duration::from_secs(20);
/// The system lets go of more than a page, and reads more than a page again, but hardly ever so much at once.
const REGION_BYTES: u64 = 8 * 1024 * 1024;
/// Time between two looks at a pack's file, which nobody who keeps to the library's rules ever changes.
const LOOK_AGAIN: Duration = Duration::from_millis(1);
/// Packs that are open.
#[derive(Debug)]
pub(super) struct Resident {
    packs: Mutex<HashMap<ContentHash, Entry>>,
    /// Most of them: each takes a descriptor.
    most: usize,
}

impl Default for Resident {
    fn default() -> Self {
        Self {
            packs: Mutex::default(),
            most: descriptors::packs(),
        }
    }
}

#[derive(Debug)]
struct Entry {
    pack: Arc<Pack>,
    used: Instant,
    /// When its file was as it had been when it was opened.
    unchanged: Instant,
}

/// A pack of which some is in use.
#[derive(Debug)]
struct Pack {
    file: File,
    mapped: Option<MappedFile>,
    /// Whose pages these are.
    asset: Weak<Asset>,
    written: SystemTime,
    /// How often the system had let go of some of a region or of those beside it, and one.
    readings: Box<[AtomicU32]>,
    /// In which reading of the region that it begins in a page had the bytes that its hash names; 0 for none.
    checked: Box<[AtomicU32]>,
}

impl Pack {
    fn reading(&self, offset: u64) -> u32 {
        let region = self.readings.get((offset / REGION_BYTES) as usize);
        region.map_or(0, |reading| reading.load(Ordering::Acquire))
    }

    /// The system has not all of these bytes.
    fn let_go(&self, bytes: &Range<u64>) {
        let first = (bytes.start / REGION_BYTES).saturating_sub(1) as usize;
        let after = (bytes.end / REGION_BYTES + 2).min(self.readings.len() as u64) as usize;
        let regions = self.readings.get(first..after).unwrap_or_default();
        for reading in regions {
            reading.fetch_add(1, Ordering::AcqRel);
        }
    }
}

impl Resident {
    /// Opens the pack of an asset in a library that is the folder `folder`; blocks.
    pub(super) fn open(&self, folder: &Path, asset: &Arc<Asset>) {
        if self.has(asset) {
            return;
        }
        // Who reads the pack as from any store says what is wrong with it.
        let Ok(file) = File::open(folder.join(object_path(&asset.pack))) else {
            return;
        };
        let Some(written) = written(&file) else {
            return;
        };
        let bytes = asset.pages.last().map_or(0, |page| page.offset);
        let regions = bytes / REGION_BYTES + 1;
        let pack = Arc::new(Pack {
            written,
            mapped: MappedFile::new(&file),
            file,
            asset: Arc::downgrade(asset),
            readings: (0..regions).map(|_| AtomicU32::new(1)).collect(),
            checked: asset.pages.iter().map(|_| AtomicU32::new(0)).collect(),
        });
        let now = Instant::now();
        let mut packs = self.packs();
        if packs.len() >= self.most {
            packs.clear();
        }
        packs.insert(
            asset.pack,
            Entry {
                pack,
                used: now,
                unchanged: now,
            },
        );
    }

    /// Whether the pack of an asset is open.
    pub(super) fn has(&self, asset: &Arc<Asset>) -> bool {
        self.unchanged(asset).is_some()
    }

    /// Frames of pages, end to end, if the pack is open and the system has all of them in memory; what they take counts in `memory`.
    pub(super) fn read(
        &self,
        asset: &Arc<Asset>,
        pages: RangeInclusive<u32>,
        memory: &Arc<Memory>,
    ) -> Option<Bytes> {
        if memory.is_short() {
            return None;
        }
        let pack = self.unchanged(asset)?;
        let bytes = bytes_of(asset, &pages);
        let mut buffer = Buffer::take();
        let space = buffer.space((bytes.end - bytes.start) as usize)?;
        // What is let go of from now on is another reading. Space is less than a region, so there are no others.
        let (begin, end) = (
            pack.reading(bytes.start),
            pack.reading(bytes.end.saturating_sub(1)),
        );
        if !read_now(&pack.file, bytes.start, space) {
            pack.let_go(&bytes);
            return None;
        }
        for page in pages {
            let entry = &asset.pages[page as usize];
            let checked = pack.checked.get(page as usize)?;
            let reading = match entry.offset / REGION_BYTES == bytes.start / REGION_BYTES {
                true => begin,
                false => end,
            };
            if checked.load(Ordering::Relaxed) != reading {
                let begin = (entry.offset - bytes.start) as usize;
                let frame = &space[begin..begin + entry.bytes as usize];
                if ContentHash::of(frame) != entry.hash {
                    return None;
                }
                checked.store(reading, Ordering::Relaxed);
            }
        }
        Some(memory.keep(Bytes::from_owner(buffer)))
    }

    /// Frames of pages, end to end, where they are in the system's memory, if all of them were read and held against their hashes since it
    /// let go of any.
    pub(super) fn mapped(
        &self,
        asset: &Arc<Asset>,
        pages: RangeInclusive<u32>,
    ) -> Option<MappedPages> {
        let pack = self.unchanged(asset)?;
        let mapped = pack.mapped.as_ref()?;
        let bytes = bytes_of(asset, &pages);
        for page in pages {
            let reading = pack.reading(asset.pages.get(page as usize)?.offset);
            if pack.checked.get(page as usize)?.load(Ordering::Relaxed) != reading {
                return None;
            }
        }
        if !mapped.is_resident(&bytes) {
            pack.let_go(&bytes);
            return None;
        }
        Some(MappedPages { pack, bytes })
    }

    /// Closes what nobody uses, for ever.
    pub(super) async fn close_unused(&self) {
        loop {
            tokio::time::sleep(UNUSED / 2).await;
            self.packs()
                .retain(|_, entry| entry.used.elapsed() < UNUSED);
        }
    }

    /// The pack of an asset, if it is open and its file is as it was when that was opened, [`LOOK_AGAIN`] ago at most.
    fn unchanged(&self, asset: &Arc<Asset>) -> Option<Arc<Pack>> {
        let mut packs = self.packs();
        let entry = packs.get_mut(&asset.pack)?;
        if !std::ptr::eq(entry.pack.asset.as_ptr(), Arc::as_ptr(asset)) {
            return None;
        }
        let now = Instant::now();
        entry.used = now;
        if now - entry.unchanged >= LOOK_AGAIN {
            if written(&entry.pack.file) != Some(entry.pack.written) {
                // Changed or removed: it is opened again, if it is there.
                packs.remove(&asset.pack);
                return None;
            }
            entry.unchanged = now;
        }
        Some(Arc::clone(&entry.pack))
    }

    fn packs(&self) -> MutexGuard<'_, HashMap<ContentHash, Entry>> {
        self.packs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Pages that the system has in memory.
#[derive(Debug)]
pub(super) struct MappedPages {
    pack: Arc<Pack>,
    bytes: Range<u64>,
}

impl MappedPages {
    /// Bytes of all of them.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes.end - self.bytes.start
    }

    /// Writes `head`, then what comes after the first `sent` bytes, as far as `to` takes it at once; how many bytes that was.
    ///
    /// # Errors
    /// As [`MappedFile::write`].
    pub(super) fn write(&self, head: &[u8], sent: u64, to: &TcpStream) -> io::Result<usize> {
        let left = self.bytes.start + sent..self.bytes.end;
        let mapped = self.pack.mapped.as_ref();
        mapped
            .ok_or(io::ErrorKind::Unsupported)?
            .write(head, &left, to)
    }
}

/// Whether all of `space` could be read without waiting for the disk.
#[cfg(target_os = "linux")]
fn read_now(file: &File, offset: u64, space: &mut [u8]) -> bool {
    use rustix::io::{ReadWriteFlags, preadv2};
    let bytes = space.len();
    let slices = &mut [std::io::IoSliceMut::new(space)];
    preadv2(file, slices, offset, ReadWriteFlags::NOWAIT) == Ok(bytes)
}

#[cfg(not(target_os = "linux"))]
fn read_now(_: &File, _: u64, _: &mut [u8]) -> bool {
    false
}

/// When a file was written last; none where it was removed.
fn written(file: &File) -> Option<SystemTime> {
    let metadata = file.metadata().ok()?;
    #[cfg(unix)]
    if std::os::unix::fs::MetadataExt::nlink(&metadata) == 0 {
        return None;
    }
    metadata.modified().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_near_to_what_was_let_go_of_is_in_another_reading() {
        let pack = Pack {
            file: tempfile::tempfile().expect("a file"),
            mapped: None,
            asset: Weak::new(),
            written: SystemTime::UNIX_EPOCH,
            readings: (0..6).map(|_| AtomicU32::new(1)).collect(),
            checked: [].into(),
        };
        let readings = || -> [u32; 6] {
            std::array::from_fn(|region| pack.reading(region as u64 * REGION_BYTES))
        };
        pack.let_go(&(3 * REGION_BYTES - 1..3 * REGION_BYTES + 1));
        assert_eq!(readings(), [1, 2, 2, 2, 2, 1]);
        pack.let_go(&(0..1));
        pack.let_go(&(6 * REGION_BYTES - 2..6 * REGION_BYTES - 1));
        assert_eq!(readings(), [2, 3, 2, 2, 3, 2]);
        assert_eq!(pack.reading(6 * REGION_BYTES), 0, "there is none");
    }
}
