//! The fuzzers' corpus, changed at random but the same each time, within the memory that an import
//! is given.

use std::path::Path;

use super::{import, within};

const LIMIT: usize = 16 << 20;
/// Changed copies of each input.
const COPIES: usize = 12;

/// Numbers at random, by xorshift.
struct Random(u64);

impl Random {
    fn below(&mut self, most: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % most.max(1) as u64) as usize
    }

    /// Bits flipped, words made large, ranges doubled and cut.
    fn change(&mut self, bytes: &mut Vec<u8>) {
        for _ in 0..1 + self.below(4) {
            let at = self.below(bytes.len());
            let end = (at + 1 + self.below(32)).min(bytes.len());
            match self.below(5) {
                0 if at < bytes.len() => bytes[at] ^= 1 << self.below(8),
                1 if at < end => bytes[at..end].fill(0xff),
                2 => {
                    let again = bytes[at..end].repeat(1 + self.below(64));
                    bytes.splice(at..at, again);
                }
                3 => drop(bytes.drain(at..end)),
                _ => drop(bytes.splice(at..at, *b"4294967295")),
            }
        }
    }
}

#[test]
fn changed_inputs_stay_within_the_limit() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../loadtests/fuzz/corpus");
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    for extension in ["gltf", "obj", "ply", "stl"] {
        let listed = std::fs::read_dir(corpus.join(extension)).expect("a corpus");
        let mut files: Vec<_> = listed.map(|entry| entry.expect("reads").path()).collect();
        files.sort();
        for file in files {
            let input = std::fs::read(&file).expect("reads");
            for _ in 0..COPIES {
                let mut bytes = input.clone();
                random.change(&mut bytes);
                let outcome = import(extension, &bytes, &within(LIMIT));
                if outcome.peak_bytes > LIMIT {
                    let kept = std::env::temp_dir().join(format!("bomb.{extension}"));
                    std::fs::write(&kept, &bytes).expect("writes");
                    panic!("{}: {} bytes", kept.display(), outcome.peak_bytes);
                }
            }
        }
    }
}
