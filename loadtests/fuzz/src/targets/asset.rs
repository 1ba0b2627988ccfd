//! Asset manifests (LSA2), which are the page tables.

use lodestream_format::Asset;
use lodestream_format::limits::{MAX_DISK_FORM_BYTES, PAGE_WORDS};

use super::input::{Input, manifest};

/// bincode makes room for as many as a list says, up to the limit of 1 GiB, before it reads them.
pub const MOST_BYTES: [usize; 2] = [8 << 20, 4096];

/// A byte that says whether the rest is a whole manifest or its plain bytes.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    let message = match input.byte() {
        0 => input.0.to_vec(),
        _ => manifest(b"LSA2", input.0),
    };
    let Ok(asset) = Asset::decode(&message) else {
        return;
    };
    let bytes = asset.encode().expect("what was read can be written");
    let again = Asset::decode(&bytes).expect("what was written can be read");
    assert_eq!(asset, again);
    assert!(asset.center_in_object().iter().all(|it| !it.is_nan()));
    let mut end = 0;
    for (page, entry) in asset.pages.iter().enumerate() {
        assert!(entry.memory_words as usize <= PAGE_WORDS);
        assert!(entry.bytes as usize <= MAX_DISK_FORM_BYTES + 8);
        assert!(entry.dependencies.iter().all(|&it| (it as usize) < page));
        assert_eq!(entry.offset, end);
        end += u64::from(entry.bytes);
    }
    assert_eq!(asset.pack_bytes(), end);
}
