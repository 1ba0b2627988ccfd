//! Every store must pass the same tests: a local folder, memory, and a server that speaks S3 where there is one (`make test-s3`).
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::fs::File;
use std::sync::Arc;

use bytes::Bytes;
use futures_util::TryStreamExt;
use lodestream_format::ContentHash;
use lodestream_server::library::{
    BuildRecord, Check, GcOptions, Library, LibraryError, PlanNote, Put,
};
use support::stores::on_each_store;
use support::{age, files, made};

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
    std::fs::write(&path, b"LSS2 broken").unwrap();
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
    age(std::slice::from_ref(&path));
    assert_eq!(library.put_object(bytes, 60).await.unwrap().1, Put::Known);
    let options = GcOptions {
        grace_secs: 86_400,
        dry_run: false,
    };
    assert_eq!(library.gc(options).await.unwrap().young, 1);
    assert!(library.object(&hash).await.is_ok());
}

#[tokio::test]
async fn files_become_objects_part_by_part() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    on_each_store(|library| async move {
        let file = folder.join("file");
        // Around the size of a part, 8 MiB.
        for bytes in [0, 1, (8 << 20) - 1, 8 << 20, (8 << 20) + 1, 40_000_000] {
            let content = Bytes::from(made::noise(bytes as u64, bytes));
            std::fs::write(&file, &content).unwrap();
            let open = Arc::new(File::open(&file).unwrap());
            let put = library.put_object_file(&open, &file, 60).await.unwrap();
            assert_eq!(put, (ContentHash::of(&content), Put::Stored), "{bytes}");
            assert_eq!(library.object(&put.0).await.unwrap(), content, "{bytes}");
            for put in [
                library.put_object_file(&open, &file, 60).await.unwrap(),
                library.put_object(content.clone(), 60).await.unwrap(),
            ] {
                assert_eq!(put, (ContentHash::of(&content), Put::Known), "{bytes}");
            }
        }
        // A folder opens as a file does, and cannot be read.
        let no_file = Arc::new(File::open(folder).unwrap());
        let put = library.put_object_file(&no_file, folder, 60).await;
        let error = put.unwrap_err().to_string();
        assert!(error.contains(folder.to_str().unwrap()), "{error}");
    })
    .await;
}

#[tokio::test]
async fn a_damaged_or_old_object_is_mended_from_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("library");
    let library = Library::open_or_create(place.to_str().unwrap()).unwrap();
    let bytes = made::noise(5, 20_000_000);
    let file = folder.path().join("file");
    std::fs::write(&file, &bytes).unwrap();
    let open = Arc::new(File::open(&file).unwrap());
    let (hash, _) = library.put_object_file(&open, &file, 60).await.unwrap();
    let path = place.join(lodestream_format::library::object_path(&hash));
    let mut flipped = bytes.clone();
    flipped[19_999_999] ^= 1;
    for damage in [&flipped[..], &bytes[..19_999_999], &[]] {
        std::fs::write(&path, damage).unwrap();
        let put = library.put_object_file(&open, &file, 60).await.unwrap();
        assert_eq!(put, (hash, Put::Healed));
        assert_eq!(std::fs::read(&path).unwrap(), bytes);
    }
    age(std::slice::from_ref(&path));
    let old = path.metadata().unwrap().modified().unwrap();
    let put = library.put_object_file(&open, &file, 60).await.unwrap();
    assert_eq!(put, (hash, Put::Known));
    assert!(path.metadata().unwrap().modified().unwrap() > old);
    // Nothing is left of the parts.
    assert_eq!(files(&place), [path]);
}

fn record_of(made: &made::Made, report: u32) -> BuildRecord<u32> {
    BuildRecord {
        report,
        ..made::record_of(made)
    }
}

#[tokio::test]
async fn build_records_come_back_and_say_whether_they_hold() {
    on_each_store(|library| async move {
        let key = ContentHash::of(b"key");
        assert_eq!(library.build::<u32>(&key).await.unwrap(), None);
        let made = made::asset(&library, 1, 3, 100).await;
        let record = record_of(&made, 7);
        library.put_build(&key, &record).await.unwrap();
        assert_eq!(library.build(&key).await.unwrap(), Some(record.clone()));
        library.has_build(&record, Check::Hash).await.unwrap();
        // A record with another report is no record of this version.
        let error = library.build::<String>(&key).await.unwrap_err();
        assert!(matches!(error, LibraryError::Damaged { .. }), "{error}");
        assert!(error.to_string().contains(&key.to_string()), "{error}");
        for (wrong, missing) in [
            (
                BuildRecord {
                    asset: key,
                    ..record.clone()
                },
                true,
            ),
            (
                BuildRecord {
                    pack: key,
                    ..record.clone()
                },
                false,
            ),
            (
                BuildRecord {
                    pack_bytes: 1,
                    ..record.clone()
                },
                false,
            ),
            (
                BuildRecord {
                    hierarchy_bytes: 1,
                    ..record.clone()
                },
                false,
            ),
        ] {
            let error = library.has_build(&wrong, Check::Length).await.unwrap_err();
            assert_eq!(error.is_missing(), missing, "{error}");
        }
    })
    .await;
}

#[tokio::test]
async fn gc_keeps_the_records_of_what_is_there() {
    on_each_store(|library| async move {
        let key = |name: &str| ContentHash::of(name.as_bytes());
        let mut assets = vec![];
        for (seed, name) in [(1, "live"), (2, "orphan"), (3, "gone")] {
            let made = made::asset(&library, seed, 3, 100).await;
            let record = record_of(&made, 0);
            library.put_build(&key(name), &record).await.unwrap();
            assets.push(made);
        }
        made::scene(&library, "city", &assets[..1]).await;
        let nowhere = BuildRecord {
            pack: key("no such pack"),
            ..record_of(&assets[2], 0)
        };
        library.put_build(&key("gone"), &nowhere).await.unwrap();
        let sweep = |grace_secs, dry_run| {
            library.gc(GcOptions {
                grace_secs,
                dry_run,
            })
        };
        for dry_run in [true, false] {
            // Young, and yet of no use: one of its objects is not there.
            let young = sweep(3600, dry_run).await.unwrap();
            assert_eq!((young.records, young.removed_records), (2, 1));
            assert_eq!(young.removed, 0);
        }
        let swept = sweep(0, false).await.unwrap();
        assert_eq!((swept.records, swept.removed_records), (1, 1));
        // Asset, hierarchy and pack of two.
        assert_eq!(swept.removed, 6);
        for (name, there) in [("live", true), ("orphan", false), ("gone", false)] {
            let record = library.build::<u32>(&key(name)).await.unwrap();
            assert_eq!(record.is_some(), there, "{name}");
        }
        library
            .has_build(&record_of(&assets[0], 0), Check::Hash)
            .await
            .unwrap();
    })
    .await;
}

#[tokio::test]
async fn gc_leaves_old_objects_that_a_young_note_names() {
    let folder = tempfile::tempdir().unwrap();
    let library = Library::open(folder.path().to_str().unwrap()).unwrap();
    let (one, two) = (
        made::asset(&library, 1, 3, 100).await,
        made::asset(&library, 2, 3, 100).await,
    );
    let outline = made::put(&library, Bytes::from_static(b"outline")).await;
    let orphan = made::put(&library, Bytes::from_static(b"orphan")).await;
    let (recorded, planned) = (ContentHash::of(b"recorded"), ContentHash::of(b"planned"));
    let second = record_of(&two, 2);
    library.put_build(&planned, &second).await.unwrap();
    age(&files(folder.path()));
    let first = record_of(&one, 1);
    library.put_build(&recorded, &first).await.unwrap();
    let plan = PlanNote {
        objects: vec![outline],
        builds: vec![planned],
        plan: "the rest",
    };
    library.put_plan("city", &plan).await.unwrap();
    let found = library.plan::<String>("city").await.unwrap();
    assert_eq!((found.objects, found.builds), (plan.objects, plan.builds));
    let options = GcOptions {
        grace_secs: 86_400,
        dry_run: false,
    };
    let swept = library.gc(options).await.unwrap();
    assert_eq!((swept.removed, swept.removed_records), (1, 0));
    assert_eq!((swept.records, swept.plans), (2, 1));
    assert!(library.object(&orphan).await.is_err());
    assert!(library.object(&outline).await.is_ok());
    for made in [&one, &two] {
        library
            .has_build(&record_of(made, 0), Check::Hash)
            .await
            .unwrap();
    }
    age(&files(folder.path()));
    let swept = library.gc(options).await.unwrap();
    assert_eq!((swept.removed_records, swept.removed_plans), (2, 1));
    assert_eq!(files(folder.path()), [] as [std::path::PathBuf; 0]);
}
