//! A file mapped into memory that nobody but the system reads: what it has of the file goes to a socket with one copy, where reading and
//! writing make two.
//!
//! Nothing here reads a byte of it or hands out a reference to one: others may change or cut the file at any time, which no slice allows,
//! and a read behind its end would be a signal (SIGBUS). The system says EFAULT where it reads there for us.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::fd::{AsFd, AsRawFd};
use std::os::unix::fs::MetadataExt;
use std::ptr::NonNull;

use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};

/// System pages that are looked at with one call.
const LOOKED_AT: usize = 128;

/// All of a file.
#[derive(Debug)]
pub(super) struct MappedFile {
    begin: NonNull<libc::c_void>,
    bytes: usize,
}

// SAFETY: it is an address and a length, and what lies there is never read or written by this process.
unsafe impl Send for MappedFile {}
// SAFETY: as above; the calls that take the address are made by the system under its own locks.
unsafe impl Sync for MappedFile {}

impl MappedFile {
    /// Maps `file`; none where it is empty, where the system maps no more, or where it would not say what of the file it has in memory,
    /// which it does for the file's owner (mincore(2), since Linux 5.2).
    pub(super) fn new(file: &File) -> Option<Self> {
        let metadata = file.metadata().ok()?;
        let bytes = usize::try_from(metadata.len())
            .ok()
            .filter(|&bytes| bytes > 0)?;
        if metadata.uid() != rustix::process::geteuid().as_raw() {
            return None;
        }
        // SAFETY: the system chooses a place that nothing else has, and `self` unmaps it.
        let begin = unsafe {
            let (read, shared) = (ProtFlags::READ, MapFlags::SHARED);
            mmap(std::ptr::null_mut(), bytes, read, shared, file, 0)
        };
        let begin = NonNull::new(begin.ok()?)?;
        Some(Self { begin, bytes })
    }

    /// Whether the system has these bytes of the file in memory.
    pub(super) fn is_resident(&self, bytes: &Range<u64>) -> bool {
        let Some((begin, end)) = self.within(bytes) else {
            return false;
        };
        let page_bytes = rustix::param::page_size();
        let mut found = [0u8; LOOKED_AT];
        let mut next = begin - begin % page_bytes;
        while next < end {
            let after = end.min(next + LOOKED_AT * page_bytes);
            let looked_at = (after - next).div_ceil(page_bytes);
            // SAFETY: `next..after` lies in the mapping and begins with a page of it; a byte is written for each of its `looked_at` pages,
            // which are no more than `found` has.
            let told = unsafe {
                let at = self.begin.as_ptr().byte_add(next);
                libc::mincore(at, after - next, found.as_mut_ptr())
            };
            if told != 0 || found[..looked_at].iter().any(|page| page & 1 == 0) {
                return false;
            }
            next = after;
        }
        true
    }

    /// Writes `head`, then these bytes of the file, as many as `to`, a socket, takes at once; how many these were.
    ///
    /// # Errors
    /// As sendmsg(2); `UnexpectedEof` where the file has become shorter.
    pub(super) fn write(
        &self,
        head: &[u8],
        bytes: &Range<u64>,
        to: &impl AsFd,
    ) -> io::Result<usize> {
        let Some((begin, end)) = self.within(bytes) else {
            return Err(io::ErrorKind::InvalidInput.into());
        };
        let piece = |at: *const libc::c_void, bytes: usize| libc::iovec {
            iov_base: at.cast_mut(),
            iov_len: bytes,
        };
        // SAFETY: `begin` is within the mapping.
        let at = unsafe { self.begin.as_ptr().byte_add(begin) };
        let pieces = [
            piece(head.as_ptr().cast(), head.len()),
            piece(at, end - begin),
        ];
        // SAFETY: all zeros are a message of nothing.
        let mut message: libc::msghdr = unsafe { std::mem::zeroed() };
        message.msg_iov = pieces.as_ptr().cast_mut();
        message.msg_iovlen = pieces.len();
        // SAFETY: both pieces are there until the call returns, and are only read; what the mapping's file has lost is an error of the call.
        let written =
            unsafe { libc::sendmsg(to.as_fd().as_raw_fd(), &message, libc::MSG_NOSIGNAL) };
        usize::try_from(written).map_err(|_| match io::Error::last_os_error() {
            error if error.raw_os_error() == Some(libc::EFAULT) => {
                let (whole, needed) = (self.bytes, end);
                let what = format!("a file had {whole} bytes and has no longer {needed}");
                io::Error::new(io::ErrorKind::UnexpectedEof, what)
            }
            error => error,
        })
    }

    /// Where these bytes begin and end, if the file had them when it was mapped.
    fn within(&self, bytes: &Range<u64>) -> Option<(usize, usize)> {
        let begin = usize::try_from(bytes.start).ok()?;
        let end = usize::try_from(bytes.end).ok()?;
        (begin <= end && end <= self.bytes).then_some((begin, end))
    }
}

impl Drop for MappedFile {
    fn drop(&mut self) {
        // SAFETY: it was mapped by `new`, and nothing has its address any longer.
        let unmapped = unsafe { munmap(self.begin.as_ptr(), self.bytes) };
        debug_assert!(unmapped.is_ok(), "{unmapped:?}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::os::unix::net::UnixStream;

    fn file(bytes: &[u8]) -> File {
        let mut file = tempfile::tempfile().expect("a file");
        file.write_all(bytes).expect("written");
        file
    }

    #[test]
    fn what_is_asked_for_is_written_after_the_head() {
        let bytes: Vec<u8> = (0..100_000u32).map(|byte| (byte % 251) as u8).collect();
        let mapped = MappedFile::new(&file(&bytes)).expect("mapped");
        for range in [0..1, 4095..4097, 5000..25_000, 99_999..100_000, 7..7] {
            let (to, mut from) = UnixStream::pair().expect("a pair");
            assert!(mapped.is_resident(&range));
            let written = mapped.write(b"head", &range, &to).expect("written");
            drop(to);
            let mut read = Vec::new();
            from.read_to_end(&mut read).expect("read");
            let expected = &bytes[range.start as usize..range.end as usize];
            assert_eq!(written, 4 + expected.len());
            assert_eq!((&read[..4], &read[4..]), (&b"head"[..], expected));
        }
    }

    #[test]
    fn what_the_file_never_had_or_has_lost_is_an_error() {
        let file = file(&[1; 100_000]);
        let mapped = MappedFile::new(&file).expect("mapped");
        let (to, _from) = UnixStream::pair().expect("a pair");
        for range in [99_999..100_001, u64::MAX - 1..u64::MAX] {
            assert!(!mapped.is_resident(&range));
            let error = mapped.write(b"", &range, &to).expect_err("not there");
            assert_eq!(error.kind(), io::ErrorKind::InvalidInput);
        }
        file.set_len(10_000).expect("cut");
        let error = mapped.write(b"", &(50_000..60_000), &to).expect_err("lost");
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
        assert!(MappedFile::new(&self::file(b"")).is_none());
    }

    #[test]
    fn what_the_system_let_go_of_is_not_resident() {
        // Beside what was built: a folder of temporary files may be in memory only.
        let test = std::env::current_exe().expect("a test");
        let folder = tempfile::tempdir_in(test.parent().expect("a folder")).expect("a folder");
        let path = folder.path().join("file");
        std::fs::write(&path, [1; 1 << 20]).expect("written");
        let file = File::open(&path).expect("opened");
        file.sync_all().expect("on the disk");
        let before = MappedFile::new(&file).expect("mapped");
        assert!(before.is_resident(&(0..1 << 20)));
        rustix::fs::fadvise(&file, 0, None, rustix::fs::Advice::DontNeed).expect("let go");
        assert!(!before.is_resident(&(0..1 << 20)));
    }
}
