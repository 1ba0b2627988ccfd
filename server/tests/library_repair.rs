//! Repair by copy and ingest, for every kind of damage on every kind of store.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::sync::Arc;

use bytes::Bytes;
use futures_util::TryStreamExt;
use lodestream_format::ContentHash;
use lodestream_format::library::object_path;
use lodestream_server::ingest::{IngestOptions, ingest};
use lodestream_server::library::{CopyOptions, CopyReport, Library};
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt};
use support::bumps::{self, bump};
use support::made;
use support::stores::on_each_raw_store;
use tokio::runtime::Handle;

/// Damaged bytes of a file; none removes it.
type Damage = fn(&[u8]) -> Option<Vec<u8>>;

const DAMAGES: [(&str, Damage); 7] = [
    ("flipped", |bytes| {
        let mut flipped = bytes.to_vec();
        flipped[bytes.len() / 2] ^= 1;
        Some(flipped)
    }),
    ("truncated", |bytes| Some(bytes[..bytes.len() / 2].to_vec())),
    ("grown", |bytes| Some([bytes, &[0]].concat())),
    ("zeroed", |bytes| Some(vec![0; bytes.len()])),
    ("swapped", |bytes| {
        let mut other = bytes.to_vec();
        other.rotate_left(1);
        Some(other)
    }),
    ("emptied", |_| Some(vec![])),
    ("gone", |_| None),
];

fn verifying() -> CopyOptions {
    CopyOptions {
        verify: true,
        ..CopyOptions::default()
    }
}

async fn damage(store: &Arc<dyn ObjectStore>, path: &Path, damage: Damage) {
    let whole = store.get(path).await.unwrap().bytes().await.unwrap();
    match damage(&whole) {
        Some(bytes) => drop(store.put(path, bytes.into()).await.unwrap()),
        None => store.delete(path).await.unwrap(),
    }
}

async fn all_files(store: &Arc<dyn ObjectStore>) -> Vec<Path> {
    let listed: Vec<_> = store.list(None).try_collect().await.unwrap();
    let mut files: Vec<Path> = listed.into_iter().map(|file| file.location).collect();
    files.sort();
    files
}

async fn check_all(library: &Library) {
    for name in library.scene_names(None, 9).await.unwrap() {
        let scene = library.reference(&name).await.unwrap().scene;
        for hash in library.reach(&scene).await.unwrap().objects() {
            library.check_object(hash).await.unwrap();
        }
    }
}

/// Two scenes with objects sent whole and in parts, and a build record.
async fn source() -> (Library, [made::Made; 2]) {
    let source = Library::open("memory://").unwrap();
    let assets = [
        made::asset(&source, 1, 4, 3000).await,
        made::asset(&source, 2, 60, 100_000).await,
    ];
    made::scene(&source, "one", &assets[..1]).await;
    made::scene(&source, "two", &assets).await;
    let key = ContentHash::of(b"key");
    source
        .put_build(&key, &made::record_of(&assets[0]))
        .await
        .unwrap();
    (source, assets)
}

#[tokio::test]
async fn a_verifying_copy_mends_every_kind_of_damage() {
    let (source, _) = source().await;
    let source = &source;
    on_each_raw_store(|target, store| async move {
        let first = target.copy_from(source, &verifying()).await.unwrap();
        assert_eq!((first.copied, first.records), (8, 1));
        assert_eq!((first.repaired.objects, first.verified), (0, 0));
        let files = all_files(&store).await;
        // Eight objects, a record, two references.
        assert_eq!(files.len(), 11);
        let mut whole = vec![];
        for file in &files {
            whole.push(store.get(file).await.unwrap().bytes().await.unwrap());
        }
        for (how, damages) in DAMAGES {
            for file in &files {
                damage(&store, file, damages).await;
            }
            let done = target.copy_from(source, &verifying()).await.unwrap();
            assert_eq!(done.unrepaired, [] as [&str; 0], "{how}");
            assert_eq!((done.copied, done.published), (8, 2), "{how}");
            // Without references nothing tells that objects are missing.
            let repaired = if how == "gone" { 0 } else { 9 };
            assert_eq!(done.repaired.objects, repaired, "{how}");
            for (file, whole) in files.iter().zip(&whole) {
                let now = store.get(file).await.unwrap().bytes().await.unwrap();
                // A reference holds the time of its publication.
                assert!(
                    now == whole || file.as_ref().starts_with("scenes/"),
                    "{how}: {file}"
                );
            }
            check_all(&target).await;
            let again = target.copy_from(source, &verifying()).await.unwrap();
            assert_eq!((again.copied, again.published), (0, 0), "{how}");
            assert_eq!((again.records, again.verified), (0, 8), "{how}");
        }
    })
    .await;
}

/// One object at a time, with whole references.
#[tokio::test]
async fn each_object_alone_is_mended_and_counted() {
    let (source, assets) = source().await;
    let (source, assets) = (&source, &assets);
    on_each_raw_store(|target, store| async move {
        target.copy_from(source, &verifying()).await.unwrap();
        let scene = target.reference("two").await.unwrap().scene;
        let [small, large] = assets;
        for hash in [
            scene,
            small.hash,
            large.asset.hierarchy,
            small.asset.pack,
            large.asset.pack,
        ] {
            let path = Path::from(object_path(&hash));
            let bytes = target.object_bytes(&hash).await.unwrap().unwrap();
            for (how, damages) in DAMAGES {
                for scenes in [vec![], vec!["two".to_owned()]] {
                    damage(&store, &path, damages).await;
                    let options = CopyOptions {
                        scenes,
                        ..verifying()
                    };
                    let done = target.copy_from(source, &options).await.unwrap();
                    assert_eq!((done.copied, done.copied_bytes), (1, bytes), "{how}");
                    let repaired = done.repaired;
                    assert_eq!((repaired.objects, repaired.bytes), (1, bytes), "{how}");
                    target.check_object(&hash).await.unwrap();
                }
            }
        }
    })
    .await;
}

/// Without `verify`: by length, and by hash for scenes and assets, which are read anyway.
#[tokio::test]
async fn a_plain_copy_mends_what_has_another_length() {
    let (source, assets) = source().await;
    let (source, assets) = (&source, &assets);
    on_each_raw_store(|target, store| async move {
        let plain = CopyOptions::default();
        target.copy_from(source, &plain).await.unwrap();
        let pack = Path::from(object_path(&assets[0].asset.pack));
        for (how, damages) in DAMAGES {
            let is_seen = !["flipped", "zeroed", "swapped"].contains(&how);
            damage(&store, &pack, damages).await;
            let done = target.copy_from(source, &plain).await.unwrap();
            let expected = u64::from(is_seen);
            assert_eq!(
                (done.copied, done.repaired.objects),
                (expected, expected),
                "{how}"
            );
            target.copy_from(source, &verifying()).await.unwrap();
        }
        let scene = target.reference("two").await.unwrap().scene;
        for hash in [scene, assets[1].hash] {
            damage(&store, &Path::from(object_path(&hash)), DAMAGES[0].1).await;
            let done = target.copy_from(source, &plain).await.unwrap();
            assert_eq!((done.copied, done.repaired.objects), (1, 1));
            target.check_object(&hash).await.unwrap();
        }
    })
    .await;
}

#[tokio::test]
async fn damage_that_the_source_has_not_is_dropped_or_told() {
    on_each_raw_store(|target, store| async move {
        let (source, _) = source().await;
        let source = &source;
        target.copy_from(source, &verifying()).await.unwrap();
        let own = made::asset(&target, 9, 3, 1000).await;
        made::scene(&target, "own", std::slice::from_ref(&own)).await;
        let orphan = made::put(&target, Bytes::from_static(b"nobody's")).await;
        let record = ContentHash::of(b"own record");
        target
            .put_build(&record, &made::record_of(&own))
            .await
            .unwrap();
        for hash in [orphan, own.asset.pack] {
            damage(&store, &Path::from(object_path(&hash)), DAMAGES[0].1).await;
        }
        let name = record.to_string();
        let path = Path::from(format!("builds/{}/{name}", &name[..2]));
        damage(&store, &path, DAMAGES[0].1).await;
        let copy = |options: CopyOptions| {
            let target = target.clone();
            async move { target.copy_from(source, &options).await.unwrap() }
        };
        let told = |report: &CopyReport| report.unrepaired.join("\n");
        let done = copy(verifying()).await;
        assert_eq!((done.dropped, done.repaired.objects), (2, 0));
        assert_eq!(target.object_bytes(&orphan).await.unwrap(), None);
        assert!(target.build::<u32>(&record).await.unwrap().is_none());
        assert_eq!(done.unrepaired.len(), 1, "{}", told(&done));
        assert!(told(&done).contains(&own.asset.pack.to_string()));
        // Its other pages are whole.
        assert!(
            target
                .object_bytes(&own.asset.pack)
                .await
                .unwrap()
                .is_some()
        );
        // Now the source has it.
        made::asset(source, 9, 3, 1000).await;
        let done = copy(verifying()).await;
        assert_eq!((done.repaired.objects, told(&done).as_str()), (1, ""));
        check_all(&target).await;
        // An unreadable scene may need any damaged object.
        store
            .put(&Path::from("scenes/own"), "{".into())
            .await
            .unwrap();
        let stray = made::put(&target, Bytes::from_static(b"whose?")).await;
        damage(&store, &Path::from(object_path(&stray)), DAMAGES[0].1).await;
        let done = copy(verifying()).await;
        assert_eq!(
            (done.dropped, done.unrepaired.len()),
            (0, 2),
            "{}",
            told(&done)
        );
        assert!(told(&done).contains("scenes/own"), "{}", told(&done));
    })
    .await;
}

/// Only the mesh whose objects are damaged is built anew.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_ingest_mends_what_it_would_use_again() {
    let folder = tempfile::tempdir().unwrap();
    let options = IngestOptions {
        inputs: vec![bumps::write(
            folder.path(),
            "two",
            &[bump("a", 1, 8), bump("b", 2, 9)],
        )],
        scene: "x".to_owned(),
        threads: Some(1),
        ..IngestOptions::default()
    };
    let options = &options;
    on_each_raw_store(|library, store| async move {
        let ingested = async || {
            let (library, options) = (library.clone(), options.clone());
            let run = move || ingest(&Handle::current(), &library, &options).unwrap();
            tokio::task::spawn_blocking(run).await.unwrap()
        };
        ingested().await;
        let mut objects = all_files(&store).await;
        objects.retain(|path| path.as_ref().starts_with("objects/"));
        // Three of each mesh, the texture, the scene.
        assert_eq!(objects.len(), 8);
        for (how, damages) in DAMAGES {
            for (at, path) in objects.iter().enumerate() {
                let whole = store.get(path).await.unwrap().bytes().await.unwrap();
                damage(&store, path, damages).await;
                let done = ingested().await;
                let repaired = (done.repaired.objects, done.repaired.bytes);
                assert_eq!(repaired, (1, whole.len() as u64), "{how}, object {at}");
                assert!(done.built <= 1 && done.built + done.reused == 2);
                let now = store.get(path).await.unwrap().bytes().await.unwrap();
                assert!(now == whole, "{how}, object {at}");
            }
        }
        let done = ingested().await;
        assert_eq!((done.built, done.repaired.objects), (0, 0));
        check_all(&library).await;
    })
    .await;
}

/// An empty source is refused unless allowed.
#[tokio::test]
async fn a_mirror_removes_what_the_source_lost() {
    let (source, _) = source().await;
    let source = &source;
    on_each_raw_store(|target, _| async move {
        target.copy_from(source, &verifying()).await.unwrap();
        let own = made::asset(&target, 9, 3, 1000).await;
        made::scene(&target, "own", &[own]).await;
        let names = async || target.scene_names(None, 9).await.unwrap();
        assert_eq!(names().await, ["one", "own", "two"]);
        let delete = CopyOptions {
            delete: true,
            ..CopyOptions::default()
        };
        let empty = Library::open("memory://").unwrap();
        let nothing_lost = async |options: &CopyOptions| {
            let error = target.copy_from(&empty, options).await.unwrap_err();
            assert!(error.to_string().contains("scenes to copy"), "{error}");
            assert_eq!(names().await, ["one", "own", "two"]);
        };
        nothing_lost(&delete).await;
        nothing_lost(&CopyOptions::default()).await;
        let done = target.copy_from(source, &delete).await.unwrap();
        assert_eq!(done.removed, ["own"]);
        assert_eq!(names().await, ["one", "two"]);
        let allowed = CopyOptions {
            allow_empty: true,
            ..delete
        };
        let done = target.copy_from(&empty, &allowed).await.unwrap();
        assert_eq!(done.removed, ["one", "two"]);
        assert_eq!(names().await, [] as [&str; 0]);
    })
    .await;
}
