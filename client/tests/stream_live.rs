//! Streaming over a real server and a real folder: the same scene, the same pages, the same picture.
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

mod stream_common;

use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use lodestream_client::stream::{
    PixelErrorControl, Retry, Source, StreamError, Streamer, Transport, decode_page,
};
use lodestream_format::library::object_path;
use lodestream_format::{Asset, ContentHash, Hierarchy};
use lodestream_server::build::{BuildOptions, build};
use lodestream_server::http::AppState;
use lodestream_server::http::serve::Server;
use lodestream_server::import::Mesh;
use lodestream_server::library::Library;
use stream_common::pool_model::PoolModel;
use stream_common::{MadeScene, Size, config, made_of, make_scene};
use tokio::runtime::Runtime;

const SIZE: Size = Size {
    assets: 3,
    finest_groups: 40,
    levels: 5,
};

fn runtime() -> Runtime {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .unwrap()
}

/// Serves the library folder until the runtime goes; gives the URL.
fn serve(runtime: &Runtime, folder: &str) -> String {
    let library = Library::open(folder).unwrap();
    let server = runtime.block_on(Server::bind("127.0.0.1:0")).unwrap();
    let url = format!("http://{}", server.address());
    runtime.spawn(server.run(AppState::new(library, 1 << 20), std::future::pending()));
    url
}

struct Place {
    _folder: tempfile::TempDir,
    folder: String,
}

fn library(scene: &MadeScene) -> Place {
    let folder = tempfile::tempdir().unwrap();
    scene.write_library(folder.path(), "made");
    Place {
        folder: folder.path().to_str().unwrap().to_owned(),
        _folder: folder,
    }
}

#[test]
fn server_and_folder_give_the_same_answers() {
    let scene = make_scene(1, SIZE);
    let place = library(&scene);
    let runtime = runtime();
    let near = Source::connect(&place.folder).unwrap();
    let far = Source::connect(&serve(&runtime, &place.folder)).unwrap();
    runtime.block_on(async {
        let scenes = far.scenes().await.unwrap();
        assert_eq!(scenes, near.scenes().await.unwrap());
        assert_eq!(scenes[0].name, "made");
        let (a, b) = (
            far.open("made").await.unwrap(),
            near.open("made").await.unwrap(),
        );
        assert_eq!(a.scene, b.scene);
        assert_eq!(a.page_count(), scene.opened.page_count());
        let on_the_way = (1..b.open_bytes).contains(&a.open_bytes);
        assert!(on_the_way, "compressed: {}", a.open_bytes);
        for ((a, b), made) in a.assets.iter().zip(&b.assets).zip(&scene.assets) {
            assert_eq!(
                (a.hash, &a.asset, &a.hierarchy),
                (b.hash, &b.asset, &b.hierarchy)
            );
            assert_eq!((a.hash, a.page_base), (made.opened.hash, b.page_base));
            assert_eq!(a.root_pages.len(), b.root_pages.len());
            let words = a.root_pages.iter().zip(&b.root_pages);
            assert!(words.into_iter().all(|(a, b)| a.words() == b.words()));
            let last = a.asset.pages.len() as u32 - 1;
            for (first, last) in [(0, 0), (last, last), (0, last)] {
                let pages = far.pages(a, first, last).await.unwrap();
                assert_eq!(pages, near.pages(b, first, last).await.unwrap());
                assert_eq!(pages, made.frames[first as usize..=last as usize].concat());
            }
            let beyond = far.pages(a, 0, last + 1).await;
            assert!(
                matches!(beyond, Err(StreamError::NotFound { .. })),
                "{beyond:?}"
            );
            let object = far.object(&a.asset.hierarchy, 1 << 20).await.unwrap();
            assert_eq!(object, made.hierarchy_bytes);
        }
        for source in [&far, &near] {
            let absent = source.open("absent").await;
            assert!(
                matches!(absent, Err(StreamError::NotFound { .. })),
                "{absent:?}"
            );
            assert!(source.open("../made").await.is_err());
            assert!(source.object(&ContentHash::of(b"absent"), 9).await.is_err());
        }
    });
}

#[test]
fn no_library_is_named_at_once() {
    let empty = tempfile::tempdir().unwrap();
    for bad in [
        "/nowhere/at/all",
        empty.path().to_str().unwrap(),
        "ftp://host",
        "http://",
    ] {
        let error = Source::connect(bad).unwrap_err();
        assert!(error.to_string().contains(bad), "{error}");
    }
}

/// Streams from three places, moving on before all has come; settles, shows everything, then asks for nothing.
fn stream(scene: &MadeScene, source: &str, transport: Transport, slots: u32) {
    let runtime = runtime();
    let source = Source::connect(source).unwrap();
    let opened = Arc::new(runtime.block_on(source.open("made")).unwrap());
    let settings = config(&opened, slots, PixelErrorControl::Governed);
    let handle = runtime.handle().clone();
    let mut streamer = Streamer::new(source, opened, settings, transport, handle).unwrap();
    let mut gpu = PoolModel::new(scene, streamer.residency().layout());
    for (eye, patience) in [
        ([9.0, 0.0, 0.0], 3),
        ([70.0, 0.0, 0.0], 3),
        ([0.5, 0.5, 0.5], 100_000),
    ] {
        let start = Instant::now();
        streamer.view_changed();
        for _ in 0..patience {
            assert!(
                start.elapsed() < Duration::from_secs(60),
                "{:?}",
                streamer.stats()
            );
            let requests = scene.requests(eye, false, streamer.pixel_error());
            gpu.apply(&streamer.tick(&requests));
            gpu.check_cut(eye, streamer.pixel_error());
            if streamer.is_settled() {
                break;
            }
            streamer.wait(Duration::from_millis(1));
        }
    }
    assert!(streamer.is_settled());
    for request in scene.requests([0.5; 3], false, streamer.pixel_error()) {
        assert!(gpu.is_installed(request.page), "page {}", request.page);
    }
    let before = streamer.stats();
    assert!(before.pages_fetched > 0 && before.bytes_fetched > 0);
    assert_eq!(
        (before.failures, before.illegal_transitions),
        (0, 0),
        "{before:?}"
    );
    assert_eq!((before.fetches_in_flight, before.bytes_in_flight), (0, 0));
    for _ in 0..20 {
        let requests = scene.requests([0.5; 3], false, streamer.pixel_error());
        assert!(streamer.tick(&requests).is_empty());
    }
    assert_eq!(streamer.stats().fetches, before.fetches);
}

#[test]
fn a_scene_streams_from_a_folder() {
    let scene = make_scene(2, SIZE);
    let place = library(&scene);
    stream(&scene, &place.folder, Transport::Get, 500);
}

#[test]
fn a_scene_streams_over_http_by_get() {
    let scene = make_scene(3, SIZE);
    let (place, runtime) = (library(&scene), runtime());
    stream(&scene, &serve(&runtime, &place.folder), Transport::Get, 500);
    // And in a pool that is too small.
    stream(&scene, &serve(&runtime, &place.folder), Transport::Get, 12);
}

#[test]
fn a_scene_streams_over_http_by_post() {
    let scene = make_scene(4, SIZE);
    let (place, runtime) = (library(&scene), runtime());
    stream(
        &scene,
        &serve(&runtime, &place.folder),
        Transport::Post,
        500,
    );
    stream(&scene, &serve(&runtime, &place.folder), Transport::Post, 12);
}

#[test]
fn a_folder_takes_no_posts() {
    let scene = make_scene(4, SIZE);
    let (place, runtime) = (library(&scene), runtime());
    let source = Source::connect(&place.folder).unwrap();
    let opened = Arc::new(runtime.block_on(source.open("made")).unwrap());
    let settings = config(&opened, 50, PixelErrorControl::Governed);
    let handle = runtime.handle().clone();
    let refused = Streamer::new(source, opened, settings, Transport::Post, handle);
    assert!(matches!(refused.err(), Some(StreamError::Setting { .. })));
}

/// Invariant 6 from end to end: a byte of a pack changes on the disk; its page is never installed, the rest is.
#[test]
fn a_page_that_fails_its_hash_is_never_installed() {
    use Transport::{Get, Post};
    let scene = make_scene(6, SIZE);
    let (place, runtime) = (library(&scene), runtime());
    let asset = &scene.assets[1].opened.asset;
    let bad_local = asset.root_page_count + 3;
    let pack = std::path::Path::new(&place.folder).join(object_path(&asset.pack));
    let mut bytes = std::fs::read(&pack).unwrap();
    bytes[asset.pages[bad_local as usize].offset as usize + 20] ^= 1;
    std::fs::write(&pack, bytes).unwrap();
    let bad = scene.opened.assets[1].page_base + bad_local;

    let served = || serve(&runtime, &place.folder);
    // A server finds it before the viewer does.
    for (source, transport, failure) in [
        (place.folder.clone(), Get, "expected bytes that hash to"),
        (served(), Get, "expected status 200, found 500"),
        (served(), Post, "a failure of the store"),
    ] {
        let source = Source::connect(&source).unwrap();
        let opened = Arc::new(runtime.block_on(source.open("made")).unwrap());
        let settings = config(&opened, 500, PixelErrorControl::Governed);
        let handle = runtime.handle().clone();
        let mut streamer = Streamer::new(source, opened, settings, transport, handle).unwrap();
        let mut gpu = PoolModel::new(&scene, streamer.residency().layout());
        let start = Instant::now();
        let eye = [30.5, 0.5, 0.5];
        while !streamer.residency().is_stalled() {
            assert!(
                start.elapsed() < Duration::from_secs(60),
                "{:?}",
                streamer.stats()
            );
            gpu.apply(&streamer.tick(&scene.requests(eye, false, 1.0)));
            gpu.check_cut(eye, 1.0);
            streamer.wait(Duration::from_millis(1));
        }
        assert!(!gpu.is_installed(bad) && !streamer.is_settled());
        let stats = streamer.stats();
        assert_eq!(stats.pages_failed, 1);
        let last_failure = stats.last_failure.unwrap();
        assert!(last_failure.contains(failure), "{last_failure}");
        let wanted = scene.requests(eye, false, 1.0);
        let installed = wanted
            .iter()
            .filter(|want| gpu.is_installed(want.page))
            .count();
        assert!(
            installed * 2 > wanted.len(),
            "{installed} of {}",
            wanted.len()
        );
    }
}

/// A damaged scene, asset, hierarchy or root page is an error of `open`, not a picture.
#[test]
fn open_checks_every_object() {
    let scene = make_scene(7, SIZE);
    let runtime = runtime();
    let asset = &scene.assets[0].opened;
    let scene_hash = ContentHash::of(&scene.opened.scene.encode().unwrap());
    for hash in [
        scene_hash,
        asset.hash,
        asset.asset.hierarchy,
        asset.asset.pack,
    ] {
        let place = library(&scene);
        let object = std::path::Path::new(&place.folder).join(object_path(&hash));
        let mut bytes = std::fs::read(&object).unwrap();
        bytes[15] ^= 1;
        std::fs::write(&object, bytes).unwrap();
        let near = Source::connect(&place.folder).unwrap();
        let opened = runtime.block_on(near.open("made"));
        assert!(matches!(opened, Err(StreamError::Hash { .. })), "{hash}");
        let far = Source::connect(&serve(&runtime, &place.folder)).unwrap();
        assert!(runtime.block_on(far.open("made")).is_err(), "{hash}");
    }
}

/// A server that says what it is told to: HTTP/1.1 only, one answer a connection.
fn say(answer: &'static str) -> String {
    use std::io::{Read, Write};
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            std::thread::spawn(move || {
                let mut head = [0; 4096];
                let read = stream.read(&mut head).unwrap_or(0);
                let is_http2 = head[..read].starts_with(b"PRI ");
                let bad =
                    "HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";
                let said = if is_http2 { bad } else { answer };
                let _ = stream.write_all(said.as_bytes());
                // A body that never ends keeps the connection.
                std::thread::sleep(Duration::from_secs(if said.contains("1000000") {
                    20
                } else {
                    0
                }));
            });
        }
    });
    url
}

/// A balancer in front of `url` whose first connections break off after some bytes of the answer, as where a server was killed.
fn breaking(url: &str, connections: usize, after_bytes: u64) -> String {
    use std::io::Read;
    use std::net::{Shutdown, TcpListener, TcpStream};
    let behind = url.strip_prefix("http://").unwrap().to_owned();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for (number, client) in listener.incoming().enumerate() {
            let (client, server) = (client.unwrap(), TcpStream::connect(&behind).unwrap());
            let (mut asks, mut asked) = (client.try_clone().unwrap(), server.try_clone().unwrap());
            // Either end may go first: both copies then end with an error.
            std::thread::spawn(move || std::io::copy(&mut asks, &mut asked));
            std::thread::spawn(move || {
                let most = if number < connections {
                    after_bytes
                } else {
                    u64::MAX
                };
                let _ = std::io::copy(&mut (&server).take(most), &mut &client);
                let _ = client.shutdown(Shutdown::Both);
                let _ = server.shutdown(Shutdown::Both);
            });
        }
    });
    format!("http://{address}")
}

#[test]
fn a_scene_whose_answer_breaks_off_is_asked_for_again() {
    let scene = make_scene(4, SIZE);
    let (place, runtime) = (library(&scene), runtime());
    let url = serve(&runtime, &place.folder);
    for (broken, opens) in [(0, true), (2, true), (100, false)] {
        let source = Source::connect(&breaking(&url, broken, 4000)).unwrap();
        let opened = runtime.block_on(source.open("made"));
        assert_eq!(opened.is_ok(), opens, "{broken}: {:?}", opened.err());
    }
}

#[test]
fn a_server_without_http2_serves() {
    let answer =
        "HTTP/1.1 200 OK\r\nContent-Length: 13\r\nConnection: close\r\n\r\n{\"scenes\":[]}";
    let source = Source::connect(&say(answer)).unwrap();
    let runtime = runtime();
    assert_eq!(runtime.block_on(source.scenes()).unwrap(), vec![]);
    assert_eq!(runtime.block_on(source.scenes()).unwrap(), vec![]);
}

#[test]
fn odd_servers_are_told_apart() {
    let scene = make_scene(8, SIZE);
    let opened = &scene.opened.assets[0];
    let runtime = runtime();
    let pages = |answer| {
        let source = Source::connect(&say(answer)).unwrap();
        runtime.block_on(source.pages(opened, 0, 1)).unwrap_err()
    };
    let start = Instant::now();
    let whole = pages("HTTP/1.1 200 OK\r\nContent-Length: 1000000000\r\n\r\nxxxx");
    assert!(
        matches!(
            whole,
            StreamError::Length {
                found_bytes: 1_000_000_000,
                ..
            }
        ),
        "{whole}"
    );
    assert!(start.elapsed() < Duration::from_secs(10), "not waited for");
    let busy = pages("HTTP/1.1 503 Busy\r\nRetry-After: 7\r\nContent-Length: 0\r\n\r\n");
    assert_eq!(busy.retry(), Retry::After(7.0), "{busy}");
    let partial = pages("HTTP/1.1 206 Partial Content\r\nContent-Length: 4\r\n\r\nxxxx");
    assert!(
        matches!(partial, StreamError::Status { status: 206, .. }),
        "{partial}"
    );
    let gone = pages("HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n");
    assert_eq!(gone.retry(), Retry::Late, "{gone}");
    let cut = pages("HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n4\r\nxxxx\r\n");
    assert_eq!(cut.retry(), Retry::BackOff, "{cut}");

    let source = Source::connect(&say("HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n")).unwrap();
    let unended = runtime.block_on(source.open("made")).unwrap_err();
    assert!(unended.to_string().contains("no end block"), "{unended}");
    // Nobody listens on the port of a listener that is gone.
    let free = std::net::TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let source = Source::connect(&format!("http://{free}")).unwrap();
    let refused = runtime.block_on(source.scenes()).unwrap_err();
    assert!(refused.to_string().contains(&free.to_string()), "{refused}");
}

/// A bumpy sheet, large enough for a few levels and pages.
fn sheet(side: u32) -> Mesh {
    let at = |i: u32, j: u32| {
        let (x, z) = (i as f32 / side as f32, j as f32 / side as f32);
        [4.0 * x, 0.3 * (9.0 * x).sin() * (11.0 * z).cos(), 4.0 * z]
    };
    let positions: Vec<[f32; 3]> = (0..=side)
        .flat_map(|i| (0..=side).map(move |j| at(i, j)))
        .collect();
    let vertex = |i: u32, j: u32| i * (side + 1) + j;
    let triangles: Vec<[u32; 3]> = (0..side)
        .flat_map(|i| (0..side).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [
                vertex(i, j),
                vertex(i, j + 1),
                vertex(i + 1, j + 1),
                vertex(i + 1, j),
            ];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    Mesh {
        name: "sheet".to_owned(),
        normals: Some(vec![[0.0, 1.0, 0.0]; positions.len()]),
        triangle_materials: vec![0; triangles.len()],
        material_slots: vec![0],
        positions,
        triangles,
        ..Mesh::default()
    }
}

/// What the builder really makes streams by both transports and is a valid cut all the way.
#[test]
fn a_built_mesh_streams_over_http() {
    let built = build(sheet(180), &BuildOptions::default()).unwrap();
    let asset: Asset = built.asset.clone();
    let hierarchy = Hierarchy::decode(&built.hierarchy_bytes, asset.pages.len() as u32).unwrap();
    let made = made_of(
        asset,
        hierarchy,
        &Bytes::from(
            built
                .pack
                .read(0..built.asset.pack_bytes())
                .unwrap()
                .into_owned(),
        ),
        built.asset_bytes,
        built.hierarchy_bytes,
    );
    let opened = &made.opened;
    let pages = opened.asset.pages.len() as u32;
    assert!(
        pages > opened.asset.root_page_count,
        "something is left to stream"
    );
    for page in 0..pages {
        let frame = &made.frames[page as usize];
        decode_page(&opened.hash, &opened.asset, &opened.hierarchy, page, frame).unwrap();
    }
    let scene = MadeScene::over(vec![made]);
    let (place, runtime) = (library(&scene), runtime());
    let url = serve(&runtime, &place.folder);
    for transport in [Transport::Get, Transport::Post] {
        stream(&scene, &url, transport, 100);
        stream(&scene, &url, transport, 4);
    }
}
