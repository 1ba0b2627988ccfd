//! A small scene, the parts of its answers, and how an opening fails.

use std::io;
use std::time::Duration;

use lodestream_client::stream::{Source, StreamError, StreamLimits};
use lodestream_format::ContentHash;
use lodestream_format::wire::{BlockKind, PageStatus, block_header, end_block};
use tokio::runtime::Runtime;

use super::counting::Measure;
use super::{Client, Hostile};
use crate::stream_common::{MadeScene, Size, make_scene};

pub const MIB: usize = 1 << 20;
/// Bound of an opening in these tests.
pub const OPEN_MEMORY_BYTES: u64 = 16 << 20;
/// Most memory that an attack may take: the bound, and as much for buffers of both ends.
pub const PEAK_BYTES: usize = 48 * MIB;
/// Most bytes that a server gets rid of before it is hung up on: sockets on the way hold a few
/// megabytes.
pub const MOST_SENT_BYTES: u64 = 64 << 20;

pub fn limits() -> StreamLimits {
    StreamLimits {
        open_memory_bytes: OPEN_MEMORY_BYTES,
        grace: Duration::from_secs(1),
        least_bytes_a_sec: 1000.0,
    }
}

pub fn runtime() -> Runtime {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .unwrap()
}

pub fn made() -> MadeScene {
    let size = Size {
        assets: 2,
        finest_groups: 20,
        levels: 4,
    };
    make_scene(1, size)
}

pub type Part = (BlockKind, ContentHash, Vec<u8>);

/// The parts of an honest answer to `open`, each with its block's name.
pub fn parts(scene: &MadeScene) -> Vec<Part> {
    let object = scene.opened.scene.encode().unwrap();
    let mut parts = vec![(BlockKind::Scene, ContentHash::of(&object), object)];
    for made in &scene.assets {
        let asset = &made.opened.asset;
        let roots = made.frames[..asset.root_page_count as usize].concat();
        parts.extend([
            (BlockKind::Asset, made.opened.hash, made.asset_bytes.clone()),
            (
                BlockKind::Hierarchy,
                asset.hierarchy,
                made.hierarchy_bytes.clone(),
            ),
            (BlockKind::RootPages, made.opened.hash, roots),
        ]);
    }
    parts
}

pub fn block(kind: BlockKind, page: u32, hash: ContentHash, payload: &[u8]) -> Vec<u8> {
    let header = block_header(kind, PageStatus::Ok, page, hash, payload.len() as u64);
    [&header[..], payload].concat()
}

pub fn blocks(parts: &[Part]) -> Vec<u8> {
    let blocks = parts
        .iter()
        .map(|(kind, hash, payload)| block(*kind, 0, *hash, payload));
    [blocks.collect::<Vec<_>>().concat(), end_block().to_vec()].concat()
}

/// A scene object of these plain bytes.
pub fn scene_object(plain: &[u8]) -> Vec<u8> {
    let length = (plain.len() as u64).to_le_bytes();
    let packed = zstd::bulk::compress(plain, 1).unwrap();
    [b"LSS2", &length[..], &packed].concat()
}

pub fn source(server: &Hostile) -> Source {
    Source::connect_within(&server.url, &limits()).unwrap()
}

pub fn refused(what: &str, found: &StreamError, expected: &str) {
    let found = found.to_string();
    assert!(
        found.contains(expected),
        "{what}: expected {expected:?} in {found:?}"
    );
    // It is printed: no stranger writes pages of it.
    assert!(found.len() < 2000, "{what}: {} bytes", found.len());
}

/// Opens from a server that answers so; gives the error, and checks memory and bytes.
pub fn open_error(
    what: &str,
    answer: impl Fn(&str, &mut Client) -> io::Result<()> + Send + Sync + 'static,
) -> StreamError {
    let server = Hostile::start(answer);
    let (runtime, source) = (runtime(), source(&server));
    let measure = Measure::new();
    let error = runtime.block_on(source.open("made")).map(|_| ());
    let error = error.expect_err(what);
    let (peak, sent) = (measure.peak_bytes(), server.sent_bytes());
    assert!(peak < PEAK_BYTES, "{what}: {peak} bytes of memory, {error}");
    assert!(sent < MOST_SENT_BYTES, "{what}: {sent} bytes sent, {error}");
    error
}

/// As `open_error`, for a whole answer of blocks.
pub fn blocks_error(what: &str, body: Vec<u8>) -> StreamError {
    open_error(what, move |_, client| client.answer("", &body))
}
