//! Streams of blocks (LSB1), as `open` and `POST /v1/pages` answer.

use lodestream_format::FormatError;
use lodestream_format::wire::{self, Block, BlockReader};

use super::input::Input;

pub const MOST_BYTES: [usize; 2] = [1 << 20, 64];

/// A byte that says how the rest is cut.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    let cut = usize::from(input.byte()) + 1;
    let (blocks, end) = read(input.0, input.0.len().max(1));
    let (cut_blocks, cut_end) = read(input.0, cut);
    assert_eq!((&blocks, &end), (&cut_blocks, &cut_end));
    let mut written = Vec::new();
    for block in &blocks {
        let bytes = block.payload.len() as u64;
        let header = wire::block_header(block.kind, block.status, block.page, block.hash, bytes);
        written.extend(header);
        written.extend(&block.payload);
    }
    assert_eq!(written, input.0[..written.len()]);
    if end == Ok(true) {
        // All of it, but for what the end block has no use for.
        assert_eq!(written.len() + wire::BLOCK_HEADER_BYTES, input.0.len());
    }
}

/// The blocks, and whether the end came or what was wrong.
pub fn read(bytes: &[u8], cut: usize) -> (Vec<Block>, Result<bool, FormatError>) {
    let (mut reader, mut blocks) = (BlockReader::default(), Vec::new());
    for piece in bytes.chunks(cut) {
        reader.push(piece);
        loop {
            match reader.next_block() {
                Ok(Some(block)) => blocks.push(block),
                Ok(None) => break,
                Err(error) => return (blocks, Err(error)),
            }
        }
    }
    (blocks, Ok(reader.is_ended()))
}
