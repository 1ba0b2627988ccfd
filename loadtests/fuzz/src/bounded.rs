//! An allocator that fails the run where an input makes its reader allocate more than its bytes account for.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

static LIVE: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(usize::MAX);

/// The system's allocator, counted.
pub struct Bounded;

fn count(bytes: usize) {
    let live = LIVE.fetch_add(bytes, Relaxed) + bytes;
    // Once, and in no panic: that allocates, too.
    if live > MOST.load(Relaxed) && !std::thread::panicking() {
        let most = MOST.swap(usize::MAX, Relaxed);
        panic!("{live} bytes in use, the last {bytes} at once; the bound is {most}");
    }
}

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Bounded {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as the caller's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as the caller's.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size.saturating_sub(layout.size()));
        LIVE.fetch_sub(layout.size().saturating_sub(size), Relaxed);
        // SAFETY: as the caller's.
        unsafe { System.realloc(at, layout, size) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as the caller's.
        unsafe { System.dealloc(at, layout) }
    }
}

/// Runs a target on `data` with `most[0]` bytes, and `most[1]` for each of the input's.
pub fn within(most: [usize; 2], data: &[u8], run: fn(&[u8])) {
    let most = most[0] + most[1] * data.len();
    MOST.store(LIVE.load(Relaxed) + most, Relaxed);
    run(data);
    MOST.store(usize::MAX, Relaxed);
}
