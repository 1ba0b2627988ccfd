//! A viewer that opens a scene of a server that means it harm: the memory and the bytes that this
//! takes.
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

mod hostile_common;
mod stream_common;

use hostile_common::counting::{Counting, Measure};
use hostile_common::scene::*;
use hostile_common::{Client, Hostile};
use lodestream_client::stream::{OpenParts, OpenedScene, StreamLimits};
use lodestream_format::instances::InstanceSteps;
use lodestream_format::scene::{Instance, MediaType, SceneAsset, Texture};
use lodestream_format::wire::{Block, BlockHeader, BlockKind, PageStatus, block_header};
use lodestream_format::{ContentHash, Scene};
use std::io;
use stream_common::{Size, make_scene};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn an_honest_answer_opens_within_the_same_bounds() {
    let scene = made();
    let body = blocks(&parts(&scene));
    let server = Hostile::start(move |_, client| client.answer("", &body));
    let opened = runtime().block_on(source(&server).open("made")).unwrap();
    assert_eq!(opened.page_count(), scene.opened.page_count());
}

/// Bytes that compress to a thousandth or less, inside a block, after it and between blocks.
#[test]
fn bombs_of_zstd_take_no_more_than_was_announced() {
    let scene = made();
    let zeros = vec![0u8; 64 * MIB];
    let hash = ContentHash::of(b"bomb");
    let header = |bytes| block_header(BlockKind::Scene, PageStatus::Ok, 0, hash, bytes).to_vec();
    let honest = blocks(&parts(&scene));
    for (what, start, expected) in [
        (
            "too large a block",
            header(1 << 30),
            "within 16777216 bytes of memory (--open-memory)",
        ),
        (
            "another content",
            header(8 << 20),
            "expected bytes that hash to",
        ),
        ("zeros after the end", honest, "nothing after the end block"),
        ("zeros for a header", vec![], "block magic"),
    ] {
        let mut plain = start;
        plain.extend_from_slice(&zeros);
        let packed = zstd::bulk::compress(&plain, 1).unwrap();
        assert!(packed.len() < MIB);
        drop(plain);
        let error = open_error(what, move |_, client| {
            client.answer("Content-Encoding: zstd\r\n", &packed)
        });
        refused(what, &error, expected);
    }
}

/// A block's payload that never comes to its end takes memory as it comes, and an end that never
/// comes as well.
#[test]
fn endless_answers_are_hung_up_on() {
    let header = block_header(
        BlockKind::Scene,
        PageStatus::Ok,
        0,
        ContentHash::of(b"endless"),
        1 << 20,
    );
    let forever = |client: &mut Client, piece: &[u8]| loop {
        client.chunk(piece)?;
    };
    let error = open_error("a scene without end", move |_, client| {
        client.begin("")?;
        client.chunk(&header)?;
        forever(client, &[0; 65_536])
    });
    refused("a scene without end", &error, "expected bytes that hash to");
    let error = open_error("empty frames without end", move |_, client| {
        client.begin("Content-Encoding: zstd\r\n")?;
        let empty = zstd::bulk::compress(&[], 1).unwrap().repeat(1000);
        forever(client, &empty)
    });
    refused("empty frames", &error, "Zstandard: expected at most");
}

#[test]
fn only_parts_that_the_scene_leads_to_are_taken() {
    let scene = made();
    let honest = parts(&scene);
    let stranger = make_scene(
        2,
        Size {
            assets: 1,
            finest_groups: 5,
            levels: 2,
        },
    );
    let strange = parts(&stranger);
    let with = |at: usize, part: &Part| {
        let mut parts = honest.clone();
        parts.insert(at, part.clone());
        blocks(&parts)
    };
    let without = |at: usize| {
        let mut parts = honest.clone();
        parts.remove(at);
        blocks(&parts)
    };
    let mut longer = honest.clone();
    longer[3].2.push(0);
    let page = block(BlockKind::Page, 0, honest[1].1, b"x");
    for (what, body, expected) in [
        (
            "an asset that nobody names",
            with(1, &strange[1]),
            "expected an asset that the scene names",
        ),
        (
            "an asset twice",
            with(2, &honest[1]),
            "expected an asset that the scene names",
        ),
        (
            "a hierarchy that nobody names",
            with(2, &strange[2]),
            "expected a hierarchy that an asset names",
        ),
        (
            "a hierarchy twice",
            with(3, &honest[2]),
            "expected a hierarchy that an asset names",
        ),
        (
            "root pages before their asset",
            with(1, &honest[3]),
            "expected root pages of an asset that came",
        ),
        (
            "root pages twice",
            with(4, &honest[3]),
            "expected root pages of an asset that came",
        ),
        (
            "root pages that are longer",
            blocks(&longer),
            "bytes, found",
        ),
        ("another scene", with(1, &strange[0]), "expected one scene"),
        ("no scene first", without(0), "expected the scene first"),
        (
            "no asset",
            without(1),
            "expected a hierarchy that an asset names",
        ),
        ("no hierarchy", without(2), "hierarchy of asset"),
        ("no root pages", without(3), "root pages of asset"),
        ("a page", page, "expected the scene first"),
    ] {
        refused(what, &blocks_error(what, body), expected);
    }
}

#[test]
fn manifests_that_claim_more_than_they_hold_are_refused() {
    let billion = [&[252][..], &1_000_000_000u32.to_le_bytes()].concat();
    let million = [&[252][..], &1_000_000u32.to_le_bytes()].concat();
    // An asset whose name does not compress, so that the whole does not either.
    let name: Vec<u8> = ContentHash::of(b"name")
        .0
        .iter()
        .map(|byte| byte & 127)
        .collect();
    let asset = ContentHash::of(b"asset").0;
    let named = [&[1, 32][..], &name, &asset, &[0], &[0; 36]].concat();
    for (what, plain, expected) in [
        (
            "a billion assets",
            billion.clone(),
            "LSS2: expected lists of at most 2097152 bytes",
        ),
        (
            "a billion bytes of instances",
            [&[0; 2][..], &billion].concat(),
            "LSS2: expected lists of at most",
        ),
        (
            "a billion instances",
            [&[0][..], &billion, &[0; 5]].concat(),
            "scene instances: expected at most",
        ),
        (
            "a million instances without bytes",
            [&[0][..], &million, &[0; 5]].concat(),
            "scene instances: expected at most",
        ),
        // Empty texts: a byte each, 24 in memory.
        (
            "a million warnings",
            [&named[..], &[0; 5], &million, &vec![0; 1_000_000]].concat(),
            "LSS2: expected lists of at most",
        ),
        (
            "more than memory",
            vec![0; 32 * MIB],
            "LSS2: expected at most",
        ),
    ] {
        let object = scene_object(&plain);
        let hash = ContentHash::of(&object);
        let error = blocks_error(what, blocks(&[(BlockKind::Scene, hash, object)]));
        refused(what, &error, expected);
    }
}

/// Each list of a scene keeps to the bound; so must all together.
#[test]
fn lists_of_a_scene_share_one_bound() {
    let texture = Texture {
        object: ContentHash([7; 32]),
        bytes: 1,
        media_type: MediaType::Png,
        width: 1,
        height: 1,
    };
    let decoded = |textures: usize, warnings: usize| {
        let scene = Scene {
            textures: vec![texture.clone(); textures],
            warnings: vec![String::new(); warnings],
            ..Scene::default()
        };
        Scene::decode_within(&scene.encode().unwrap(), 64 << 20).map(|scene| scene.memory_bytes())
    };
    assert_eq!(
        decoded(0, 400_000),
        Ok(400_000 * size_of::<String>() as u64)
    );
    assert!(decoded(300_000, 0).is_ok());
    let error = decoded(300_000, 400_000).unwrap_err().to_string();
    assert!(
        error.contains("expected lists of at most 33554432 bytes"),
        "{error}"
    );
}

/// An asset that a scene uses a hundred thousand times is a hundred thousand assets in memory.
#[test]
fn an_asset_used_without_end_is_refused() {
    let scene = made();
    let mut honest = parts(&scene);
    let used = SceneAsset {
        name: String::new(),
        asset: scene.assets[0].opened.hash,
        materials: vec![],
        steps: InstanceSteps::default(),
    };
    let mut many = scene.opened.scene.clone();
    many.assets = vec![used; 10_000];
    let object = many.encode().unwrap();
    honest.truncate(4);
    honest[0] = (BlockKind::Scene, ContentHash::of(&object), object);
    let error = blocks_error("ten thousand uses", blocks(&honest));
    refused("ten thousand uses", &error, "another use of asset");
}

#[test]
fn a_million_instances_of_thirty_meshes_open_with_the_usual_bounds() {
    let size = Size {
        assets: 30,
        finest_groups: 6,
        levels: 3,
    };
    let mut scene = make_scene(5, size);
    let instances = (0..1_000_000u32).map(|index| Instance {
        asset: index % 30,
        world_from_object: [[1.0, 0.0, 0.0, index as f64]; 3],
    });
    scene.opened.scene.instances = instances.collect();
    let parts_of = parts(&scene);
    let mut opened = OpenParts::new(StreamLimits::default().open_memory_bytes);
    let measure = Measure::new();
    for (kind, hash, payload) in parts_of {
        let (status, page, payload_bytes) = (PageStatus::Ok, 0, payload.len() as u64);
        opened
            .announced(&BlockHeader {
                kind,
                status,
                page,
                hash,
                payload_bytes,
            })
            .unwrap();
        opened
            .take(Block {
                kind,
                status,
                page,
                hash,
                payload,
            })
            .unwrap();
    }
    let opened = OpenedScene::parse(opened).unwrap();
    assert_eq!(opened.scene.instances.len(), 1_000_000);
    let peak = measure.peak_bytes();
    assert!(peak < 512 * MIB, "{peak} bytes");
}

#[test]
fn headers_and_chunk_extensions_have_an_end() {
    type Answer = Box<dyn Fn(&str, &mut Client) -> io::Result<()> + Send + Sync>;
    let forever = |client: &mut Client, piece: &[u8]| loop {
        client.send(piece)?;
    };
    let answers: Vec<(&str, Answer)> = vec![
        (
            "header fields",
            Box::new(move |_, client| {
                client.send(b"HTTP/1.1 200 OK\r\n")?;
                forever(client, &b"x-more: and more\r\n".repeat(100))
            }),
        ),
        (
            "one long header field",
            Box::new(move |_, client| {
                client.send(b"HTTP/1.1 200 OK\r\nx: ")?;
                forever(client, &[b'x'; 4096])
            }),
        ),
        (
            "chunk extensions",
            Box::new(move |_, client| {
                client.begin("")?;
                forever(
                    client,
                    &b"1;a=b;c=ddddddddddddddddddddddd\r\nL\r\n".repeat(100),
                )
            }),
        ),
        (
            "one long chunk extension",
            Box::new(move |_, client| {
                client.begin("")?;
                client.send(b"1;a=")?;
                forever(client, &[b'x'; 4096])
            }),
        ),
        (
            "trailers",
            Box::new(move |_, client| {
                client.begin("")?;
                client.send(b"0\r\n")?;
                forever(client, &b"x-more: and more\r\n".repeat(100))
            }),
        ),
    ];
    for (what, answer) in answers {
        open_error(what, answer);
    }
}
