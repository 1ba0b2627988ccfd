//! Frames of pages: Zstandard, LZ4 or plain around a disk form.

use lodestream_format::disk_form::{self, DiskForm};
use lodestream_format::frame::{self, Codec};
use lodestream_format::limits::MAX_DISK_FORM_BYTES;

pub const MOST_BYTES: [usize; 2] = [4 << 20, 64];
/// More is not compressed again, which takes milliseconds.
const AGAIN_WORDS: usize = 4096;

pub fn run(data: &[u8]) {
    let Ok(words) = frame::decode(data) else {
        return;
    };
    assert!(4 * words.len() <= MAX_DISK_FORM_BYTES);
    // A frame of nothing is read, but not one that is written plain.
    if !words.is_empty() && words.len() <= AGAIN_WORDS {
        for codec in [Codec::None, Codec::Zstd, Codec::Lz4] {
            let again = frame::encode(&words, codec).expect("what was read can be written");
            assert!(again.len() <= frame::HEADER_BYTES + 4 * words.len());
            assert_eq!(frame::decode(&again).as_ref(), Ok(&words));
        }
    }
    let sections = disk_form::sections(&words);
    if let Ok(sections) = &sections {
        let sum: usize = sections.iter().map(|(_, bytes)| bytes).sum();
        assert_eq!(sum, 4 * words.len());
    }
    let parsed = DiskForm::parse(words);
    assert!(parsed.is_err() || sections.is_ok());
}
