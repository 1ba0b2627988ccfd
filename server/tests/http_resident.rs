//! Pages of a folder that the system has in memory: the pack's bytes, and never others, whatever happens to the file.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]
#![cfg(target_os = "linux")]

mod support;

use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use lodestream_format::library::object_path;
use lodestream_server::library::Library;
use reqwest::{Client, StatusCode};
use support::made::{self, Made};
use support::server::{Running, client};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

const PAGES: u32 = 40;

/// A library in a folder under a server that holds an eighth of the pages itself; one was read, so that the pack is open.
async fn served(folder: &Path) -> (Running, Made, Client) {
    served_with_cache(folder, 400_000).await
}

async fn served_with_cache(folder: &Path, cache_bytes: usize) -> (Running, Made, Client) {
    let library = Library::open(folder.to_str().unwrap()).unwrap();
    let asset = made::asset(&library, 5, PAGES, 60_000).await;
    let server = Running::start_with_cache(library, cache_bytes).await;
    let client = client();
    let first = get(&client, &server, &asset, 0, 0).await;
    assert_eq!(first.unwrap(), asset.frame(0));
    (server, asset, client)
}

async fn get(
    client: &Client,
    server: &Running,
    asset: &Made,
    first: u32,
    last: u32,
) -> Result<Vec<u8>, StatusCode> {
    let path = format!("/v1/assets/{}/pages/{first}-{last}", asset.hash);
    let answer = client.get(server.url(&path)).send().await.unwrap();
    match answer.status() {
        StatusCode::OK => Ok(answer.bytes().await.unwrap().to_vec()),
        status => Err(status),
    }
}

/// Ranges that were read from the system's memory, or went out from there.
async fn resident(server: &Running) -> [u64; 2] {
    reads(server, ["resident", "mapped"]).await
}

async fn reads<const N: usize>(server: &Running, results: [&str; N]) -> [u64; N] {
    // By a connection of its own: one that asked for anything but pages is hyper's, which sends what it holds.
    let metrics = client().get(server.url("/metrics")).send().await.unwrap();
    let metrics = metrics.text().await.unwrap();
    results.map(|result| {
        let line = format!("lodestream_page_cache_reads_total{{result=\"{result}\"}} ");
        let value = metrics.lines().find_map(|found| found.strip_prefix(&line));
        value.unwrap().parse().unwrap()
    })
}

fn pack(folder: &Path, asset: &Made) -> PathBuf {
    folder.join(object_path(&asset.asset.pack))
}

fn flip(folder: &Path, asset: &Made, page: u32) {
    let file = std::fs::File::options()
        .read(true)
        .write(true)
        .open(pack(folder, asset))
        .unwrap();
    let at = asset.asset.pages[page as usize].offset + 1000;
    let mut byte = [0];
    file.read_exact_at(&mut byte, at).unwrap();
    file.write_all_at(&[byte[0] ^ 4], at).unwrap();
}

/// Longer than the server's time between two looks at a pack's file.
async fn noticed() {
    tokio::time::sleep(Duration::from_millis(5)).await;
}

#[tokio::test]
async fn what_the_system_has_in_memory_is_the_packs_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (server, asset, client) = served(folder.path()).await;
    let before = resident(&server).await;
    let mut asked = 0;
    for round in 0..3 {
        for first in 0..PAGES {
            let last = (first + round).min(PAGES - 1);
            let read = get(&client, &server, &asset, first, last).await;
            assert_eq!(
                read.unwrap(),
                (first..=last)
                    .flat_map(|page| asset.frame(page))
                    .copied()
                    .collect::<Vec<_>>()
            );
            asked += 1;
        }
    }
    // The system may let go of some, hardly of most. What was read once goes out from where it is.
    let [read, mapped] = resident(&server).await;
    let [read, mapped] = [read - before[0], mapped - before[1]];
    assert!(read + mapped > asked / 2, "{read} and {mapped} of {asked}");
    assert!(mapped > 0, "{read} and {mapped} of {asked}");
    server.stop().await;
}

#[tokio::test]
async fn a_page_that_changes_on_the_disk_is_never_sent() {
    let folder = tempfile::tempdir().unwrap();
    let (server, asset, client) = served(folder.path()).await;
    for read_before in [false, true] {
        let pages = 10 + 10 * u32::from(read_before)..20 + 10 * u32::from(read_before);
        for page in pages.clone().filter(|_| read_before) {
            let read = get(&client, &server, &asset, page, page).await;
            assert_eq!(read.unwrap(), asset.frame(page));
        }
        pages
            .clone()
            .for_each(|page| flip(folder.path(), &asset, page));
        noticed().await;
        let mut refused = 0;
        for page in pages.clone() {
            match get(&client, &server, &asset, page, page).await {
                // Held by the server itself.
                Ok(read) => assert_eq!(read, asset.frame(page)),
                Err(status) => {
                    assert_eq!(status, StatusCode::INTERNAL_SERVER_ERROR);
                    refused += 1;
                }
            }
        }
        assert!(refused >= 5, "{refused} of 10 pages");
        let beside = get(&client, &server, &asset, pages.end, pages.end).await;
        assert_eq!(beside.unwrap(), asset.frame(pages.end));
        pages
            .clone()
            .for_each(|page| flip(folder.path(), &asset, page));
        noticed().await;
        for page in pages {
            let read = get(&client, &server, &asset, page, page).await;
            assert_eq!(read.unwrap(), asset.frame(page));
        }
    }
    server.stop().await;
}

#[tokio::test]
async fn a_pack_that_is_removed_takes_no_place_once_it_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let (server, asset, client) = served(folder.path()).await;
    let pack = std::fs::canonicalize(pack(folder.path(), &asset)).unwrap();
    let open = || {
        let files = std::fs::read_dir("/proc/self/fd").unwrap();
        let mut targets = files.filter_map(|file| std::fs::read_link(file.ok()?.path()).ok());
        targets.any(|target| target.to_string_lossy().contains(pack.to_str().unwrap()))
    };
    assert!(open());
    std::fs::remove_file(&pack).unwrap();
    noticed().await;
    let read = get(&client, &server, &asset, 30, 30).await;
    assert_eq!(read, Err(StatusCode::INTERNAL_SERVER_ERROR));
    assert!(!open());
    server.stop().await;
}

#[tokio::test]
async fn a_pack_that_is_cut_while_it_is_sent_ends_the_connection_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let (server, asset, client) = served(folder.path()).await;
    for page in (0..PAGES).chain(0..PAGES) {
        let read = get(&client, &server, &asset, page, page).await;
        assert_eq!(read.unwrap(), asset.frame(page));
    }
    let [_, mapped] = resident(&server).await;
    // A client that takes some of the pages, and waits.
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    let last = PAGES - 1;
    let head = format!(
        "GET /v1/assets/{}/pages/0-{last} HTTP/1.1\r\nhost: x\r\n\r\n",
        asset.hash
    );
    stream.write_all(head.as_bytes()).await.unwrap();
    let mut read = vec![0; 100_000];
    stream.read_exact(&mut read).await.unwrap();
    tokio::time::sleep(Duration::from_millis(200)).await;
    let file = std::fs::File::options()
        .write(true)
        .open(pack(folder.path(), &asset));
    file.unwrap().set_len(0).unwrap();
    // A reset is as good an end as any.
    let _ = stream.read_to_end(&mut read).await;
    let begin = read
        .windows(4)
        .position(|bytes| bytes == b"\r\n\r\n")
        .unwrap()
        + 4;
    let whole: Vec<u8> = (0..PAGES)
        .flat_map(|page| asset.frame(page).to_vec())
        .collect();
    assert!(read.len() - begin < whole.len(), "all of it was sent");
    assert!(whole.starts_with(&read[begin..]), "other bytes");
    assert!(resident(&server).await[1] > mapped);
    let lost = get(&client, &server, &asset, last, last).await;
    assert_eq!(lost, Err(StatusCode::INTERNAL_SERVER_ERROR));
    server.stop().await;
}

#[tokio::test]
async fn every_piece_of_a_range_that_is_asked_for_often_gets_into_the_cache() {
    let folder = tempfile::tempdir().unwrap();
    let (server, asset, _) = served_with_cache(folder.path(), 8_000_000).await;
    let client = support::server::client_h2();
    for _ in 0..1000 {
        let [resident] = reads(&server, ["resident"]).await;
        get(&client, &server, &asset, 10, 13).await.unwrap();
        if reads(&server, ["resident"]).await == [resident] {
            return server.stop().await;
        }
    }
    panic!("a thousand answers, and none from the cache alone");
}
