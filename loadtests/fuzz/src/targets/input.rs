//! Cuts an input into pieces; what is missing reads as zeros or nothing.

use std::path::PathBuf;
use std::sync::OnceLock;

use lodestream_format::ContentHash;

/// The rest of an input.
pub struct Input<'a>(pub &'a [u8]);

impl<'a> Input<'a> {
    /// The next byte.
    pub fn byte(&mut self) -> u8 {
        self.take(1).first().copied().unwrap_or(0)
    }

    /// The next two.
    pub fn short(&mut self) -> u16 {
        u16::from_le_bytes([self.byte(), self.byte()])
    }

    /// The next `count` at most.
    pub fn take(&mut self, count: usize) -> &'a [u8] {
        let (own, rest) = self.0.split_at(count.min(self.0.len()));
        self.0 = rest;
        own
    }

    /// A piece behind its length of two bytes.
    pub fn sized(&mut self) -> &'a [u8] {
        let length = self.short();
        self.take(length as usize)
    }
}

/// [`Input::sized`] the other way.
pub fn sized(piece: &[u8]) -> Vec<u8> {
    let length = u16::try_from(piece.len()).expect("a small piece");
    [&length.to_le_bytes(), piece].concat()
}

/// Whole words of `bytes`.
pub fn words(bytes: &[u8]) -> Vec<u32> {
    let word = |it: &[u8]| u32::from_le_bytes([it[0], it[1], it[2], it[3]]);
    bytes.chunks_exact(4).map(word).collect()
}

/// Bytes of `words`.
pub fn bytes(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// A manifest around its plain bytes: mutations of compressed ones would reach nothing but zstd.
pub fn manifest(magic: &[u8; 4], plain: &[u8]) -> Vec<u8> {
    let packed = zstd::bulk::compress(plain, 1).expect("compresses");
    let length = plain.len() as u64;
    [magic, &length.to_le_bytes()[..], &packed].concat()
}

/// The plain bytes of a manifest.
pub fn plain(manifest: &[u8]) -> Vec<u8> {
    zstd::bulk::decompress(&manifest[12..], 1 << 20).expect("decompresses")
}

/// Puts hashes where an input has `$` and a letter: no mutation would find them.
pub fn with_hashes(text: &[u8], hashes: &[(u8, ContentHash)]) -> Vec<u8> {
    let mut out = Vec::with_capacity(text.len());
    let mut rest = text;
    while let Some((&byte, after)) = rest.split_first() {
        let known = after.first().and_then(|next| {
            let named = hashes.iter().find(|(letter, _)| letter == next);
            named.filter(|_| byte == b'$')
        });
        match known {
            Some((_, hash)) => {
                out.extend(hash.to_string().bytes());
                rest = &after[1..];
            }
            None => {
                out.push(byte);
                rest = after;
            }
        }
    }
    out
}

/// A folder of this process for readers that want files.
pub fn folder(name: &str) -> PathBuf {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| tempfile::tempdir().expect("a folder"));
    let own = folder.path().join(name);
    std::fs::create_dir_all(&own).expect("a folder");
    own
}
