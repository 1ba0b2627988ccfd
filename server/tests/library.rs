//! Every store must pass the same tests: a local folder and memory.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use bytes::Bytes;
use futures_util::TryStreamExt;
use lodestream_format::ContentHash;
use lodestream_server::library::{GcOptions, Library, LibraryError, Put};
use support::made;

/// A test over each kind of store.
async fn on_each_store<F: Future<Output = ()>>(test: impl Fn(Library) -> F) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new").join("library");
    test(Library::open_or_create(path.to_str().unwrap()).unwrap()).await;
    test(Library::open("memory://").unwrap()).await;
}

async fn hashes(library: &Library) -> Vec<ContentHash> {
    let entries: Vec<_> = library.objects().try_collect().await.unwrap();
    let mut hashes: Vec<_> = entries.iter().map(|entry| entry.hash.unwrap()).collect();
    hashes.sort();
    hashes
}

#[tokio::test]
async fn objects_come_back_whole_in_ranges_and_in_pieces() {
    on_each_store(|library| async move {
        let bytes = Bytes::from(made::noise(1, 9_000_000));
        let (hash, put) = library.put_object(bytes.clone(), 60).await.unwrap();
        assert_eq!((hash, put), (ContentHash::of(&bytes), Put::Stored));
        let again = library.put_object(bytes.clone(), 60).await.unwrap();
        assert_eq!(again, (hash, Put::Known));
        assert_eq!(library.object(&hash).await.unwrap(), bytes);
        assert_eq!(library.object_bytes(&hash).await.unwrap(), Some(9_000_000));
        assert_eq!(library.check_object(&hash).await.unwrap(), 9_000_000);
        let range = library.object_range(&hash, 5..12).await.unwrap();
        assert_eq!(range, bytes.slice(5..12));
        assert_eq!(
            library.object_range(&hash, 7..7).await.unwrap(),
            Bytes::new()
        );
        let pieces: Vec<Bytes> = library
            .object_pieces(&hash, 3..8_999_999)
            .try_collect()
            .await
            .unwrap();
        assert!(pieces.len() > 1, "bounded pieces");
        assert_eq!(pieces.concat(), bytes.slice(3..8_999_999));
        let (empty, _) = library.put_object(Bytes::new(), 60).await.unwrap();
        assert_eq!(library.object(&empty).await.unwrap(), Bytes::new());
    })
    .await;
}

#[tokio::test]
async fn what_is_not_there_is_missing_and_a_short_object_is_damaged() {
    on_each_store(|library| async move {
        let unknown = ContentHash::of(b"unknown");
        assert!(library.object(&unknown).await.unwrap_err().is_missing());
        assert!(
            library
                .object_range(&unknown, 0..1)
                .await
                .unwrap_err()
                .is_missing()
        );
        assert!(
            library
                .check_object(&unknown)
                .await
                .unwrap_err()
                .is_missing()
        );
        assert_eq!(library.object_bytes(&unknown).await.unwrap(), None);
        assert!(library.reference("nothing").await.unwrap_err().is_missing());
        assert!(library.remove("nothing").await.unwrap_err().is_missing());
        assert!(
            library
                .reference("../nothing")
                .await
                .unwrap_err()
                .is_missing()
        );
        let (hash, _) = library
            .put_object(Bytes::from_static(b"ten bytes."), 60)
            .await
            .unwrap();
        for range in [0..11, 10..11, 20..30] {
            let error = library
                .object_range(&hash, range.clone())
                .await
                .unwrap_err();
            assert!(
                matches!(error, LibraryError::Damaged { .. }),
                "{range:?}: {error}"
            );
        }
    })
    .await;
}

#[tokio::test]
async fn names_are_listed_in_order_page_by_page() {
    on_each_store(|library| async move {
        let one = made::asset(&library, 1, 3, 100).await;
        let scene = made::scene(&library, "city", &[one]).await;
        for name in ["b", "a", "c.2", "Z", "c-1"] {
            library.publish(name, scene).await.unwrap();
        }
        let mut after = None;
        let mut names = vec![];
        loop {
            let page = library.scenes(after.as_deref(), 2).await.unwrap();
            assert!(
                page.scenes.len() <= 2 && page.scenes.iter().all(|e| e.reference.scene == scene)
            );
            names.extend(page.scenes.into_iter().map(|entry| entry.name));
            after = page.next;
            if after.is_none() {
                break;
            }
        }
        assert_eq!(names, ["Z", "a", "b", "c-1", "c.2", "city"]);
        library.remove("b").await.unwrap();
        assert_eq!(
            library.scene_names(Some("a"), 10).await.unwrap(),
            ["c-1", "c.2", "city"]
        );
        assert_eq!(library.scenes(Some("zzz"), 10).await.unwrap().scenes, []);
    })
    .await;
}

#[tokio::test]
async fn publishing_swaps_the_name_and_needs_every_object() {
    on_each_store(|library| async move {
        let (one, two) = (
            made::asset(&library, 1, 3, 100).await,
            made::asset(&library, 2, 3, 100).await,
        );
        let first = made::scene(&library, "city", &[one]).await;
        let second = made::scene(&library, "city", std::slice::from_ref(&two)).await;
        assert_ne!(first, second);
        assert_eq!(library.reference("city").await.unwrap().scene, second);

        let elsewhere = Library::open("memory://").unwrap();
        let bytes = library.object(&second).await.unwrap();
        made::put(&elsewhere, bytes).await;
        let error = elsewhere.publish("city", second).await.unwrap_err();
        assert!(error.is_missing(), "{error}");
        made::put(&elsewhere, library.object(&two.hash).await.unwrap()).await;
        made::put(&elsewhere, two.hierarchy.clone()).await;
        let error = elsewhere.publish("city", second).await.unwrap_err();
        assert!(
            error.to_string().contains(&two.asset.pack.to_string()),
            "{error}"
        );
        assert!(elsewhere.reference("city").await.is_err());
        made::put(&elsewhere, two.pack.clone()).await;
        elsewhere.publish("city", second).await.unwrap();
    })
    .await;
}

#[tokio::test]
async fn gc_takes_what_hangs_on_no_scene_and_nothing_young() {
    on_each_store(|library| async move {
        let (one, two) = (
            made::asset(&library, 1, 3, 100).await,
            made::asset(&library, 2, 3, 100).await,
        );
        made::scene(&library, "kept", std::slice::from_ref(&one)).await;
        made::scene(&library, "both", &[one, two]).await;
        let mut live = hashes(&library).await;
        let orphan = made::put(&library, Bytes::from_static(b"orphan")).await;

        let sweep = |grace_secs, dry_run| {
            library.gc(GcOptions {
                grace_secs,
                dry_run,
            })
        };
        let young = sweep(3600, false).await.unwrap();
        assert_eq!(
            (young.removed, young.young, young.live),
            (0, 1, live.len() as u64)
        );
        let dry = sweep(0, true).await.unwrap();
        assert_eq!((dry.removed, dry.removed_bytes), (1, 6));
        assert!(library.object(&orphan).await.is_ok());
        assert_eq!(sweep(0, false).await.unwrap().removed, 1);
        assert_eq!(hashes(&library).await, live);

        library.remove("both").await.unwrap();
        let kept = library.reference("kept").await.unwrap();
        let reach = library.reach(&kept.scene).await.unwrap();
        sweep(0, false).await.unwrap();
        live.retain(|hash| reach.contains(hash));
        assert_eq!(hashes(&library).await, live);
        // scene, asset, pack, hierarchy
        assert_eq!(live.len(), 4);
        library.remove("kept").await.unwrap();
        sweep(0, false).await.unwrap();
        assert_eq!(hashes(&library).await, []);
    })
    .await;
}

#[tokio::test]
async fn gc_stops_before_a_damaged_scene_can_cost_objects() {
    let folder = tempfile::tempdir().unwrap();
    let library = Library::open(folder.path().to_str().unwrap()).unwrap();
    let one = made::asset(&library, 1, 3, 100).await;
    let scene = made::scene(&library, "city", std::slice::from_ref(&one)).await;
    let orphan = made::put(&library, Bytes::from_static(b"orphan")).await;
    let path = folder
        .path()
        .join(lodestream_format::library::object_path(&scene));
    std::fs::write(&path, b"LSS1 broken").unwrap();
    let options = GcOptions {
        grace_secs: 0,
        dry_run: false,
    };
    let error = library.gc(options).await.unwrap_err();
    assert!(matches!(error, LibraryError::Damaged { .. }), "{error}");
    for hash in [one.hash, one.asset.pack, one.asset.hierarchy, orphan] {
        assert!(library.object(&hash).await.is_ok());
    }
}

#[tokio::test]
async fn damaged_objects_are_told_and_heal_when_put_again() {
    let folder = tempfile::tempdir().unwrap();
    let library = Library::open(folder.path().to_str().unwrap()).unwrap();
    let bytes = Bytes::from(made::noise(3, 5_000_000));
    let hash = made::put(&library, bytes.clone()).await;
    let path = folder
        .path()
        .join(lodestream_format::library::object_path(&hash));
    let mut flipped = bytes.to_vec();
    flipped[4_500_000] ^= 1;
    for damage in [flipped, bytes[..4_999_999].to_vec(), vec![]] {
        std::fs::write(&path, damage).unwrap();
        for error in [
            library.object(&hash).await.unwrap_err(),
            library.check_object(&hash).await.unwrap_err(),
        ] {
            assert!(matches!(error, LibraryError::Damaged { .. }), "{error}");
            assert!(error.to_string().contains(&hash.to_string()), "{error}");
        }
        let put = library.put_object(bytes.clone(), 60).await.unwrap();
        assert_eq!(put, (hash, Put::Healed));
        assert_eq!(library.object(&hash).await.unwrap(), bytes);
    }
}

#[tokio::test]
async fn an_old_object_is_young_again_once_it_is_put_again() {
    let folder = tempfile::tempdir().unwrap();
    let library = Library::open(folder.path().to_str().unwrap()).unwrap();
    let bytes = Bytes::from_static(b"used again");
    let hash = made::put(&library, bytes.clone()).await;
    let path = folder
        .path()
        .join(lodestream_format::library::object_path(&hash));
    let long_ago = std::time::SystemTime::now() - std::time::Duration::from_secs(7 * 86_400);
    let file = std::fs::File::options().write(true).open(&path).unwrap();
    file.set_modified(long_ago).unwrap();
    assert_eq!(library.put_object(bytes, 60).await.unwrap().1, Put::Known);
    let options = GcOptions {
        grace_secs: 86_400,
        dry_run: false,
    };
    assert_eq!(library.gc(options).await.unwrap().young, 1);
    assert!(library.object(&hash).await.is_ok());
}

#[test]
fn a_library_that_cannot_be_opened_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, b"").unwrap();
    let (file, none) = (file.to_str().unwrap(), folder.path().join("none"));
    for (location, expected) in [
        ("s3://bucket/prefix", "no S3"),
        ("http://x/", "http:// URL"),
        (file, "expected a folder, found a file"),
        (none.to_str().unwrap(), "No such file"),
    ] {
        let error = Library::open(location).unwrap_err().to_string();
        assert!(
            error.contains(expected) && error.contains(location),
            "{error}"
        );
        assert!(!error.contains('\n'));
    }
    assert!(Library::open_or_create(file).is_err());
}
