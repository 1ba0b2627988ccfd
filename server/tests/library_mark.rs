//! The mark of a library, and staged files of killed writers.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use bytes::Bytes;
use lodestream_format::library::{MARK, object_path};
use lodestream_server::library::{GcOptions, Library, LibraryError};
use object_store::ObjectStoreExt;
use object_store::path::Path;
use support::stores::on_each_raw_store;
use support::{age, files, made};

const GOLDEN: &str = "{\"format\": \"lodestream-library\", \"version\": 1}\n";

async fn no_library(library: &Library) {
    let error = library.check().await.unwrap_err();
    assert!(matches!(error, LibraryError::Location { .. }), "{error}");
    assert!(error.to_string().contains("expected a library"), "{error}");
}

#[tokio::test]
async fn a_place_is_a_library_once_it_is_made_one() {
    on_each_raw_store(|library, store| async move {
        no_library(&library).await;
        for _ in 0..2 {
            library.make().await.unwrap();
            library.check().await.unwrap();
            let mark = store.get(&Path::from(MARK)).await.unwrap();
            assert_eq!(mark.bytes().await.unwrap(), GOLDEN);
        }
        // gc keeps the mark of an empty library.
        let options = GcOptions {
            grace_secs: 0,
            dry_run: false,
        };
        library.gc(options).await.unwrap();
        library.check().await.unwrap();
    })
    .await;
}

#[tokio::test]
async fn marks_of_newer_versions_and_garbage_are_refused() {
    on_each_raw_store(|library, store| async move {
        let asset = made::asset(&library, 1, 1, 100).await;
        made::scene(&library, "city", &[asset]).await;
        let long = format!("{GOLDEN}{}", " ".repeat(5000));
        for (mark, expected) in [
            (
                r#"{"format": "lodestream-library", "version": 2, "new": []}"#,
                "found 2",
            ),
            (r#"{"format": "another", "version": 1}"#, "found format"),
            (&GOLDEN[..9], "library mark"),
            ("", "library mark"),
            ("\u{0}\u{0}\u{0}", "library mark"),
            (&long, "bytes"),
        ] {
            let path = Path::from(MARK);
            store.put(&path, mark.to_owned().into()).await.unwrap();
            for refused in [library.check().await, library.make().await] {
                let error = refused.unwrap_err();
                let is_damage = matches!(error, LibraryError::Damaged { .. });
                let text = error.to_string();
                assert!(is_damage && text.contains(expected), "{mark}: {text}");
                assert!(text.contains(MARK), "{text}");
            }
            // A foreign mark is not overwritten.
            let kept = store.get(&path).await.unwrap().bytes().await.unwrap();
            assert_eq!(kept, mark);
        }
    })
    .await;
}

/// Unpublished, published and emptied libraries older than the mark.
#[tokio::test]
async fn libraries_of_before_the_mark_open_and_get_it() {
    on_each_raw_store(|library, store| async move {
        let object = made::put(&library, Bytes::from_static(b"an outline")).await;
        library.check().await.unwrap();
        let asset = made::asset(&library, 1, 1, 100).await;
        made::scene(&library, "city", &[asset]).await;
        library.check().await.unwrap();
        assert!(
            store.get(&Path::from(MARK)).await.is_err(),
            "a look writes nothing"
        );
        library.make().await.unwrap();
        let mark = store.get(&Path::from(MARK)).await.unwrap();
        assert_eq!(mark.bytes().await.unwrap(), GOLDEN);
        assert!(library.object(&object).await.is_ok());
    })
    .await;
    let folder = tempfile::tempdir().unwrap();
    for name in ["scenes", "objects/ab", "builds"] {
        std::fs::create_dir_all(folder.path().join(name)).unwrap();
    }
    std::fs::write(folder.path().join(".lock"), "").unwrap();
    let emptied = Library::open(folder.path().to_str().unwrap()).unwrap();
    emptied.check().await.unwrap();
}

#[tokio::test]
async fn places_with_other_files_stay_as_they_are() {
    let hash = "ab".repeat(20);
    for other in [
        "notes.txt",
        ".profile",
        "photos/2024/one.jpg",
        // A git repository, and folders of the same names.
        &format!("objects/ab/{hash}"),
        "objects/ab/readme",
        "scenes/opening.mp4",
        "scenes/city/model.obj",
        "scenes/-city",
    ] {
        on_each_raw_store(|library, store| async move {
            store
                .put(&Path::from(other), "not ours".into())
                .await
                .unwrap();
            no_library(&library).await;
            let error = library.make().await.unwrap_err();
            let text = error.to_string();
            assert!(matches!(error, LibraryError::Location { .. }), "{text}");
            let name = other.rsplit('/').next().unwrap();
            assert!(
                text.contains("other files") && text.contains(name),
                "{text}"
            );
            assert!(store.get(&Path::from(MARK)).await.is_err());
        })
        .await;
    }
}

/// Writers stage `PATH#N` beside `PATH`.
#[tokio::test]
async fn gc_takes_what_killed_writers_staged() {
    let folder = tempfile::tempdir().unwrap();
    let library = Library::open(folder.path().to_str().unwrap()).unwrap();
    library.make().await.unwrap();
    let asset = made::asset(&library, 1, 1, 100).await;
    let pack = object_path(&asset.asset.pack);
    made::scene(&library, "city", &[asset]).await;
    let place = |path: &str| folder.path().join(path);
    let build = pack.replacen("objects", "builds", 1);
    let staged = [
        format!("{pack}#1"),
        format!("{pack}#12"),
        format!("{build}#1"),
        "scenes/city#1".to_owned(),
        "plans/city#2".to_owned(),
        "library.json#1".to_owned(),
    ];
    let others = ["objects/ab/notes#1", "mine#1", "scenes/.city#1"];
    let before = files(folder.path()).len();
    for path in staged.iter().map(String::as_str).chain(others) {
        std::fs::create_dir_all(place(path).parent().unwrap()).unwrap();
        std::fs::write(place(path), "half").unwrap();
    }
    let sweep = |grace_secs, dry_run| {
        let options = GcOptions {
            grace_secs,
            dry_run,
        };
        library.gc(options)
    };
    let young = sweep(3600, false).await.unwrap();
    assert_eq!((young.staged, young.removed_staged), (6, 0));
    age(&[place(&staged[0])]);
    for dry_run in [true, false] {
        let swept = sweep(3600, dry_run).await.unwrap();
        assert_eq!((swept.staged, swept.removed_staged), (5, 1));
        assert_eq!(swept.removed_staged_bytes, 4);
        assert_eq!(place(&staged[0]).exists(), dry_run);
        // They are no objects.
        assert_eq!((swept.live, swept.young, swept.removed), (4, 0, 0));
    }
    let swept = sweep(0, false).await.unwrap();
    assert_eq!((swept.staged, swept.removed_staged), (0, 5));
    for other in others {
        assert!(place(other).exists(), "{other}");
    }
    assert_eq!(files(folder.path()).len(), before + others.len());
}

#[test]
fn a_library_that_cannot_be_opened_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, b"").unwrap();
    let (file, none) = (file.to_str().unwrap(), folder.path().join("none"));
    for (location, expected) in [
        ("s3:///prefix", "an URL without a bucket"),
        ("gs://bucket/prefix", "gs:// URL"),
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

/// A writer sees the files of another one that was quicker, and its mark.
#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn writers_at_once_make_one_library() {
    for _ in 0..40 {
        let folder = tempfile::tempdir().unwrap();
        let location = folder.path().join("library").display().to_string();
        let writers = (0..8u64).map(|writer| {
            let location = location.clone();
            tokio::spawn(async move {
                let library = Library::open_or_make(&location).await.unwrap();
                made::asset(&library, writer, 1, 100).await;
            })
        });
        for writer in writers.collect::<Vec<_>>() {
            writer.await.unwrap();
        }
    }
}
