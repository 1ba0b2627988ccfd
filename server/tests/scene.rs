//! From a glTF file over ingest and HTTP to checked clusters: what a viewer would do.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::collections::BTreeMap;

use lodestream_format::cluster::NO_GROUP;
use lodestream_format::disk_form::DiskForm;
use lodestream_format::wire::{BlockKind, PageStatus, PageWant, PagesPost};
use lodestream_format::{Asset, ContentHash, Hierarchy, Scene, frame};
use lodestream_server::ingest::{IngestOptions, ingest};
use lodestream_server::library::Library;
use support::gltf::{self, INSTANCES, SPHERE_TRIANGLES, TORUS_TRIANGLES};
use support::server::{Running, blocks, client, client_h2};

#[test]
fn a_viewer_can_open_a_scene_and_fetch_it_whole() {
    let folder = tempfile::tempdir().unwrap();
    let runtime = support::runtime();
    let library = Library::open("memory://").unwrap();
    let options = IngestOptions {
        inputs: vec![gltf::write(folder.path())],
        scene: "pair".to_owned(),
        ..IngestOptions::default()
    };
    let report = ingest(runtime.handle(), &library, &options).unwrap();
    runtime.block_on(async {
        let server = Running::start(library).await;
        for (viewer, client) in [(1, client()), (2, client_h2())] {
            let url = server.url("/v1/scenes/pair/open");
            let open = client.get(url).send().await.unwrap().bytes().await.unwrap();
            let (opened, ended) = blocks(&open);
            assert!(ended);
            let of = |kind, hash: Option<ContentHash>| {
                let same = |block: &&lodestream_format::wire::Block| {
                    block.kind == kind && hash.is_none_or(|hash| block.hash == hash)
                };
                &opened.iter().find(same).unwrap().payload
            };
            let scene = Scene::decode(of(BlockKind::Scene, None)).unwrap();
            assert_eq!(scene.instances.len() as u64, INSTANCES);
            assert_eq!(scene.assets.len(), 2);
            let mut leaf_triangles = 0;
            let mut pages = 0;
            for used in &scene.assets {
                let asset = Asset::decode(of(BlockKind::Asset, Some(used.asset))).unwrap();
                assert_eq!(used.materials.len(), asset.material_slots as usize);
                let hierarchy = of(BlockKind::Hierarchy, Some(asset.hierarchy));
                let hierarchy = Hierarchy::decode(hierarchy, asset.pages.len() as u32).unwrap();
                let mut frames = root_frames(&asset, of(BlockKind::RootPages, Some(used.asset)));
                frames.extend(rest(&client, &server, viewer, used.asset, &asset).await);
                assert_eq!(frames.len(), asset.pages.len());
                pages += frames.len() as u64;
                for (page, bytes) in frames {
                    assert_eq!(ContentHash::of(&bytes), asset.pages[page as usize].hash);
                    let form = DiskForm::parse(frame::decode(&bytes).unwrap()).unwrap();
                    hierarchy.check_page(&form).unwrap();
                    let leaves = form
                        .headers()
                        .iter()
                        .filter(|header| header.child_group() == NO_GROUP);
                    leaf_triangles += leaves
                        .map(|header| header.triangle_count() as u64)
                        .sum::<u64>();
                }
            }
            assert_eq!(pages, report.pages);
            assert_eq!(leaf_triangles, SPHERE_TRIANGLES + TORUS_TRIANGLES);
            for texture in &scene.textures {
                let url = server.url(&format!("/v1/objects/{}", texture.object));
                let bytes = client.get(url).send().await.unwrap().bytes().await.unwrap();
                assert_eq!(ContentHash::of(&bytes), texture.object);
                assert_eq!(bytes.len() as u64, texture.bytes);
            }
        }
        server.stop().await;
    });
}

fn root_frames(asset: &Asset, bytes: &[u8]) -> BTreeMap<u32, Vec<u8>> {
    let roots = &asset.pages[..asset.root_page_count as usize];
    let frame =
        |page: usize| bytes[roots[page].offset as usize..][..roots[page].bytes as usize].to_vec();
    (0..roots.len())
        .map(|page| (page as u32, frame(page)))
        .collect()
}

/// All other pages, by one post.
async fn rest(
    client: &reqwest::Client,
    server: &Running,
    viewer: u64,
    hash: ContentHash,
    asset: &Asset,
) -> BTreeMap<u32, Vec<u8>> {
    let (first, last) = (asset.root_page_count, asset.pages.len() as u32 - 1);
    if first > last {
        return BTreeMap::new();
    }
    let want = PageWant {
        asset: hash,
        first,
        last,
        priority: 1.0,
    };
    let post = PagesPost {
        viewer,
        sequence: 1,
        wants: vec![want],
    };
    let request = client
        .post(server.url("/v1/pages"))
        .body(serde_json::to_vec(&post).unwrap());
    let answer = request.send().await.unwrap().bytes().await.unwrap();
    let (pages, ended) = blocks(&answer);
    assert!(ended);
    pages
        .into_iter()
        .inspect(|block| assert_eq!((block.hash, block.status), (hash, PageStatus::Ok)))
        .map(|block| (block.page, block.payload))
        .collect()
}
