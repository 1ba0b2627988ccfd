//! What crosses HTTP beside plain objects: the answer to `open`, and the post for pages with its streamed answer.
//!
//! Both answers are sequences of blocks, ended by a block of kind [`BlockKind::End`], so that a cut connection is never
//! taken for a whole answer: `"LSB1", kind: u32, status: u32, page: u32, length: u64, hash: 32 bytes, payload`.

use crate::error::{FormatError, ensure};
use crate::hash::ContentHash;
use crate::library::SceneReference;
use crate::limits::MAX_MESSAGE_BYTES;
use crate::reader::{Pending, u32_at, u64_at};

/// Bytes before a block's payload.
pub const BLOCK_HEADER_BYTES: usize = 56;
const MAGIC: [u8; 4] = *b"LSB1";

/// Media type of both answers.
pub const MEDIA_TYPE: &str = "application/vnd.lodestream.blocks";

/// What a block's payload is, and what its hash names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum BlockKind {
    /// Nothing more comes; empty.
    End = 0,
    /// A [`crate::Scene`] object, named by the hash.
    Scene = 1,
    /// A [`crate::Asset`] object, named by the hash.
    Asset = 2,
    /// A [`crate::Hierarchy`] object, named by the hash.
    Hierarchy = 3,
    /// The frames of the root pages of the asset that the hash names, end to end.
    RootPages = 4,
    /// The frame of page `page` of the asset that the hash names; empty unless the status is [`PageStatus::Ok`].
    Page = 5,
}

/// How the request for one page ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum PageStatus {
    /// The frame follows.
    Ok = 0,
    /// No such asset or page; asking again is useless.
    NotFound = 1,
    /// The store failed; ask again later.
    Failed = 2,
}

/// One block.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Block {
    /// What it is.
    pub kind: BlockKind,
    /// How it went; anything but Ok only for pages.
    pub status: PageStatus,
    /// Page number, 0 unless the kind is Page.
    pub page: u32,
    /// Object or asset.
    pub hash: ContentHash,
    /// Bytes.
    pub payload: Vec<u8>,
}

/// The header of a block whose payload is sent separately, without a copy.
pub fn block_header(
    kind: BlockKind,
    status: PageStatus,
    page: u32,
    hash: ContentHash,
    payload_bytes: u64,
) -> [u8; BLOCK_HEADER_BYTES] {
    let mut header = [0; BLOCK_HEADER_BYTES];
    header[..4].copy_from_slice(&MAGIC);
    header[4..8].copy_from_slice(&(kind as u32).to_le_bytes());
    header[8..12].copy_from_slice(&(status as u32).to_le_bytes());
    header[12..16].copy_from_slice(&page.to_le_bytes());
    header[16..24].copy_from_slice(&payload_bytes.to_le_bytes());
    header[24..].copy_from_slice(&hash.0);
    header
}

/// The block that ends an answer.
pub fn end_block() -> [u8; BLOCK_HEADER_BYTES] {
    block_header(BlockKind::End, PageStatus::Ok, 0, ContentHash([0; 32]), 0)
}

/// A block as its header announces it, before its payload has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockHeader {
    /// See [`Block::kind`].
    pub kind: BlockKind,
    /// See [`Block::status`].
    pub status: PageStatus,
    /// See [`Block::page`].
    pub page: u32,
    /// See [`Block::hash`].
    pub hash: ContentHash,
    /// Bytes of the payload.
    pub payload_bytes: u64,
}

/// A stage of a block's arrival.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BlockEvent {
    /// Its header came. Nothing of its payload is kept before the next event is asked for.
    Announced(BlockHeader),
    /// All of it came.
    Whole(Block),
}

/// Cuts a stream of bytes into blocks.
#[derive(Debug, Default)]
pub struct BlockReader {
    pending: Pending,
    announced: Option<BlockHeader>,
    payload: Vec<u8>,
    ended: bool,
}

impl BlockReader {
    /// Takes bytes as they come.
    pub fn push(&mut self, bytes: &[u8]) {
        self.pending.push(bytes);
    }

    /// The next whole block that is not the end, if it has come.
    pub fn next_block(&mut self) -> Result<Option<Block>, FormatError> {
        loop {
            match self.next_event()? {
                Some(BlockEvent::Announced(_)) => {}
                Some(BlockEvent::Whole(block)) => return Ok(Some(block)),
                None => return Ok(None),
            }
        }
    }

    /// The next header or whole block. A header is to be checked where a stranger sends it: the
    /// payload's memory grows as it comes, up to the announced size.
    pub fn next_event(&mut self) -> Result<Option<BlockEvent>, FormatError> {
        let Some(header) = self.announced else {
            return Ok(self.next_header()?.map(BlockEvent::Announced));
        };
        let missing = header.payload_bytes as usize - self.payload.len();
        let came = self.pending.take(missing);
        // No more than twice what came, and never beyond the end.
        if self.payload.capacity() - self.payload.len() < came.len() {
            let room = came.len().max(self.payload.len()).min(missing);
            self.payload.reserve_exact(room);
        }
        self.payload.extend_from_slice(came);
        if came.len() < missing {
            return Ok(None);
        }
        self.announced = None;
        Ok(Some(BlockEvent::Whole(Block {
            kind: header.kind,
            status: header.status,
            page: header.page,
            hash: header.hash,
            payload: std::mem::take(&mut self.payload),
        })))
    }

    fn next_header(&mut self) -> Result<Option<BlockHeader>, FormatError> {
        ensure(
            !self.ended || self.pending.is_empty(),
            "blocks",
            "nothing after the end block",
            "more bytes",
        )?;
        let Some(header) = self.pending.peek(BLOCK_HEADER_BYTES) else {
            return Ok(None);
        };
        ensure(
            header[..4] == MAGIC,
            "block magic",
            "LSB1",
            format_args!("{:?}", &header[..4]),
        )?;
        let kind = match u32_at(header, 4) {
            0 => BlockKind::End,
            1 => BlockKind::Scene,
            2 => BlockKind::Asset,
            3 => BlockKind::Hierarchy,
            4 => BlockKind::RootPages,
            5 => BlockKind::Page,
            kind => return Err(FormatError::new("block kind", "0..=5", kind)),
        };
        let status = match u32_at(header, 8) {
            0 => PageStatus::Ok,
            1 => PageStatus::NotFound,
            2 => PageStatus::Failed,
            status => return Err(FormatError::new("block status", "0..=2", status)),
        };
        let page = u32_at(header, 12);
        let payload_bytes = u64_at(header, 16);
        ensure(
            payload_bytes <= MAX_MESSAGE_BYTES as u64,
            "block length",
            format_args!("at most {MAX_MESSAGE_BYTES}"),
            payload_bytes,
        )?;
        let mut hash = ContentHash([0; 32]);
        hash.0.copy_from_slice(&header[24..]);
        self.pending.take(BLOCK_HEADER_BYTES);
        if kind == BlockKind::End {
            ensure(payload_bytes == 0, "end block length", 0, payload_bytes)?;
            self.ended = true;
            return self.next_header();
        }
        let header = BlockHeader {
            kind,
            status,
            page,
            hash,
            payload_bytes,
        };
        self.announced = Some(header);
        Ok(Some(header))
    }

    /// Whether the end block has come.
    pub fn is_ended(&self) -> bool {
        self.ended
    }
}

/// Pages of one asset that a viewer wants.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PageWant {
    /// The asset.
    pub asset: ContentHash,
    /// First page.
    pub first: u32,
    /// Last page, inclusive.
    pub last: u32,
    /// Larger comes sooner; the viewer's projected error in pixels.
    pub priority: f32,
}

/// Body of `POST /v1/pages`, JSON. It replaces what an earlier post of the same viewer asked for and did not get yet.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PagesPost {
    /// Names the viewer; chosen by it at random.
    pub viewer: u64,
    /// Grows with every post of the viewer; an older one arriving late changes nothing.
    pub sequence: u64,
    /// What is wanted, in any order.
    pub wants: Vec<PageWant>,
}

/// A scene as `GET /v1/scenes` lists it.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct SceneEntry {
    /// The scene's name.
    pub name: String,
    /// What the name points at; its fields stand beside the name.
    #[serde(flatten)]
    pub reference: SceneReference,
}

/// Answer to `GET /v1/scenes?after=NAME&limit=N`, JSON.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct ScenesPage {
    /// Scenes in the order of their names' bytes, all greater than `after`.
    pub scenes: Vec<SceneEntry>,
    /// `after` of the next page; absent on the last one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn stream() -> Vec<u8> {
        let mut bytes =
            block_header(BlockKind::Page, PageStatus::Ok, 7, ContentHash::of(b"a"), 3).to_vec();
        bytes.extend(b"xyz");
        bytes.extend(block_header(
            BlockKind::Page,
            PageStatus::Failed,
            8,
            ContentHash::of(b"a"),
            0,
        ));
        bytes.extend(end_block());
        bytes
    }

    proptest! {
        #[test]
        fn blocks_come_whole_however_the_bytes_are_cut(cuts in prop::collection::vec(1usize..60, 1..40)) {
            let (mut reader, mut blocks, bytes) = (BlockReader::default(), Vec::new(), stream());
            let (mut at, mut cut) = (0, cuts.iter().cycle());
            while at < bytes.len() {
                let end = bytes.len().min(at + cut.next().copied().unwrap_or(1));
                reader.push(&bytes[at..end]);
                at = end;
                while let Some(block) = reader.next_block().unwrap() {
                    blocks.push((block.page, block.status, block.payload));
                }
                prop_assert_eq!(reader.is_ended(), at == bytes.len());
            }
            prop_assert_eq!(blocks, vec![(7, PageStatus::Ok, b"xyz".to_vec()), (8, PageStatus::Failed, vec![])]);
        }

        #[test]
        fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let mut reader = BlockReader::default();
            reader.push(&MAGIC);
            reader.push(&bytes);
            while let Ok(Some(_)) = reader.next_block() {}
        }
    }
    #[test]
    fn a_header_is_told_before_any_payload_and_room_grows_with_what_comes() {
        let header = block_header(
            BlockKind::Scene,
            PageStatus::Ok,
            0,
            ContentHash([7; 32]),
            1 << 30,
        );
        let mut reader = BlockReader::default();
        reader.push(&header);
        let event = reader.next_event().expect("a header");
        let Some(BlockEvent::Announced(announced)) = event else {
            panic!("{event:?}");
        };
        assert_eq!(announced.payload_bytes, 1 << 30);
        for _ in 0..9 {
            reader.push(&[1; 1000]);
            assert_eq!(reader.next_event().expect("not yet"), None);
        }
        assert!(
            reader.payload.capacity() <= 18_000,
            "{}",
            reader.payload.capacity()
        );
    }
}
