//! Copies between libraries on every kind of store.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use lodestream_server::library::{CopyOptions, Library};
use support::made;
use support::stores::on_each_store;
use support::watched::Watched;

fn only(scene: &str) -> CopyOptions {
    CopyOptions {
        scenes: vec![scene.to_owned()],
        ..CopyOptions::default()
    }
}

/// Every kind of store as the target, and one that is interrupted after each of its writes.
#[tokio::test]
async fn copies_send_what_is_missing_and_go_on_after_any_interruption() {
    let source = Library::open("memory://").unwrap();
    let assets = [
        made::asset(&source, 1, 4, 3000).await,
        made::asset(&source, 2, 60, 100_000).await,
    ];
    made::scene(&source, "one", &assets[..1]).await;
    let both = made::scene(&source, "two", &assets).await;
    let source = &source;
    on_each_store(|target| async move {
        let done = target.copy_from(source, &only("two")).await.unwrap();
        // Scene, and asset, pack and hierarchy of each.
        assert_eq!(
            (done.scenes, done.published, done.objects, done.copied),
            (1, 1, 7, 7)
        );
        assert_eq!(target.reference("two").await.unwrap().scene, both);
        for hash in target.reach(&both).await.unwrap().objects() {
            target.check_object(hash).await.unwrap();
        }
        let done = target
            .copy_from(source, &CopyOptions::default())
            .await
            .unwrap();
        // The other scene's asset was there.
        assert_eq!(
            (done.scenes, done.published, done.objects, done.copied),
            (2, 1, 11, 1)
        );
        let done = target
            .copy_from(source, &CopyOptions::default())
            .await
            .unwrap();
        assert_eq!((done.published, done.copied, done.copied_bytes), (0, 0, 0));
        let unknown = target.copy_from(source, &only("three")).await;
        assert!(unknown.unwrap_err().to_string().contains("three"));
    })
    .await;

    // Packs of 12 KB and 6 MB, so whole and in parts; parts are not counted as writes.
    let store = Watched::new();
    let target = Library::over(store.clone(), "watched");
    for writes in 0.. {
        store.fail_after(writes % 3 + 1);
        let done = target.copy_from(source, &CopyOptions::default()).await;
        store.fail_after(i64::MAX);
        // What is named is whole, whatever happened.
        for name in target.scene_names(None, 9).await.unwrap() {
            let scene = target.reference(&name).await.unwrap().scene;
            for hash in target.reach(&scene).await.unwrap().objects() {
                target.check_object(hash).await.unwrap();
            }
        }
        if done.is_ok() {
            assert!(writes > 2, "it was interrupted");
            break;
        }
        assert!(writes < 99, "{done:?}");
    }
    assert_eq!(target.scene_names(None, 9).await.unwrap(), ["one", "two"]);
}

#[tokio::test]
async fn a_damaged_object_is_not_copied() {
    let folder = tempfile::tempdir().unwrap();
    let source = Library::open(folder.path().to_str().unwrap()).unwrap();
    let asset = made::asset(&source, 1, 60, 100_000).await;
    made::scene(&source, "large", std::slice::from_ref(&asset)).await;
    let pack = folder
        .path()
        .join(lodestream_format::library::object_path(&asset.asset.pack));
    let mut bytes = std::fs::read(&pack).unwrap();
    bytes[5_000_000] ^= 1;
    std::fs::write(&pack, bytes).unwrap();
    let target = Library::open("memory://").unwrap();
    let error = target
        .copy_from(&source, &CopyOptions::default())
        .await
        .unwrap_err()
        .to_string();
    assert!(error.contains(&asset.asset.pack.to_string()), "{error}");
    assert_eq!(target.object_bytes(&asset.asset.pack).await.unwrap(), None);
    assert!(target.scene_names(None, 9).await.unwrap().is_empty());
}
