//! Publications that replace what they expect: of several at the same time one counts.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use futures_util::future::join_all;
use lodestream_server::library::{LibraryError, Replaces};
use support::made;
use support::stores::on_each_store;

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn of_publications_at_the_same_time_one_replaces_a_scene() {
    on_each_store(|library| async move {
        let mut scenes = vec![];
        for seed in 0..9 {
            let asset = made::asset(&library, seed, 1, 100).await;
            scenes.push(made::scene(&library, &format!("source-{seed}"), &[asset]).await);
        }
        let mut replaces = Replaces::Nothing;
        for round in 0..4 {
            let tries = scenes.iter().map(|&scene| {
                let library = library.clone();
                // Each in a task of its own: they run at the same time.
                tokio::spawn(async move {
                    let published = library.publish_replacing("city", scene, replaces).await;
                    published.map(|reference| reference.scene)
                })
            });
            let mut counted = vec![];
            for tried in join_all(tries).await {
                match tried.unwrap() {
                    Ok(scene) => counted.push(scene),
                    Err(LibraryError::Changed { .. }) => {}
                    Err(error) => panic!("{error}"),
                }
            }
            // Whoever publishes what is there already may come after the one that counts.
            let now = library.reference("city").await.unwrap().scene;
            let others = counted.iter().filter(|&&scene| scene != now).count();
            assert!(counted.contains(&now), "round {round}");
            assert_eq!(others, 0, "round {round}: {counted:?}, now {now}");
            replaces = Replaces::Scene(now);
            scenes.retain(|&scene| scene != now);
        }
    })
    .await;
}

#[tokio::test]
async fn a_name_that_points_elsewhere_stays() {
    on_each_store(|library| async move {
        let asset = made::asset(&library, 1, 1, 100).await;
        let other = made::asset(&library, 2, 1, 100).await;
        let first = made::scene(&library, "city", &[asset]).await;
        let second = made::scene(&library, "other", &[other]).await;
        for (name, replaces) in [
            ("city", Replaces::Nothing),
            ("city", Replaces::Scene(second)),
            ("none", Replaces::Scene(first)),
        ] {
            let failed = library.publish_replacing(name, second, replaces).await;
            let early = library.check_replaced(name, replaces).await;
            assert!(
                matches!(early, Err(LibraryError::Changed { .. })),
                "{name} {early:?}"
            );
            let error = failed.unwrap_err();
            let missing = name == "none" && error.is_missing();
            assert!(
                missing || matches!(error, LibraryError::Changed { .. }),
                "{error}"
            );
        }
        assert_eq!(library.reference("city").await.unwrap().scene, first);
        for (name, replaces) in [
            ("new", Replaces::Nothing),
            ("city", Replaces::Scene(first)),
            ("city", Replaces::Anything),
        ] {
            library.check_replaced(name, replaces).await.unwrap();
            library
                .publish_replacing(name, second, replaces)
                .await
                .unwrap();
            assert_eq!(library.reference(name).await.unwrap().scene, second);
        }
    })
    .await;
}
