//! The parts of an `open` answer as the client takes them in, with hashes that fit: scene, asset, hierarchy and root pages.

use lodestream_client::stream::{OpenParts, OpenedScene, decode_page};
use lodestream_format::page_reader::PageReader;
use lodestream_format::wire::{Block, BlockHeader, BlockKind, PageStatus};
use lodestream_format::{Asset, ContentHash, Scene, cluster_view};

use super::input::{Input, manifest};

/// bincode makes room for as many as a list says, up to the limit of 1 GiB, before it reads them.
pub const MOST_BYTES: [usize; 2] = [32 << 20, 4096];
/// Bound of the opening.
const MOST_MEMORY_BYTES: u64 = 64 << 20;

/// Plain bytes of the scene, plain bytes of the asset and the hierarchy, each behind its length; then the root pages' frames.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    let scene = Scene::decode(&manifest(b"LSS2", input.sized()));
    let asset = Asset::decode(&manifest(b"LSA2", input.sized()));
    let (Ok(mut scene), Ok(mut asset)) = (scene, asset) else {
        return;
    };
    let hierarchy = input.sized().to_vec();
    asset.hierarchy = ContentHash::of(&hierarchy);
    let frames = input.0;
    for entry in &mut asset.pages {
        let first = usize::try_from(entry.offset).unwrap_or(usize::MAX);
        let own = frames.get(first..first.saturating_add(entry.bytes as usize));
        entry.hash = ContentHash::of(own.unwrap_or_default());
    }
    let object = asset.encode().expect("what was read can be written");
    let name = ContentHash::of(&object);
    scene.assets.iter_mut().for_each(|it| it.asset = name);
    let scene = scene.encode().expect("what was read can be written");
    let scene_name = ContentHash::of(&scene);
    let root_pages = &asset.pages[..asset.root_page_count as usize];
    let root_bytes: usize = root_pages.iter().map(|entry| entry.bytes as usize).sum();
    let root_pages = frames.get(..root_bytes).unwrap_or(frames).to_vec();
    let mut parts = OpenParts::new(MOST_MEMORY_BYTES);
    for (kind, hash, payload) in [
        (BlockKind::Scene, scene_name, scene),
        (BlockKind::Asset, name, object),
        (BlockKind::Hierarchy, asset.hierarchy, hierarchy),
        (BlockKind::RootPages, name, root_pages),
    ] {
        let (status, page) = (PageStatus::Ok, 0);
        let header = BlockHeader {
            kind,
            status,
            page,
            hash,
            payload_bytes: payload.len() as u64,
        };
        let block = Block {
            kind,
            status,
            page,
            hash,
            payload,
        };
        if parts
            .announced(&header)
            .and_then(|()| parts.take(block))
            .is_err()
        {
            return;
        }
    }
    if let Ok(opened) = OpenedScene::parse(parts) {
        check(&opened, frames);
    }
}

fn check(opened: &OpenedScene, frames: &[u8]) {
    let last = opened.page_count();
    assert_eq!(opened.locate(last), None);
    for asset in &opened.assets {
        let base = asset.page_base;
        let (index, local) = opened.locate(base).expect("its first page");
        assert_eq!((opened.assets[index].page_base, local), (base, 0));
        let mut reader = PageReader::new(&asset.asset);
        for form in &asset.root_pages {
            if let Ok(words) = reader.read(form) {
                let clusters = cluster_view::clusters(words).count();
                assert_eq!(clusters, form.headers().len());
            }
        }
        // A page that came later, with the bytes of one of these.
        for page in 0..asset.asset.pages.len() as u32 {
            let _ = decode_page(&asset.hash, &asset.asset, &asset.hierarchy, page, frames);
        }
    }
}
